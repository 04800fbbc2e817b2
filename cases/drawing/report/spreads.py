"""Figures with a row or a mark for each solver: costs, seconds, ranks, false claims."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swarmstart.cases.drawing import palette
from swarmstart.cases.drawing.report import svg
from swarmstart.cases.drawing.report.curves import FLOOR, title_of
from swarmstart.cases.drawing.report.figure import Figure
from swarmstart.cases.drawing.wording import (
    NOT_FEASIBLE,
    NOT_MEASURED,
    interval,
    is_number,
    number,
    percent,
    quantile,
    rate,
    shortened,
    stated_cost,
)

_NAMES, _COUNTS, _END = 180, 98, 14  # Room left of rows, and right of them.
_ROW, _BELOW, _ABOVE = 26, 50, 8
_LETTERS = 20
_GOLDEN = 0.6180339887  # Spreads any number of seeds evenly over a row's height.
_FAR = 0.5  # A gap from which on costs are drawn as gaps, on a logarithmic axis.


def costs(
    scenario: Mapping[str, Any],
    *,
    numbers: Mapping[str, int],
    identity: str,
    budget: str,
) -> Figure | None:
    """Return a figure of verified costs by solver; None if no run was feasible."""
    sense = scenario["sense"]
    rows = scenario["rows"]
    found = [[stated_cost(cost, sense) for cost in row["costs"]] for row in rows]
    every = [cost for part in found for cost in part if cost is not None]
    if not every:
        return None
    best = stated_cost(scenario["best_cost"], sense)
    is_far = bool(best) and any(_away(cost, best) > _FAR for cost in every)
    placed = [_gaps(part, best) for part in found] if is_far else found
    label = "value (the more, the better)" if sense == -1 else "cost"
    label = "gap to the best known (relative)" if is_far else label
    names = [row["solver"] for row in rows]
    target = None if is_far else best
    x, drawn = _strips(names, numbers, placed, target, is_log=is_far)
    return Figure(
        identity=identity, title=f"Spread over seeds: {title_of(scenario)}",
        caption=f"Verified {'value' if sense == -1 else 'cost'} of each feasible run "
        "(dots, one a seed; their height within a row means nothing), middle half "
        f"(box) and median (bar); right: feasible runs of all. Budget {budget}. "
        f"{_axis_in_words(is_far)}",
        chart=_rows(names, numbers, x, label, drawn),
        columns=["solver", "runs", "feasible", "lowest", "quarter", "median",
                 "three quarters", "highest"],
        rows=[_summary(row["solver"], part)
              for row, part in zip(rows, found, strict=True)],
        values=_by_seed(rows, found, sense),
    )  # fmt: skip


def seconds_and_success(
    content: Mapping[str, Any],
    scenario: Mapping[str, Any],
    *,
    numbers: Mapping[str, int],
    identity: str,
) -> Figure | None:
    """Return a figure of success rates over median seconds; None if no row has both."""
    rows = [
        row
        for row in scenario["rows"]
        if is_number(row["seconds_p50"])
        and row["seconds_p50"] > 0
        and rate(row) is not None
    ]
    if not rows:
        return None
    places = [row["seconds_p50"] for row in rows]
    x = svg.axis_of(places, svg.ACROSS, is_log=True, margin=0.08)
    y = svg.Axis(low=-0.03, high=1.03, start=svg.UP[0], end=svg.UP[1])
    drawn = svg.frame(x, y, title="success rate", label="seconds a run (median)")
    for row, place in zip(rows, places, strict=True):
        name, share = row["solver"], rate(row) or 0.0
        ends = (row["near_intervals"] or [[None, None]])[0]
        told = f"{name}: {number(place, digits=4)} s, {percent(share)}"
        at = np.repeat(x.at(place), 2)
        drawn += svg.line(at, y.at(ends), svg.look(numbers[name]))
        drawn += svg.marks(at[:1], y.at([share]), numbers[name], title=told)
    noisy = (
        " The machine was busy with other work: compare no seconds."
        if content["is_noisy"]
        else ""
    )
    return Figure(
        identity=identity, title=f"Seconds and success: {title_of(scenario)}",
        caption=f"Share of runs that are feasible and within "
        f"{percent(content['near'][0])} of the best known cost, with Wilson's 95 % "
        "interval, over the solver's own seconds (without building and compiling). "
        f"Budget {content['budget_text']}. Higher and further left is better.{noisy}",
        chart=svg.Chart(width=svg.WIDTH, height=svg.HEIGHT, drawing=drawn),
        columns=["solver", "seconds (median)", "success rate", "95 % interval"],
        rows=[
            [shortened(row["solver"]), number(row["seconds_p50"], digits=4),
             percent(rate(row)), interval((row["near_intervals"] or [None])[0])]
            for row in rows
        ],
        values=[["solver", "seconds", "success_rate", "low", "high"]] + [
            [row["solver"], row["seconds_p50"], rate(row),
             *((row["near_intervals"] or [[None, None]])[0])]
            for row in rows
        ],
    )  # fmt: skip


def ranks(content: Mapping[str, Any], *, numbers: Mapping[str, int]) -> Figure | None:
    """Return a figure of mean ranks, the best first; None if there are no ranks."""
    given = sorted(
        (rank for rank in content["ranks"] if is_number(rank["mean"])),
        key=lambda rank: rank["mean"],
    )
    if not given:
        return None
    every = [rank[part] for rank in given for part in ("mean", "low", "high")]
    x = svg.axis_of([1.0, *every], (_NAMES, svg.WIDTH - _END))
    drawn = []
    for level, rank in enumerate(given):
        name, at = rank["solver"], np.repeat(_level(level), 2)
        ends = x.at([rank["low"], rank["high"]])
        drawn += [
            svg.line(ends, at, svg.look(numbers[name])),
            svg.marks(x.at([rank["mean"]]), at[:1], numbers[name], title=name),
        ]
    label = "mean rank (1 is the best)"
    chart = _rows([rank["solver"] for rank in given], numbers, x, label, drawn)
    told = [
        [rank["solver"], *(number(rank[k], digits=4) for k in ("mean", "low", "high"))]
        for rank in given
    ]
    return Figure(
        identity="ranks", title="Mean ranks over scenarios",
        caption=f"Rank of a solver's cost among all solvers, seed by seed, mean over "
        f"the seeds of each of {len(content['scenarios'])} scenarios, with the 95 % "
        "interval from resampling the scenarios (bootstrap). "
        f"Budget {content['budget_text']}.",
        chart=chart,
        columns=["solver", "mean rank", "low", "high"], rows=told,
        values=[["solver", "mean", "low", "high"]] + [
            [rank["solver"], rank["mean"], rank["low"], rank["high"]] for rank in given
        ],
    )  # fmt: skip


def judged(content: Mapping[str, Any], *, numbers: Mapping[str, int]) -> Figure | None:
    """Return a figure of the shares of confirmed answers and false claims by solver."""
    totals = claims_by_solver(content)
    if not totals:
        return None
    x = svg.Axis(low=0.0, high=100.0, start=_NAMES, end=svg.WIDTH - _END)
    drawn = []
    for level, (_, runs, _, claimed, false) in enumerate(totals):
        honest = max(claimed - false, 0)
        heights = (_level(level - 0.35), _level(level + 0.35))
        for kind, count, before in (
            ("confirmed", honest, 0), ("refused", false, honest)
        ):  # fmt: skip
            ends = x.at([100 * before / runs, 100 * (before + count) / runs]).tolist()
            told = f"{kind}: {count} of {runs}"
            if count:  # Nothing is not an edge.
                drawn.append(svg.drawn(svg.box(ends, heights), kind, title=told))
    label, names = "per cent of all runs", [name for name, *_ in totals]
    return Figure(
        identity="judged", title="Claimed and verified, all scenarios",
        caption="Runs whose claim was confirmed along the whole path on a grid ten "
        "times finer (plain), and false successes (dashed edge): claimed feasible but "
        "not confirmed, or a claimed cost off by more than "
        f"{percent(content['near'][0])}. The rest claimed nothing, or failed.",
        chart=_rows(names, numbers, x, label, drawn),
        columns=["solver", "runs", "feasible", "claimed feasible", "false successes"],
        rows=[[name, *(str(count) for count in rest)] for name, *rest in totals],
        values=[["solver", "runs", "feasible", "claimed_feasible", "false_successes"],
                *totals],
    )  # fmt: skip


def claims_by_solver(
    content: Mapping[str, Any],
) -> list[tuple[str, int, int, int, int]]:
    """Return a row for each solver with numbers of runs over all scenarios.

    A row has the name, and the numbers of runs, of feasible answers, of answers that
    the solver claims to be feasible, and of false claims.
    """
    parts = ("runs", "feasible", "claimed_feasible", "false_successes")
    totals: dict[str, list[int]] = {}
    for scenario in content["scenarios"]:
        for row in scenario["rows"]:
            total = totals.setdefault(row["solver"], [0] * len(parts))
            for place, part in enumerate(parts):
                total[place] += row[part] or 0
    return [
        (name, total[0], total[1], total[2], total[3])
        for name, total in totals.items()
        if total[0]
    ]


def _gaps(costs: Sequence[float | None], best: float | None) -> list[float | None]:
    """Return the gaps of costs to the best known; None if there is no cost."""
    return [None if cost is None else _away(cost, best) for cost in costs]


def _axis_in_words(is_far: bool) -> str:
    """Return what the axis shows."""
    if not is_far:
        return "Dotted: the best known."
    return (
        "The axis is the gap to the best known, since costs lie far apart; gaps "
        f"below {FLOOR:g} are drawn there."
    )


def _level(place: float) -> float:
    """Return the height of a row, the first one on top."""
    return _ABOVE + _ROW * (place + 0.5)


def _rows(
    names: Sequence[str],
    numbers: Mapping[str, int],
    x: svg.Axis,
    label: str,
    drawn: Sequence[str],
) -> svg.Chart:
    """Return a chart with a row for each solver, its name and mark left of it."""
    levels = np.array([_level(level) for level in range(len(names))])
    y = svg.Axis(low=0.0, high=1.0, start=_level(len(names) - 0.5), end=_ABOVE)
    heads = [
        svg.text(_NAMES - 22, level + 4.5, shortened(name, _LETTERS), anchor="end")
        + svg.marks(np.array([_NAMES - 11.0]), np.array([level]), numbers[name])
        for name, level in zip(names, levels, strict=True)
    ]
    places = " ".join(f"{level:.0f}" for level in levels)
    return svg.Chart(
        width=svg.WIDTH,
        height=y.start + _BELOW,
        drawing=svg.frame(x, y, label=label, most=(6, 0)) + "".join([*heads, *drawn]),
        follows=f' data-levels="{places}"',
    )


def _strips(
    names: Sequence[str],
    numbers: Mapping[str, int],
    placed: Sequence[Sequence[float | None]],
    target: float | None,
    *,
    is_log: bool,
) -> tuple[svg.Axis, list[str]]:
    """Return the axis, and the rows of all solvers with an upright line at a target."""
    every = [target, *(value for part in placed for value in part)]
    x = svg.axis_of(every, (_NAMES, svg.WIDTH - _COUNTS), is_log=is_log)
    drawn = [
        _strip(x, level, name, part, numbers[name])
        for level, (name, part) in enumerate(zip(names, placed, strict=True))
    ]
    if target is not None:
        upright = f"M{float(x.at(target)):.1f} {_ABOVE}V{_level(len(names) - 0.5)}"
        drawn.append(svg.drawn(upright, "target"))
    return x, drawn


def _strip(
    x: svg.Axis, level: int, name: str, part: Sequence[float | None], series: int
) -> str:
    """Return one solver's row: box, median, dots, number of feasible runs."""
    known = [(seed, cost) for seed, cost in enumerate(part) if cost is not None]
    whole = f"{len(known)} of {len(part)}"
    count = svg.text(svg.WIDTH - _END, _level(level) + 4.5, whole, anchor="end")
    if not known:
        return count
    quarters = [quantile(part, q) or 0.0 for q in (0.25, 0.5, 0.75)]
    left, half, right = x.at(quarters).tolist()
    own = f"s{series % len(palette.MARKS)}"
    heights = np.array(
        [_level(level + 0.54 * ((k * _GOLDEN) % 1 - 0.5)) for k, _ in known]
    )
    told = f"{name}: median {number(quarters[1])}, {whole} feasible"
    ends = (_level(level - 0.38), _level(level + 0.38))
    return (
        count
        + svg.drawn(svg.box((left, right), ends), f"box {own}")
        + svg.drawn(
            svg.dots(x.at([cost for _, cost in known]), heights),
            f"dots {own}",
            title=told,
        )
        + svg.drawn(f"M{half:.1f} {ends[0]:.1f}V{ends[1]:.1f}", "median")
    )


def _by_seed(
    rows: Sequence[Mapping[str, Any]], found: Sequence[Sequence[Any]], sense: object
) -> list[list[Any]]:
    """Return verified and claimed costs, a row for each seed."""
    heads = [f"{row['solver']} {k}" for row in rows for k in ("verified", "claimed")]
    claims = [[stated_cost(cost, sense) for cost in row["claimed"]] for row in rows]
    columns = [part for pair in zip(found, claims, strict=True) for part in pair]
    seeds = max(map(len, columns))
    return [["place of the seed", *heads]] + [
        [seed, *(part[seed] if seed < len(part) else None for part in columns)]
        for seed in range(seeds)
    ]


def _summary(name: str, part: Sequence[float | None]) -> list[str]:
    known = [cost for cost in part if cost is not None]
    missing = NOT_FEASIBLE if part else NOT_MEASURED
    told = [number(quantile(part, q), missing) for q in (0, 0.25, 0.5, 0.75, 1)]
    return [shortened(name), str(len(part)), str(len(known)), *told]


def _away(value: float, best: float | None) -> float:
    """Return the gap of a cost or value, at least the smallest one drawn."""
    return max(abs(value - best) / abs(best), FLOOR) if best else 0.0
