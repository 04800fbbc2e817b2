"""The page docs/when.md, on when a swarm helps, from comparisons of the command line.

    for name in plans long_plans flights close_flights; do
        swarmstart compare benchmarks/comparisons/$name.yaml --out results/when/$name
    done
    python benchmarks/when.py results/when/* > docs/when.md

The words follow from the numbers: success rates decide the group of a problem.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from swarmstart.benchmarks.tables import head, row
from swarmstart.cases.campaign.trials.solvers import seconds_of
from swarmstart.cases.format.scenario import shipped

COLD, MANY = "ipopt", "repeated-ipopt"
OWN = ("solve", "multistart+ipopt", "lshade+ipopt")
COLUMNS = ("solve", COLD, MANY, "multistart+ipopt", "lshade+ipopt")
NEAR_BUDGET = 3.0
"""A time within this factor of the budget depends on the machine, and is marked."""
RULE = """## A rule before you measure

Count the decisions that your problem leaves open: on which side to pass each obstacle
or vehicle, which gap to take, how many swings to make, on which side an elbow bends,
which of several whole numbers to take. Such decisions make many optima; size,
nonlinearity or a long horizon alone does not.

| open decisions | problems | take |
| --- | --- | --- |
| none | rockets, reactors, tracking | IPOPT alone, from zero controls or a guess |
| one or two | one obstacle to pass, four discs | IPOPT from random starts |
| many | mazes, currents, arms among discs, a weak motor | `solve` without options |
| whole numbers | gears, switches | the same: rounding is rarely best |
| many, in a problem without [lanes](glossary.md#lane) | \
a stiff reactor; smooth paths with a few parameters | \
a population search, then IPOPT from its best point |

[Hard problems that nothing was tuned on](measured/held_back.md) compares `solve`
without options with IPOPT from random starts at equal CPU time, on random problems of
eight families, which belong to rows three and four. [A comparison on hard
problems](hard.md) compares methods and peers at equal CPU time.

After a run, what `print(solution)` or `swarmstart run` prints shows which row was
yours. If the line `lanes` says that all starts found one optimum, IPOPT alone would
have been enough. If the starts found several optima, and only one start found the
cheapest, more starts are advised ([what an answer says](answers.md)).
"""
Scenario = Mapping[str, Any]


def main(folders: Sequence[str]) -> int:
    """Print the page."""
    contents = [
        json.loads((Path(folder) / "comparison.json").read_text()) for folder in folders
    ]
    told = [(one, c["budget_text"]) for c in contents for one in c["scenarios"]]
    groups: dict[str, list[tuple[Scenario, str]]] = {}
    for one, budget in told:
        groups.setdefault(group_of(one), []).append((one, budget))
    lines = _preface(contents, groups)
    for name, text in GROUPS.items():
        if found := groups.get(name, []):
            lines += [f"## {name}", "", text, "", *_table(found), *_notes(found)]
    print("\n".join(lines).rstrip())
    return 0


GROUPS = {
    "IPOPT alone is the better choice": "From zero controls IPOPT finds the best "
    "known cost (within 1 %), so no search can find a better one. Take `polish: ipopt` "
    "and no search.",
    "IPOPT from random starts is enough": "IPOPT from zero controls does not find the "
    "best known cost. From random starts its success rate is not shown to be below "
    "that of lanes or a search.",
    "Lanes, a search or `solve` find more": "The success rate of one of these methods "
    "is above that of IPOPT from random starts: the confidence intervals of the two do "
    "not overlap.",
    "No solver comes near the best in more than half of its runs": "More time is "
    "needed, or another start.",
}


def group_of(scenario: Scenario) -> str:
    """Return the group of a scenario, by its success rates."""
    rows = {one["solver"]: one for one in scenario["rows"]}
    names = list(GROUPS)
    rates = {name: _rate(one) for name, one in rows.items()}
    if max(rates.values(), default=0.0) <= 0.5:
        return names[3]
    if rates.get(COLD, 0.0) == 1.0:
        return names[0]
    many = _interval(rows[MANY])
    better = [rows[name] for name in OWN if name in rows]
    if any(_interval(one)[0] > many[1] for one in better):
        return names[2]
    return names[1]


def _rate(one: Mapping[str, Any]) -> float:
    return float(one["near"][0] / one["runs"]) if one["runs"] else 0.0


def _interval(one: Mapping[str, Any]) -> tuple[float, float]:
    if one["near_intervals"] is None:
        return _rate(one), _rate(one)
    low, high = one["near_intervals"][0]
    return low, high


def _table(found: Sequence[tuple[Scenario, str]]) -> list[str]:
    lines = head("scenario", "budget", *(f"`{name}`" for name in COLUMNS))
    for scenario, budget in sorted(found, key=lambda one: one[0]["name"]):
        rows = {one["solver"]: one for one in scenario["rows"]}
        seconds = seconds_of(budget)
        cells = [cell_of(rows.get(name), seconds) for name in COLUMNS]
        kind = "flight" if scenario["of"] == "flight" else "plan"
        lines.append(row(f"{scenario['name']} ({kind})", budget, *cells))
    return [*lines, ""]


NOTES = {
    "formation_obstacle_uav3": "is checked once a second, as in the book chapter from "
    "which it comes ([The chapter](chapter/index.md)): searches and random starts find "
    "cheaper plans that keep all limits at these instants, but cut the obstacle "
    "between them and cannot be [repaired](answers.md#repair)",
    "lotka_volterra_whole": "has controls of whole numbers. `solve`, `ipopt` and "
    "`lshade+ipopt` solve the relaxed problem and round; `repeated-ipopt` and "
    "`multistart+ipopt` refuse such problems, so they have no answer",
    "formation_v": "and the other three flights are shipped with the book chapter's "
    "search and budget and without IPOPT, so in their rows `solve` is that search "
    "alone",
    "swap_5": "and `swap_8` search smooth paths to the goals, for which there are no "
    "lanes; in their rows, `multistart+ipopt` is IPOPT from random paths",
    "bifunctional_catalyst": "has hundreds of local optima; it is stiff, so there are "
    "no lanes for it",
}
"""Notes that explain a row."""


def _notes(found: Sequence[tuple[Scenario, str]]) -> list[str]:
    told = [one["name"] for one, _ in found if one["name"] in NOTES]
    lines = [f"- `{name}` {NOTES[name]}." for name in sorted(told)]
    return [*lines, ""] if lines else []


def cell_of(one: Mapping[str, Any] | None, budget: float) -> str:
    """Return success and seconds to the first one, as expected with restarts.

    Times that lie near the budget are marked with ~, since another machine may end on
    its other side. Without success "none in 1 s" is said of runs that took so long, and
    "none" of those that ended long before: more time would not have helped them.

    Args:
        one: Row of a solver; None: it was not run.
        budget: Budget of a run [s].
    """
    if one is None:
        return "-"
    seconds, usual = one["ert_seconds"][0], one["seconds_p50"]
    if seconds is None and one["near"][0] and usual is not None:
        seconds = usual * one["runs"] / one["near"][0]
    if seconds is None:
        has_waited = usual is None or usual >= budget / NEAR_BUDGET
        said = f"none in {budget:g} s" if has_waited else "none"
    else:
        is_near = budget / NEAR_BUDGET <= seconds <= budget * NEAR_BUDGET
        said = f"{'~' if is_near else ''}{seconds:.2g} s"
    return f"{one['near'][0]} of {one['runs']}, {said}"


def _preface(
    contents: Sequence[Mapping[str, Any]],
    groups: Mapping[str, Sequence[object]],
) -> list[str]:
    counts = [len(groups.get(name, [])) for name in GROUPS]
    names = sum(counts)
    cores = {machine["cores"] for c in contents for machine in c["machines"]}
    noisy = any(c["is_noisy"] for c in contents)
    lines = [
        "# When does a swarm help?",
        "",
        f"Of {names} shipped problems and flights, IPOPT alone is the better choice on "
        f"{counts[0]}, IPOPT from random starts is enough on {counts[1]}, and on "
        f"{counts[2]} the methods of this package (fast local solvers, a population "
        "search, or `solve`, which combines them) come near the best more often than "
        "IPOPT from random starts"
        + (f"; no solver is reliable on {counts[3]}." if counts[3] else "."),
        "",
        "Each cell has the number of runs that end within 1 % of the best known cost, "
        "verified along the whole path, and the expected seconds until the first such "
        "answer with restarts (failed runs count with all their time; building and "
        "compiling do not count). A time marked ~ is within a factor of "
        f"{NEAR_BUDGET:g} of the budget, so on another machine more or fewer runs may "
        "succeed. 'none in 1 s' means that no run succeeded in this budget; 'none' "
        "means that no run succeeded, although all ended long before the budget. "
        "`solve` is what `swarmstart run` does with the scenario as it is shipped; the "
        "[other columns]"
        "(compare.md#solvers) are solvers of `compare`. `ipopt` starts at zero "
        "controls. It is run once, since nothing is random. The budget of a flight is "
        "that of each plan; "
        f"{_seeds(contents)}, {' and '.join(map(str, sorted(cores)))} cores"
        + (", with other work: seconds are rough." if noisy else "."),
        "",
        "The best known cost is that of these runs, so an optimum that none of them "
        "found is missing here. The problems come with this package; some were chosen "
        "because they have local optima. Your problems may differ: measure them with "
        "`swarmstart compare` ([Compare solvers](compare.md)). Why local optima "
        "appear: [Local optima](explanation/local_optima.md).",
        "",
        f"Shipped and not compared here: {', '.join(_left_out(contents))}.",
        "",
        RULE,
    ]
    return lines


def _left_out(contents: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the shipped scenarios that were not compared."""
    compared = {one["name"] for c in contents for one in c["scenarios"]}
    return sorted(f"`{name}`" for name in shipped() if name not in compared)


def _seeds(contents: Sequence[Mapping[str, Any]]) -> str:
    counts = sorted({len(c["seeds"]) for c in contents}, reverse=True)
    return " or ".join(f"{count} seeds" for count in counts)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
