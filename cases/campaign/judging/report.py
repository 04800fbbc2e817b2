"""A comparison in words: sentences on its limits, and a table for a terminal."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from swarmstart.cases.format.registry import RULES, SOLVE
from swarmstart.ocp import BoundKind

FEW_SEEDS = 15
MOST_NAMED = 3
_BOUNDS = tuple(kind.value for kind in BoundKind if kind.is_bound)
"""Kinds of proven bounds; an estimate from samples is not one."""

LISTED = {
    "exact": "the list of hard problems (exact)",
    "bound": "the list of hard problems",
    "runs": "the list of hard problems",
}
"""Source of a listed best known cost, by the grounds for it."""

Content = Mapping[str, Any]

HEAD = (
    *("solver", "feasible", "near the best", "95 %", "best", "median", "worst"),
    *("evals", "false"),
)


def found_by(scenario: Content) -> str:
    """Return which solvers have found the best known cost of a scenario, in words."""
    if scenario["best_by"]:
        return f"found by {scenario['best_by']}"
    return f"from {scenario['known_from'] or 'elsewhere'}"


def limits_of(content: Content) -> list[str]:
    """Return the known limits of a comparison, each a sentence.

    Args:
        content: Content of a comparison, as from `content_of`.
    """
    said = [one(content) for one in _LIMITS]
    return [sentence for sentence in said if sentence]


def listed(names: Sequence[str], most: int = MOST_NAMED) -> str:
    """Return names with commas and "and"; of many the first ones and "N more"."""
    if len(names) > most:
        return f"{', '.join(names[:most])} and {len(names) - most} more"
    if len(names) > 1:
        return f"{', '.join(names[:-1])} and {names[-1]}"
    return "".join(names)


def _unlimited(content: Content) -> list[str]:
    """Return the solvers that have a number of evaluations of their own."""
    if content["budget"]["evaluations"] is None:
        return []
    names = [one["name"] for one in content["solvers"]]
    return [name for name in names if name.partition("[")[0] == SOLVE]


def _own_budget(content: Content) -> str:
    named = _unlimited(content)
    if not named:
        return ""
    return (
        f"{listed(named)} does what run does, with the evaluations of the scenario: "
        "those of the comparison do not limit it."
    )


def _few_seeds(content: Content) -> str:
    count = len(content["seeds"])
    words = [
        row["against_first"]["words"]
        for scenario in content["scenarios"]
        for row in scenario["rows"]
    ]
    # The sentence of the tests, with the number of seeds that they need.
    few = next((said for said in words if said.startswith("not compared")), "")
    if few:
        return f"Solvers are {few}."
    if 1 < count < FEW_SEEDS and len(content["solvers"]) > 1:
        return (
            f"{count} seeds are few: a difference that is not shown may still be there."
        )
    return ""


def _best_known(content: Content) -> str:
    unknown = [
        s["name"]
        for s in content["scenarios"]
        if s["best_cost"] is not None
        and (s["known_cost"] is None or s["known_from"] not in ("", LISTED["exact"]))
        and not _is_near_bound(content, s)
    ]
    if not unknown:
        return ""
    return (
        "The best known cost is the least that was found, with no proof that none is "
        f"less: {listed(unknown)}."
    )


def _is_near_bound(content: Content, scenario: Content) -> bool:
    """Return whether a bound shows that the best known is near the optimum."""
    gap = (scenario["bound"] or {}).get("gap")
    return gap is not None and gap <= content["near"][0]


def _seeded(content: Content) -> str:
    drawn = [s["name"] for s in content["scenarios"] if s.get("bests") is not None]
    if not drawn:
        return ""
    return (
        "Each seed draws disturbances of its own, so an answer is near the best if it "
        f"is near that of its seed: {listed(drawn)}."
    )


def _not_reached(content: Content) -> str:
    missed = [
        s["name"]
        for s in content["scenarios"]
        if s["best_cost"] is not None and not any(r["near"][0] for r in s["rows"])
    ]
    if not missed:
        return ""
    return (
        f"No solver comes within {near_words(content)} of the cost known from "
        f"elsewhere: {listed(missed)}."
    )


def _below_bound(content: Content) -> str:
    wrong = []
    for s in content["scenarios"]:
        given, best = s["bound"] or {}, s["best_cost"]
        value = given.get("value")
        if value is not None and given["kind"] in _BOUNDS and best is not None:
            # As for the gap: within this tolerance a bound is met, not exceeded.
            slack = content["near"][1] * max(abs(value), abs(best))
            wrong += [s["name"]] if best < value - slack else []
    if not wrong:
        return ""
    return f"A cost is below the bound; one of the two is wrong: {listed(wrong)}."


def _unsolved(content: Content) -> str:
    unsolved = [s["name"] for s in content["scenarios"] if s["best_cost"] is None]
    return f"No feasible answer is known: {listed(unsolved)}." if unsolved else ""


def _seconds(content: Content) -> str:
    if content["is_noisy"]:
        load = content["load_max"]
        seen = "" if load is None else f" (highest load {load:.1f})"
        return f"The machine was busy{seen}: nothing is claimed about seconds."
    if not content["judges_seconds"]:
        return "Budgets are in evaluations: seconds are shown, and not compared."
    return ""


def _missing(content: Content) -> str:
    count = len(content["solvers"])
    fewer = [s["name"] for s in content["scenarios"] if len(s["rows"]) < count]
    if not fewer:
        return ""
    return (
        f"Not every solver ran on {listed(fewer)}: ranks and profiles leave that out."
    )


def _machines(content: Content) -> str:
    count = len(content["machines"])
    if count > 1:
        return f"Runs are from {count} machines: their seconds are not alike."
    return "All runs are from one machine." if count else ""


def _deterministic(content: Content) -> str:
    rows = [row for scenario in content["scenarios"] for row in scenario["rows"]]
    names = list(dict.fromkeys(r["solver"] for r in rows if r["deterministic"]))
    if not names or len(content["solvers"]) == 1 or len(content["seeds"]) == 1:
        return ""
    return (
        f"{listed(names)}: one run, without chance in it, which counts for every seed "
        "in comparisons."
    )


def _failed(content: Content) -> str:
    rows = [row for scenario in content["scenarios"] for row in scenario["rows"]]
    failed, cut = sum(len(r["failed"]) for r in rows), sum(r["cut"] for r in rows)
    parts = [f"{failed} failed"] * bool(failed) + [
        f"{cut} were ended by the hard limit"
    ] * bool(cut)
    if not parts:
        return ""
    total = sum(row["runs"] for row in rows)
    return f"Of {total} runs {' and '.join(parts)}; they count as they ended."


def _false(content: Content) -> str:
    rows = [row for scenario in content["scenarios"] for row in scenario["rows"]]
    false = sum(row["false_successes"] for row in rows)
    if not false:
        return ""
    claimed = sum(row["claimed_feasible"] for row in rows)
    return (
        f"{false} of {claimed} answers that a solver called feasible are not as it "
        "said when simulated more finely; verified costs are compared."
    )


def _problems(content: Content) -> str:
    if len(content["seeds"]) < 2:  # noqa: PLR2004
        return "One seed: what another would give is not known."
    return (
        "Tests and intervals speak of other seeds on these scenarios, not of other "
        "scenarios."
    )


def near_words(content: Content) -> str:
    """Return the distance within which a cost is near the best known one."""
    return f"{100 * content['near'][0]:g} %"


_LIMITS: tuple[Callable[[Content], str], ...] = (
    *(_unsolved, _few_seeds, _best_known, _seeded, _not_reached, _below_bound),
    *(_own_budget, _seconds, _missing, _machines, _deterministic, _failed, _false),
    _problems,
)


def report_text(content: Content, *, times: bool = False) -> str:
    """Return a comparison as a table for each scenario, a line for each solver.

    Args:
        content: Content of a comparison, as from `content_of`.
        times: Whether seconds are shown. Without them the text is the same in every
            call and on every machine, if the budget is in evaluations.
    """
    seeds = content["seeds"]
    range_of = f"seeds {seeds[0]} to {seeds[-1]}" if seeds else "no seeds"
    lines = [f"{_budget(content)}{range_of}"]
    for scenario in content["scenarios"]:
        lines += ["", *_scenario(scenario, times)]
    return "\n".join(lines)


def _budget(content: Content) -> str:
    """Return the budget in words, with a comma behind it; empty without one."""
    text = content["budget_text"].replace("evals", " evaluations").replace("|", " or ")
    has_plans = any(
        row["solver"] not in RULES
        for scenario in content["scenarios"]
        for row in scenario["rows"]
    )
    if not text or not has_plans:
        return ""
    own = [f"{name} has its own" for name in _unlimited(content)]
    more = f" ({', '.join(own)})" if own else ""
    return f"budget of {text} for each planning problem{more}, "


def _scenario(scenario: Content, times: bool) -> list[str]:
    rows = scenario["rows"]
    table = [[*HEAD, *(["P50 s", "P99 s"] if times else [])]]
    table += [_cells(row, scenario["sense"], times) for row in rows]
    widths = [max(len(line[k]) for line in table) for k in range(len(table[0]))]
    lines = [scenario["name"]]
    for line, said in zip(table, ["", *map(_verdict, rows)], strict=True):
        cells = [text.ljust(width) for text, width in zip(line, widths, strict=True)]
        lines.append(("  " + "  ".join(cells) + f"  {said}").rstrip())
    return [*lines, *_notes(scenario, times)]


def _cells(row: Content, sense: int, times: bool) -> list[str]:
    count = row["runs"]
    interval = row["near_intervals"]
    # An infeasible answer has no cost here, but counts in the columns before.
    costs = sorted(cost for cost in row["costs"] if cost is not None)
    shown = ["-"] * 3
    if costs:
        three = (costs[0], statistics.median(costs), costs[-1])
        shown = [f"{sense * cost:.6g}" for cost in three]
    return [
        row["solver"],
        f"{row['feasible']} of {count}",
        f"{row['near'][0]} of {count}",
        "one run" if interval is None else "{:.2f} to {:.2f}".format(*interval[0]),
        *shown,
        _number(row["evaluations_median"], "g"),
        str(row["false_successes"]),
        *([_number(row[q], ".3g") for q in ("seconds_p50", "seconds_p99")] * times),
    ]


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else f"{value:{form}}"


def _verdict(row: Content) -> str:
    """Return the comparison of a solver with the first, in few words."""
    against = row["against_first"]
    if against["p"] is None:
        return str(against["words"])
    # The counts in brackets have no room in a line.
    word = against["words"].partition(" (")[0]
    return f"{word}, p = {against['p']:.2g}"


def _notes(scenario: Content, times: bool) -> list[str]:
    rows = scenario["rows"]
    notes = []
    if len(rows) > 1:
        first = rows[0]["solver"]
        notes.append(f"  the last column compares each with {first}, seed by seed")
    if scenario["best_cost"] is not None:
        best = scenario["sense"] * scenario["best_cost"]
        notes.append(f"  best known: {best:.6g}, {found_by(scenario)}")
    if scenario["bound"] is not None:
        notes.append(f"  bound: {scenario['bound']['words']}")
    for row in rows:
        cut = row["cut"]
        if cut and times:
            notes.append(f"  {row['solver']}: {cut} ended by the hard limit")
        notes += [f"  {row['solver']}: {text}" for text in _distinct(row["failed"])]
    return notes


def _distinct(texts: Sequence[str]) -> list[str]:
    """Return texts once each, with their number."""
    counts = {text: texts.count(text) for text in texts}
    return [f"{text} ({n} times)" if n > 1 else text for text, n in counts.items()]
