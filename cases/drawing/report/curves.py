"""Curves of a comparison: convergence, targets reached, performance profile."""

import bisect
from collections.abc import Mapping, Sequence
from typing import Any

from swarmstart.cases.drawing.report import svg
from swarmstart.cases.drawing.report.figure import Figure
from swarmstart.cases.drawing.wording import (
    is_number,
    listed,
    number,
    percent,
    shortened,
    stated_cost,
)
from swarmstart.cases.format.document import counted

FLOOR = 1e-6  # The least gap that is drawn; IPOPT's own tolerance is 1e-8.

Curve = tuple[list[float], list[Any], list[Any], list[Any]]
"""Places, middle, low and high of a curve; a missing value is null."""


def convergence(
    scenario: Mapping[str, Any],
    *,
    numbers: Mapping[str, int],
    identity: str,
    budget: str,
    near: Sequence[float],
    points: int,
) -> Figure | None:
    """Return a figure of the best answer over evaluations; None without a history.

    The figure shows the gap to the best known cost on a logarithmic axis, or the cost
    itself if the best known cost is missing or zero.
    """
    best = scenario["best_cost"]
    is_gap = is_number(best) and abs(best) > 0
    sense = scenario["sense"]
    curves = {
        row["solver"]: _curve(row["history"], best if is_gap else None, sense)
        for row in scenario["rows"]
        if row["history"] is not None
    }
    curves = {solver: curve for solver, curve in curves.items() if curve[0]}
    if not curves:
        return None
    runs = max(row["runs"] for row in scenario["rows"])
    caption = (
        f"The best feasible answer so far, median (line), lowest and highest (band) of "
        f"{counted(runs, 'seed')} at most, over evaluations worth one rollout; budget "
        f"{budget}. "
        + (
            f"Gaps below {FLOOR:g} are drawn there; dotted: within "
            f"{listed([percent(share) for share in near])} of the best known cost."
            if is_gap
            else "No cost is known that differs from zero: no gap is drawn."
        )
    )
    return _curves(
        curves, numbers, across="evaluations", points=points,
        targets=near if is_gap else (), scale="log" if is_gap else "linear",
        label="gap to the best known cost (relative)" if is_gap else _word(sense),
        identity=identity, title=f"Convergence: {title_of(scenario)}", caption=caption,
    )  # fmt: skip


def reached(
    scenario: Mapping[str, Any],
    *,
    numbers: Mapping[str, int],
    identity: str,
    budget: str,
    points: int,
) -> Figure | None:
    """Return a figure of the share of target costs reached over evaluations.

    None if no solver has such a curve.
    """
    curves = {
        row["solver"]: _known(
            row["ecdf"]["evaluations"],
            row["ecdf"]["share"],
            row["ecdf"]["low"],
            row["ecdf"]["high"],
        )
        for row in scenario["rows"]
        if row["ecdf"] is not None
    }
    curves = {name: curve for name, curve in curves.items() if curve[0]}
    if not curves:
        return None
    return _curves(
        curves, numbers, label="share of targets reached", across="evaluations",
        points=points, identity=identity,
        title=f"Targets reached: {title_of(scenario)}",
        caption="Share of pairs of a seed and a target (51 costs, spaced "
        "logarithmically towards the best known one) reached after so many "
        "evaluations, with a band from resampling the seeds (bootstrap). "
        f"Budget {budget}. Higher and further left is better.",
    )  # fmt: skip


def without_profile(content: Mapping[str, Any]) -> str:
    """Return why a comparison has no performance profile; empty if it has one."""
    if len(content["scenarios"]) == 1:
        return (
            "There is no performance profile: it shows on how many scenarios a solver "
            "is near the quickest, and this is one."
        )
    if content["profile"] is None or not content["profile"]["curves"]:
        return (
            "There is no performance profile: no solver came within "
            f"{percent(content['near'][0])} of the best known cost on a scenario that "
            "all have run."
        )
    return ""


def profile(
    content: Mapping[str, Any], *, numbers: Mapping[str, int], points: int
) -> Figure | None:
    """Return a figure of the performance profile over all scenarios.

    None if the comparison has no profile.
    """
    if without_profile(content):
        return None
    given = content["profile"]
    ratios = given["ratios"]
    curves = {
        name: _known(ratios, curve["share"], curve["low"], curve["high"])
        for name, curve in given["curves"].items()
    }
    curves = {name: curve for name, curve in curves.items() if curve[0]}
    if not curves:
        return None
    quantity = given["quantity"]
    return _curves(
        curves, numbers, label="share of scenarios and seeds",
        across=f"times the {quantity} of the quickest", points=points,
        identity="profile", title="Performance profile",
        caption=f"Share of pairs of a scenario and a seed that a solver brings within "
        f"{percent(content['near'][0])} of the best known cost with at most so many "
        f"times the {quantity} of the quickest solver there (Dolan and Moré, 2002); "
        f"{len(content['scenarios'])} scenarios, {len(content['seeds'])} seeds, budget "
        f"{content['budget_text']}; bands from resampling (bootstrap). At 1: how often "
        "it is the quickest; far right: how often it gets there at all.",
    )  # fmt: skip


def _curve(history: Mapping[str, Any], best: float | None, sense: int) -> Curve:
    """Return the curve of a history: gaps to the best cost, or costs if it is None."""
    ends = ("median", "low", "high")
    if best is None and sense == -1:  # The band's ends change places with the sign.
        ends = ("median", "high", "low")
    told = [
        [
            stated_cost(v, sense) if best is None else _gap(v, best)
            for v in history["cost"][k]
        ]
        for k in ends
    ]
    return _known(history["evaluations"], *told)


def _curves(  # noqa: PLR0913
    curves: Mapping[str, Curve],
    numbers: Mapping[str, int],
    *,
    label: str,
    across: str,
    points: int,
    identity: str,
    title: str,
    caption: str,
    targets: Sequence[float] = (),
    scale: str = "share",
) -> Figure:
    """Return a figure of step curves with bands over one logarithmic axis.

    The scale of the vertical axis is "log", "linear" or "share", which is from 0 to 1.
    """
    places = [place for curve in curves.values() for place in curve[0]]
    x = svg.axis_of(places, svg.ACROSS, is_log=True, margin=0.015)
    y = _upright(curves, scale)
    bands, lines = zip(
        *(
            _drawn(x, y, curve, numbers[name], points, title=name)
            for name, curve in curves.items()
        ),
        strict=True,
    )
    many = " many" if len(curves) > _MANY else ""  # Their bands are fainter.
    levels = [float(y.at(target)) for target in targets if y.low < target < y.high]
    ends = f"{x.low:.6g} {x.high:.6g} {x.start} {x.end} {y.end} {y.start}"
    chart = svg.Chart(
        width=svg.WIDTH,
        height=svg.HEIGHT,
        drawing=svg.frame(x, y, title=label, label=across)
        + f'<g class="curves{many}">{"".join((*bands, *lines))}</g>'
        + "".join(svg.drawn(f"M{x.start} {at:.1f}H{x.end}", "target") for at in levels),
        follows=f' data-across="log {ends}"',
    )
    names = list(curves)
    asked = _asked(places, points)
    rows = [
        [number(place, digits=4), *(_told(curves[name], place) for name in names)]
        for place in asked
    ]
    values: list[list[Any]] = [
        [across, *(f"{name} {part}" for name in names for part in _PARTS)]
    ]
    values += [
        [place, *(value for name in names for value in _at(curves[name], place))]
        for place in asked
    ]
    return Figure(
        identity=identity, title=title, caption=caption, columns=[across, *names],
        chart=chart, rows=rows, values=values,
    )  # fmt: skip


def _upright(curves: Mapping[str, Curve], scale: str) -> svg.Axis:
    """Return the vertical axis of a scale that holds the curves and their bands."""
    if scale == "share":
        return svg.Axis(low=0.0, high=1.0, start=svg.UP[0], end=svg.UP[1])
    heights = [v for curve in curves.values() for part in curve[1:] for v in part]
    return svg.axis_of(heights, svg.UP, is_log=scale == "log")


def _drawn(
    x: svg.Axis, y: svg.Axis, curve: Curve, series: int, points: int, *, title: str
) -> tuple[str, str]:
    """Return a solver's band, and its line of steps with marks."""
    kept = svg.thinned(len(curve[0]), points)
    at = x.at(curve[0])[kept]
    middle, low, high = (y.at(part)[kept] for part in curve[1:])
    along, lower = svg.corners(at, low)
    band = svg.outline(along, lower, svg.corners(at, high)[1])
    # Marks of different series at different places, or they cover each other.
    marked = {*range(series % 3 + 1, len(at), max(6, len(at) // 4)), len(at) - 1}
    few, look = sorted(marked), svg.look(series)
    step_line = svg.line(*svg.corners(at, middle), look, title=title)
    return (
        svg.drawn(band, f"area {look}"),
        step_line + svg.marks(at[few], middle[few], series),
    )


_MANY = 5  # Bands; more of them, one over the other, hide the lines.
_PARTS = ("middle", "low", "high")


def _known(
    places: Sequence[Any],
    middle: Sequence[Any],
    low: Sequence[Any],
    high: Sequence[Any],
) -> Curve:
    """Return the part of a curve with a middle; it replaces missing ends."""
    kept = [
        (float(place), float(a), b if is_number(b) else a, c if is_number(c) else a)
        for place, a, b, c in zip(places, middle, low, high, strict=False)
        if is_number(place) and place > 0 and is_number(a)  # The axis is logarithmic.
    ]
    columns = [list(part) for part in zip(*kept, strict=True)] or [[], [], [], []]
    return columns[0], columns[1], columns[2], columns[3]


def _at(curve: Curve, place: float) -> list[float | None]:
    """Return middle, low and high at a place; nothing outside the curve."""
    # 1e-9: ratios that should be equal may differ by rounding.
    k = bisect.bisect_right(curve[0], place * (1 + 1e-9)) - 1
    if k < 0 or place > curve[0][-1] * (1 + 1e-9):
        return [None, None, None]
    return [part[k] for part in curve[1:]]


def _told(curve: Curve, place: float) -> str:
    middle, low, high = _at(curve, place)
    if middle is None:
        return ""
    if low == middle == high:
        return number(middle, digits=4)
    return f"{number(middle, digits=4)} ({_short(low)} to {_short(high)})"


def _short(value: object) -> str:
    return number(value, digits=3)


def _asked(places: Sequence[float], points: int) -> list[float]:
    """Return the places of the table of values: those of all curves, thinned."""
    whole = sorted(set(places))
    return [whole[k] for k in svg.thinned(len(whole), points)]


def _gap(cost: object, best: float) -> float | None:
    """Return the relative gap to the best known cost, at least the floor."""
    if not is_number(cost):
        return None
    return max((float(cost) - best) / abs(best), FLOOR)  # type: ignore[arg-type]


def _word(sense: object) -> str:
    return "value (the more, the better)" if sense == -1 else "cost"


def title_of(scenario: Mapping[str, Any]) -> str:
    """Return a scenario's name, at most 60 letters long."""
    return shortened(scenario["name"], 60)
