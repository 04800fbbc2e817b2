"""The page of a comparison: one HTML file that stays below 3 MB.

For each scenario it shows the states and controls of the best answer over time, a panel
for each.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swarmstart.cases.drawing import wording
from swarmstart.cases.drawing.page import rendered
from swarmstart.cases.drawing.report import curves, rows, spreads, svg
from swarmstart.cases.drawing.report.figure import Figure
from swarmstart.cases.drawing.report.pictures import PAGE_BYTES
from swarmstart.cases.drawing.wording import is_number, number, shortened, with_unit
from swarmstart.cases.format.document import counted

_MOST_DRAWN = 2200  # Points of all curves.
_FEWEST, _USUAL = 6, 64  # Points of a curve.
_FEW = 10  # With so few, the table of all pairs is left out, too.
_COLUMNS = 3
_WIDE, _HIGH = 300, 150
_MOST = 24  # Panels; what is beyond them is in the values to download.
_STATE, _CONTROL = 0, 1  # Colours: the first two are the furthest apart.


def comparison_page(content: Mapping[str, Any]) -> str:
    """Return the page of a comparison.

    Args:
        content: Content of `comparison.json`: a record "comparison" of schema 2.

    Example:
        >>> import json, pathlib
        >>> file = pathlib.Path("comparison.json")
        >>> if file.exists():
        ...     page = comparison_page(json.loads(file.read_text()))
    """
    drawn = sum(len(scenario["rows"]) for scenario in content["scenarios"])
    points = min(max(_MOST_DRAWN // max(drawn, 1), _FEWEST), _USUAL)
    page = _page(content, points)
    if len(page.encode()) > PAGE_BYTES and points > _FEWEST:
        page = _page(content, _FEWEST)  # What is longer is taken as it is.
    return page


def _page(content: Mapping[str, Any], points: int) -> str:
    numbers = numbers_of(content)
    scenarios = [
        {
            "id": f"scenario-{place}",
            "given": scenario,
            "best": rows.best_words(scenario),
            "rows": rows.details(scenario),
            "troubles": rows.troubles(scenario),
            "measures": rows.measures(scenario),
            "figures": _figures(content, scenario, place, numbers, points),
            "legend": svg.legend(
                {row["solver"]: numbers[row["solver"]] for row in scenario["rows"]}
            ),
            "answer": _trajectory(
                scenario, identity=f"answer-{place}", points=2 * points
            ),
        }
        for place, scenario in enumerate(content["scenarios"], 1)
    ]
    whole = [
        curves.profile(content, numbers=numbers, points=points),
        spreads.ranks(content, numbers=numbers),
    ]
    return rendered(
        "comparison.html.j2",
        {
            "content": content,
            "summary": rows.summary(content),
            "summary_heads": rows.SUMMARY,
            "detail_heads": rows.DETAILS,
            "regression_heads": rows.REGRESSION,
            "regression": rows.regression(content),
            "scenarios": scenarios,
            "whole": [figure for figure in whole if figure is not None],
            "without_profile": curves.without_profile(content),
            "legend": svg.legend(numbers),
            "judged": spreads.judged(content, numbers=numbers),
            "has_pairs": points > _FEW,
            "seeds": counted(len(content["seeds"]), "seed"),
            "near": [wording.percent(share) for share in content["near"]],
            "machines": [rows.machine_words(found) for found in content["machines"]],
            "number": wording.number,
            "percent": wording.percent,
            "shortened": wording.shortened,
        },
    )


def numbers_of(content: Mapping[str, Any]) -> dict[str, int]:
    """Return each solver's number, which decides on its colour, dashes and mark."""
    names = [solver["name"] for solver in content["solvers"]]
    names += [row["solver"] for part in content["scenarios"] for row in part["rows"]]
    names += [rank["solver"] for rank in content["ranks"]]
    names += list(content["profile"]["curves"]) if content["profile"] else []
    return {name: place for place, name in enumerate(dict.fromkeys(names))}


def _figures(
    content: Mapping[str, Any],
    scenario: Mapping[str, Any],
    place: int,
    numbers: Mapping[str, int],
    points: int,
) -> list[Figure]:
    budget = content["budget_text"]
    drawn = [
        curves.convergence(
            scenario, numbers=numbers, identity=f"convergence-{place}", budget=budget,
            near=content["near"], points=points,
        ),
        curves.reached(
            scenario, numbers=numbers, identity=f"targets-{place}", budget=budget,
            points=points,
        ),
        spreads.costs(
            scenario, numbers=numbers, identity=f"spread-{place}", budget=budget
        ),
        spreads.seconds_and_success(
            content, scenario, numbers=numbers, identity=f"seconds-{place}"
        ),
    ]  # fmt: skip
    return [figure for figure in drawn if figure is not None]


def _trajectory(
    scenario: Mapping[str, Any], *, identity: str, points: int
) -> Figure | None:
    """Return states (lines) and controls (steps) of the best answer, if there is one.

    Args:
        scenario: Of the content of a comparison.
        identity: The figure's id.
        points: The most instants drawn and listed.
    """
    answer = scenario["answer"]
    if answer is None or not answer["plan"]["time"]:
        return None
    plan = answer["plan"]
    time = plan["time"]
    kept = svg.thinned(len(time), points)
    series = [
        (_named(name, plan.get("units")), values, kind)
        for of, kind in (("state", _STATE), ("control", _CONTROL))
        for name, values in zip(plan[f"{of}_names"], plan[f"{of}s"], strict=False)
    ]
    if not series:
        return None
    shown = series[:_MOST]
    chart = _panels(time, shown, kept)
    left_out = len(series) - len(shown)
    header = ["time", *(name for name, _, _ in series)]
    values = [[time[k], *(_value(part, k) for _, part, _ in series)] for k in kept]
    thinner = "" if len(kept) == len(time) else f" {len(kept)} of {len(time)} instants."
    more = f" {left_out} more are among the values to download." if left_out else ""
    return Figure(
        identity=identity,
        title=f"The best answer: {shortened(scenario['name'], 60)}",
        caption=f"Found by {shortened(answer['solver'], 60)}, seed {answer['seed']}: "
        "states (lines) and controls (dashed steps, constant over an interval) over "
        f"time, simulated on the verified path.{thinner}{more}",
        chart=chart,
        columns=[shortened(name, 30) for name in header[: _MOST + 1]],
        rows=[[number(value, "") for value in row[: _MOST + 1]] for row in values],
        values=[header, *values],
    )


def _named(name: str, units: object) -> str:
    """Return a name with its unit, if the record has one."""
    unit = units.get(name, "") if isinstance(units, Mapping) else ""
    return with_unit(name, shortened(unit or "", 20))


def _panels(
    time: Sequence[Any],
    series: Sequence[tuple[str, Sequence[Any], int]],
    kept: Sequence[int],
) -> svg.Chart:
    """Return a chart with a panel for each series at the instants that are kept."""
    columns = min(_COLUMNS, len(series))
    drawn = []
    for k, (name, values, kind) in enumerate(series):
        row, column = divmod(k, columns)
        right, below = (column + 1) * _WIDE, (row + 1) * _HIGH
        points = [
            (time[i], value)
            for i in kept
            if is_number(time[i]) and is_number(value := _value(values, i))
        ]
        times, heights = np.array(points, dtype=float).reshape(-1, 2).T
        x = svg.axis_of(times, (right - _WIDE + 48, right - 14), margin=0.0)
        y = svg.axis_of(heights, (below - 30, below - _HIGH + 26))
        places = (x.at(times), y.at(heights))
        if kind == _CONTROL:
            places = svg.corners(*places)
        drawn += [
            svg.frame(x, y, title=shortened(name, 34), most=(4, 4), unit="s"),
            svg.line(*places, svg.look(kind), title=name),
        ]
    rows = -(-len(series) // columns)
    return svg.Chart(width=columns * _WIDE, height=rows * _HIGH, drawing="".join(drawn))


def _value(values: Sequence[Any], place: int) -> Any:
    """Return the value at an instant; the last control holds until the end."""
    return values[min(place, len(values) - 1)] if values else None
