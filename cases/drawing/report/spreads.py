"""Figures with a row or a mark for each solver: costs, seconds, ranks, false claims."""

from collections.abc import Mapping, Sequence
from typing import Any

from swarmstart.cases.drawing.report import svg
from swarmstart.cases.drawing.report.curves import BOTTOM, FLOOR, RIGHT, TOP
from swarmstart.cases.drawing.report.figure import Figure
from swarmstart.cases.drawing.report.svg import Axis
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

_NAMES = 180.0  # Where rows begin, right of the solvers' names.
_ROW = 26.0
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
    """Return each seed's verified cost, by solver; None if no run was feasible."""
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
    x = svg.axis_over(
        # 84 at the right end are for the numbers of feasible runs.
        [place for part in placed for place in part], _NAMES, RIGHT - 84,
        label="gap to the best known (relative)" if is_far else label, is_log=is_far,
    )  # fmt: skip
    levels, bottom = _levels(len(rows))
    parts = [svg.frame(x, _upright(bottom), has_y_ticks=False, tick_gap=62)]
    if best is not None and not is_far:
        parts.append(svg.stroke([(x.at(best), TOP), (x.at(best), bottom)], "target"))
    table = []
    for row, part, at, level in zip(rows, found, placed, levels, strict=True):
        table.append(_summary(row["solver"], part))
        parts.append(_strip(row["solver"], at, numbers[row["solver"]], x, level))
    return Figure(
        identity=identity, title=f"Spread over seeds: {_title(scenario)}",
        caption=f"Verified {'value' if sense == -1 else 'cost'} of each feasible run "
        "(dots, one a seed; their height within a row means nothing), middle half "
        f"(box) and median (bar); right: feasible runs of all. Budget {budget}. "
        f"{_axis_in_words(is_far)}",
        chart="".join(parts), height=round(bottom + 50), levels=levels,
        columns=["solver", "runs", "feasible", "lowest", "quarter", "median",
                 "three quarters", "highest"],
        rows=table, values=_by_seed(rows, found, sense),
    )  # fmt: skip


def seconds_and_success(
    content: Mapping[str, Any],
    scenario: Mapping[str, Any],
    *,
    numbers: Mapping[str, int],
    identity: str,
) -> Figure | None:
    """Return success rates over median seconds; None if no row has both."""
    rows = [
        row
        for row in scenario["rows"]
        if is_number(row["seconds_p50"])
        and row["seconds_p50"] > 0
        and rate(row) is not None
    ]
    if not rows:
        return None
    x = svg.axis_over(
        [row["seconds_p50"] for row in rows], 64, RIGHT, is_log=True, margin=0.08,
        label="seconds a run (median)",
    )  # fmt: skip
    y = Axis(low=-0.03, high=1.03, start=BOTTOM, end=TOP, label="success rate")
    parts = [svg.frame(x, y)]
    for row in rows:
        place, share = x.at(row["seconds_p50"]), rate(row) or 0.0
        name = row["solver"]
        ends = row["near_intervals"]
        if ends is not None and all(is_number(end) for end in ends[0]):
            whisker = [(place, y.at(end)) for end in ends[0]]
            parts.append(svg.line(whisker, numbers[name], "", is_step=False))
        told = f"{name}: {number(row['seconds_p50'], digits=4)} s, {percent(share)}"
        parts.append(svg.mark(place, y.at(share), numbers[name], told))
    noisy = (
        " The machine was busy with other work: compare no seconds."
        if content["is_noisy"]
        else ""
    )
    return Figure(
        identity=identity, title=f"Seconds and success: {_title(scenario)}",
        caption=f"Share of runs that are feasible and within "
        f"{percent(content['near'][0])} of the best known cost, with Wilson's 95 % "
        "interval, over the solver's own seconds (without building and compiling). "
        f"Budget {content['budget_text']}. Higher and further left is better.{noisy}",
        chart="".join(parts),
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
        legend=[(numbers[row["solver"]], row["solver"]) for row in rows],
    )  # fmt: skip


def ranks(content: Mapping[str, Any], *, numbers: Mapping[str, int]) -> Figure | None:
    """Return mean ranks over scenarios, the best first; None if there are none."""
    given = sorted(
        (rank for rank in content["ranks"] if is_number(rank["mean"])),
        key=lambda rank: rank["mean"],
    )
    if not given:
        return None
    levels, bottom = _levels(len(given))
    ends = [rank[end] for rank in given for end in ("low", "mean", "high")]
    x = svg.axis_over([1, *ends], _NAMES, RIGHT, label="mean rank (1 is the best)")
    parts = [svg.frame(x, _upright(bottom), has_y_ticks=False)]
    for rank, level in zip(given, levels, strict=True):
        series, middle = numbers[rank["solver"]], level + _ROW / 2
        parts.append(_name(rank["solver"], series, middle))
        if is_number(rank["low"]) and is_number(rank["high"]):
            whisker = [(x.at(rank["low"]), middle), (x.at(rank["high"]), middle)]
            parts.append(svg.line(whisker, series, rank["solver"], is_step=False))
        parts.append(svg.mark(x.at(rank["mean"]), middle, series, rank["solver"]))
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
        chart="".join(parts), height=round(bottom + 50), levels=levels,
        columns=["solver", "mean rank", "low", "high"], rows=told,
        values=[["solver", "mean", "low", "high"]] + [
            [rank["solver"], rank["mean"], rank["low"], rank["high"]] for rank in given
        ],
    )  # fmt: skip


def judged(content: Mapping[str, Any], *, numbers: Mapping[str, int]) -> Figure | None:
    """Return, by solver, runs confirmed, claimed in vain, and without a claim."""
    totals = claims_by_solver(content)
    if not totals:
        return None
    levels, bottom = _levels(len(totals))
    x = Axis(low=0.0, high=100.0, start=_NAMES, end=RIGHT, label="per cent of all runs")
    parts = [svg.frame(x, _upright(bottom), has_y_ticks=False)]
    for total, level in zip(totals, levels, strict=True):
        name, runs, _, claimed, false = total
        parts.append(_name(name, numbers[name], level + _ROW / 2))
        honest = max(claimed - false, 0)
        at = 0.0
        for count, kind in ((honest, "confirmed"), (false, "refused")):
            width = 100.0 * count / runs
            if width:
                begin, end = x.at(at), x.at(min(at + width, 100.0))
                parts.append(
                    f'<rect class="{kind}" x="{begin:.1f}" y="{level + 4:.1f}" '
                    f'width="{end - begin:.1f}" height="{_ROW - 8:.0f}">'
                    f"<title>{kind}: {count} of {runs}</title></rect>"
                )
            at += width
    return Figure(
        identity="judged", title="Claimed and verified, all scenarios",
        caption="Runs whose claim was confirmed along the whole path on a grid ten "
        "times finer (plain), and false successes (dashed edge): claimed feasible but "
        "not confirmed, or a claimed cost off by more than "
        f"{percent(content['near'][0])}. The rest claimed nothing, or failed.",
        chart="".join(parts), height=round(bottom + 50), levels=levels,
        columns=["solver", "runs", "feasible", "claimed feasible", "false successes"],
        rows=[[name, *(str(count) for count in rest)] for name, *rest in totals],
        values=[["solver", "runs", "feasible", "claimed_feasible", "false_successes"],
                *totals],
    )  # fmt: skip


def claims_by_solver(
    content: Mapping[str, Any],
) -> list[tuple[str, int, int, int, int]]:
    """Return name, runs, feasible, claimed and false successes, over all scenarios."""
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


def _strip(
    name: str, part: Sequence[float | None], series: int, x: Axis, level: float
) -> str:
    """Return one solver's row: name, box, median, dots, number of feasible runs."""
    middle = level + _ROW / 2
    known = [(seed, cost) for seed, cost in enumerate(part) if cost is not None]
    whole = f"{len(known)} of {len(part)}"
    end = svg.words_at(RIGHT, middle + 4, whole, anchor="end")
    if not known:
        return _name(name, series, middle) + end
    half = quantile(part, 0.5)
    left, bar, right = (x.at(quantile(part, q) or 0.0) for q in (0.25, 0.5, 0.75))
    dots = [
        (x.at(cost), middle + 14 * ((seed * _GOLDEN) % 1 - 0.5)) for seed, cost in known
    ]
    # At least half a unit: a box without a width is not drawn.
    box = (
        f'<rect class="box s{series % svg.SERIES}" x="{left:.1f}" y="{level + 3:.1f}" '
        f'width="{max(right - left, 0.5):.1f}" height="{_ROW - 6:.0f}"/>'
    )
    half_line = [(bar, level + 3), (bar, level + _ROW - 3)]
    return (
        _name(name, series, middle)
        + box
        + svg.dots(dots, series, f"{name}: median {number(half)}, {whole} feasible")
        + svg.stroke(half_line, "median")
        + end
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


def _name(name: str, series: int, middle: float) -> str:
    """Return a solver's name and mark, left of its row."""
    mark = svg.mark(_NAMES - 12, middle, series)
    words = shortened(name, _LETTERS)
    return mark + svg.words_at(_NAMES - 22, middle + 4, words, anchor="end", name="n")


def _away(value: float, best: float | None) -> float:
    """Return the gap of a cost or value, at least the smallest one drawn."""
    return max(abs(value - best) / abs(best), FLOOR) if best else 0.0


def _levels(rows: int) -> tuple[list[float], float]:
    """Return the tops of the rows, and the chart's bottom."""
    return [TOP + _ROW * k for k in range(rows)], TOP + _ROW * rows


def _upright(bottom: float) -> Axis:
    return Axis(low=0.0, high=1.0, start=bottom, end=TOP)


def _title(scenario: Mapping[str, Any]) -> str:
    return shortened(scenario["name"], 60)
