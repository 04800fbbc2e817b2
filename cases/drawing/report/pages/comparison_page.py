"""The page of a comparison: one HTML file that stays below 2 MB."""

from collections.abc import Mapping
from typing import Any

from swarmstart.cases.drawing.naming import wording
from swarmstart.cases.drawing.page import rendered
from swarmstart.cases.drawing.report import curves, rows, spreads, svg
from swarmstart.cases.drawing.report.figure import Figure
from swarmstart.cases.drawing.report.trajectory import trajectory

MOST_BYTES = 1_950_000
_MOST_DRAWN = 4000  # Points of all curves beyond which a page is surely too long.
_POINTS = (64, 32, 16, 10, 6)  # Of a curve: as many as the page's size allows.
_FEW = 10  # With so few, the table of all pairs is left out, too.


def comparison_page(content: Mapping[str, Any]) -> str:
    """Return the page of a comparison.

    Args:
        content: A record "comparison", schema 2: what `comparison.json` holds.

    Example:
        >>> import json, pathlib
        >>> file = pathlib.Path("comparison.json")
        >>> if file.exists():
        ...     page = comparison_page(json.loads(file.read_text()))
    """
    page = ""
    drawn = sum(len(scenario["rows"]) for scenario in content["scenarios"])
    for points in _POINTS:
        if points * drawn > _MOST_DRAWN and points > _POINTS[-1]:
            continue
        page = _page(content, points)
        if len(page.encode()) <= MOST_BYTES:
            break
    return page


def _page(content: Mapping[str, Any], points: int) -> str:
    from markupsafe import Markup

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
            "answer": trajectory(
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
            "marks": Markup(svg.marks_defined()),
            "summary": rows.summary(content),
            "summary_heads": rows.SUMMARY,
            "detail_heads": rows.DETAILS,
            "regression_heads": rows.REGRESSION,
            "regression": rows.regression(content),
            "scenarios": scenarios,
            "whole": [figure for figure in whole if figure is not None],
            "judged": spreads.judged(content, numbers=numbers),
            "has_pairs": points > _FEW,
            "seeds": wording.counted(len(content["seeds"]), "seed"),
            "near": [wording.percent(share) for share in content["near"]],
            "machines": [rows.machine_words(found) for found in content["machines"]],
            "number": wording.number,
            "percent": wording.percent,
            "shortened": wording.shortened,
        },
    )


def numbers_of(content: Mapping[str, Any]) -> dict[str, int]:
    """Return each solver's number, by which it has its colour, dashes and mark."""
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
