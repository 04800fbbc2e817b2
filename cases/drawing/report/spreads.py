"""Figures with a row or a mark for each solver: costs, seconds, ranks, false claims."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from swarmstart.cases.drawing import palette
from swarmstart.cases.drawing.drawing import colour
from swarmstart.cases.drawing.page import cleaned
from swarmstart.cases.drawing.report import svg
from swarmstart.cases.drawing.report.curves import FLOOR
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

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Chart

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
    chart, axes = _rows([row["solver"] for row in rows], numbers, right=_COUNTS)
    for level, (row, at) in enumerate(zip(rows, placed, strict=True)):
        _strip(axes, level, row["solver"], at, numbers[row["solver"]])
    if is_far:
        svg.make_logarithmic(axes.xaxis, ticks=6)
    elif best is not None:
        axes.axvline(best, **svg.TARGET)
    axes.set_xlabel("gap to the best known (relative)" if is_far else label)
    return Figure(
        identity=identity, title=f"Spread over seeds: {_title(scenario)}",
        caption=f"Verified {'value' if sense == -1 else 'cost'} of each feasible run "
        "(dots, one a seed; their height within a row means nothing), middle half "
        f"(box) and median (bar); right: feasible runs of all. Budget {budget}. "
        f"{_axis_in_words(is_far)}",
        chart=chart, follows="levels",
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
    chart, axes = svg.new_chart()
    for row in rows:
        place, share, name = row["seconds_p50"], rate(row) or 0.0, row["solver"]
        style = svg.series_style(numbers[name])
        ends = row["near_intervals"]
        if ends is not None and all(is_number(end) for end in ends[0]):
            axes.plot([place] * 2, ends[0], **{**style, "marker": None})
        told = f"{name}: {number(place, digits=4)} s, {percent(share)}"
        axes.plot(
            place, share, label=svg.label_of_series(name), gid=svg.titled(told), **style
        )
    axes.set(title="success rate", xlabel="seconds a run (median)", ylim=(-0.03, 1.03))
    axes.margins(x=0.08)
    svg.make_logarithmic(axes.xaxis)
    svg.name_series(chart)
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
        chart=chart,
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
    """Return mean ranks over scenarios, the best first; None if there are none."""
    given = sorted(
        (rank for rank in content["ranks"] if is_number(rank["mean"])),
        key=lambda rank: rank["mean"],
    )
    if not given:
        return None
    chart, axes = _rows([rank["solver"] for rank in given], numbers)
    for level, rank in enumerate(given):
        style = svg.series_style(numbers[rank["solver"]])
        if is_number(rank["low"]) and is_number(rank["high"]):
            ends = [rank["low"], rank["high"]]
            axes.plot(ends, [level] * 2, **{**style, "marker": None})
        axes.plot(rank["mean"], level, gid=svg.titled(rank["solver"]), **style)
    axes.update_datalim([(1, 0)])
    axes.set_xlabel("mean rank (1 is the best)")
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
        chart=chart, follows="levels",
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
    chart, axes = _rows([name for name, *_ in totals], numbers)
    page = palette.LIGHT_PAGE
    for level, (_, runs, _, claimed, false) in enumerate(totals):
        honest = max(claimed - false, 0)
        for kind, count, left, look in (
            ("confirmed", honest, 0, {"color": colour(3)}),
            ("refused", false, honest, {"fc": page["ground"], "ec": page["bad"],
                                        "lw": 2.5, "ls": (0, (3, 2))}),
        ):  # fmt: skip
            told = svg.titled(f"{kind}: {count} of {runs}")
            width, begin = 100 * count / runs, 100 * left / runs
            if count:  # Nothing is not an edge.
                axes.barh(level, width, 0.7, left=begin, gid=told, **look)
    axes.set(xlim=(0, 100), xlabel="per cent of all runs")
    return Figure(
        identity="judged", title="Claimed and verified, all scenarios",
        caption="Runs whose claim was confirmed along the whole path on a grid ten "
        "times finer (plain), and false successes (dashed edge): claimed feasible but "
        "not confirmed, or a claimed cost off by more than "
        f"{percent(content['near'][0])}. The rest claimed nothing, or failed.",
        chart=chart, follows="levels",
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


def _rows(
    names: Sequence[str], numbers: Mapping[str, int], *, right: float = _END
) -> "tuple[Chart, Axes]":
    """Return a chart with a row for each solver, its name and mark left of it."""
    chart, axes = svg.new_chart(
        height=_ROW * len(names) + _BELOW + _ABOVE,
        margins=(_NAMES, right, _BELOW, _ABOVE),
    )
    words = [cleaned(shortened(name, _LETTERS)) for name in names]
    axes.set_yticks(range(len(names)), words, color="black")
    axes.set_ylim(len(names) - 0.5, -0.5)  # The first one is on top.
    axes.tick_params(axis="y", length=0, pad=22)
    axes.grid(visible=False, axis="y")
    axes.use_sticky_edges = False
    for level, name in enumerate(names):
        style = {**svg.series_style(numbers[name]), "ls": "none"}
        place = axes.get_yaxis_transform()
        axes.plot(-0.03, level, transform=place, clip_on=False, **style)
    return chart, axes


def _strip(
    axes: "Axes", level: int, name: str, part: Sequence[float | None], series: int
) -> None:
    """Draw one solver's row: box, median, dots, number of feasible runs."""
    known = [(seed, cost) for seed, cost in enumerate(part) if cost is not None]
    whole = f"{len(known)} of {len(part)}"
    place = axes.get_yaxis_transform()
    axes.text(1.26, level, whole, transform=place, ha="right", va="center")
    if not known:
        return
    left, half, right = (quantile(part, q) or 0.0 for q in (0.25, 0.5, 0.75))
    own = colour(series)
    axes.barh(level, right - left, 0.77, left=left, fc=(own, 0.12), ec=own)
    svg.draw_dots(
        axes,
        [(cost, level + 0.54 * ((seed * _GOLDEN) % 1 - 0.5)) for seed, cost in known],
        lw=5.5, alpha=0.6, ec=own,
        gid=svg.titled(f"{name}: median {number(half)}, {whole} feasible"),
    )  # fmt: skip
    axes.plot([half] * 2, [level - 0.38, level + 0.38], color="black", lw=3)


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


def _title(scenario: Mapping[str, Any]) -> str:
    return shortened(scenario["name"], 60)
