"""A comparison as text for a terminal."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from typing import Any

HEAD = (
    *("solver", "feasible", "near the best", "95 %", "best", "median", "worst"),
    *("evals", "false"),
)

Content = Mapping[str, Any]


def report_text(content: Content, *, times: bool = False) -> str:
    """Return a comparison as a table for each scenario, a line for each solver.

    Args:
        content: Content, as from `content_of`.
        times: Whether seconds are shown. Without them the text is the same in every
            call and on every machine, if the budget is in evaluations.
    """
    seeds = content["seeds"]
    range_of = f"seeds {seeds[0]} to {seeds[-1]}" if seeds else "no seeds"
    budget = content["budget_text"]
    lines = [f"budget {budget} a planning problem, {range_of}" if budget else range_of]
    for scenario in content["scenarios"]:
        lines += ["", *_scenario(scenario, times)]
    return "\n".join(lines)


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
    word = against["words"].partition(" (")[0]
    return f"{word}, p = {against['p']:.2g}"


def _notes(scenario: Content, times: bool) -> list[str]:
    rows = scenario["rows"]
    notes = []
    if len(rows) > 1:
        first = rows[0]["solver"]
        notes.append(f"  the last column compares each with {first}, seed by seed")
    if scenario["best_cost"] is not None and scenario["best_by"] is None:
        best = scenario["sense"] * scenario["best_cost"]
        notes.append(f"  the best known, {best:.6g}, is from elsewhere")
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
