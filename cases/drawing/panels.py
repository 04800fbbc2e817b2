"""Small panels over time, one for each quantity: lines, held steps, and bounds."""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.drawing import (
    MOST_NAMED,
    colour,
    draw_series,
    escaped,
    name_lines,
    new_figure,
)
from swarmstart.cases.drawing.tails import tail_from, tail_in_words
from swarmstart.cases.drawing.wording import with_unit
from swarmstart.ocp import OptimalControlProblem

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase


MOST_PANELS = 24
"""Panels of one kind in a figure; a sentence says that there are more."""
FAR = 10.0
"""Largest distance of a bound that is drawn from the values, in ranges of these."""
BOUND, SHARED = "bound", "0.25"
"""Name of a bound in a legend, and the colour of one that all vehicles share."""
_MARGIN = 0.06
"""Part of the axis that is grey beyond a bound at its end."""
_LINE_WIDTH, _MOST_LINES = 22, 3
_SMALL = 16
"""Characters of a line from which on a label is small."""
_ROUNDING_S = 1e-9
"""By which a time may be off."""
_COLUMNS = ((3, 1), (8, 2), (15, 3))
"""(panels, columns): up to so many panels in so many columns; four beyond."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Labels:
    """Words on the axes, and how rows belong to vehicles.

    Attributes:
        states: Name of each state of one vehicle.
        controls: Name of each control of one vehicle.
        units: Unit by name; a quantity without a unit is missing.
        vehicles: Name of each vehicle; states and controls come vehicle after vehicle.
        numbers: Number of each vehicle's colour; None means from 0 on.
        maximize: Whether the user maximises; costs are then the maximised values times
            -1.
        ends: Times at which phases end, without the last phase [s].
        spans: Suffix that names of a phase's constraints end in -> number of the
            phase's first interval, and number of the first interval after the phase.
    """

    states: Sequence[str] = ()
    controls: Sequence[str]
    units: Mapping[str, str] = field(default_factory=dict)
    vehicles: Sequence[str] = ("",)
    numbers: Sequence[int] | None = None
    maximize: bool = False
    ends: Sequence[float] = ()
    spans: Mapping[str, tuple[int, int]] = field(default_factory=dict)

    def of(self, name: str) -> str:
        """Return a name with its unit, as an axis shows it."""
        return with_unit(name, self.units.get(name, ""))

    @property
    def cost(self) -> str:
        """Return the name of the cost."""
        return "objective" if self.maximize else "cost"

    @property
    def sign(self) -> float:
        """Factor by which a cost is multiplied to be drawn."""
        return -1.0 if self.maximize else 1.0

    @property
    def are_named(self) -> bool:
        """Return whether a legend names the vehicles."""
        return 1 < len(self.vehicles) <= MOST_NAMED


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class MovingBound:
    """A bound that changes over time.

    Attributes:
        times: Instants, shape (n,) [s]; one at which it jumps occurs twice.
        values: Values at these instants, shape (n,).
        is_upper: Whether it bounds from above.
    """

    times: Array
    values: Array
    is_upper: bool


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Panel:
    """One quantity of all vehicles.

    Attributes:
        label: Label of the vertical axis.
        times: Instants, shape (n,) [s], or (n + 1,) if values are held from each to the
            next.
        values: Values of each vehicle, shape (vehicles, n).
        lower: Lower bounds, shape (vehicles,), -inf for no bound.
        upper: Upper bounds, shape (vehicles,), inf for no bound.
        moving: Bounds that change over time.
        beneath: Times and values of each thin line that is drawn beneath the values.
        beneath_name: Name of the thin lines.
        rest: Words on how much of the time is shown; empty if all of it is.
    """

    label: str
    times: Array
    values: Array
    lower: Array
    upper: Array
    moving: Sequence[MovingBound] = ()
    beneath: Sequence[tuple[Array, Array]] = ()
    beneath_name: str = "plans"
    rest: str = ""

    def until(self, end: float, rest: str) -> "Panel":
        """Return the panel up to a time [s]; held values are kept for whole intervals.

        Args:
            end: The time [s].
            rest: Words on how much of the time is shown.
        """
        held = self.times.size - self.values.shape[1]  # 1 or 0.
        last = end - _ROUNDING_S if held else end + _ROUNDING_S
        count = int(np.searchsorted(self.times, last))
        instants = count + held
        return replace(
            self,
            times=self.times[:instants],
            values=self.values[:, :count],
            moving=[
                replace(one, times=one.times[near], values=one.values[near])
                for one in self.moving
                if (near := one.times < end + _ROUNDING_S).any()
            ],
            beneath=[
                (times[near], values[near])
                for times, values in self.beneath
                if (near := times < end + _ROUNDING_S).any()
            ],
            rest=rest,
        )


def without_tails(*blocks: Sequence[Panel]) -> list[list[Panel]]:
    """Return blocks of panels without the end of the run if nothing happens there.

    Nothing happens if every line in the panels goes on as a straight line.

    Args:
        blocks: Panels of one run.
    """
    every = [panel for block in blocks for panel in block]
    begin = tail_from((p.times[: p.values.shape[1]], p.values) for p in every)
    if begin is None:
        return [list(block) for block in blocks]
    rest = tail_in_words(begin, float(every[0].times[-1]))
    return [[panel.until(begin, rest) for panel in block] for block in blocks]


def panels_of(
    names: Sequence[str],
    labels: Labels,
    times: Array,
    values: Array,
    limits: tuple[Array, Array] | None = None,
) -> list[Panel]:
    """Return a panel for each name.

    Args:
        names: Names of the quantities of one vehicle.
        labels: Words on the axes.
        times: Instants as in `Panel`.
        values: Values, vehicle after vehicle, shape (vehicles * names, n).
        limits: Lower and upper bounds, each (vehicles * names,); None means no bounds.
    """
    if limits is None:
        free = np.full(len(values), np.inf)
        limits = -free, free
    count = len(names)  # Vehicle after vehicle: each count-th row is one quantity.
    lower, upper = limits
    return [
        Panel(
            label=labels.of(name),
            times=times,
            values=values[row::count],
            lower=lower[row::count],
            upper=upper[row::count],
        )
        for row, name in enumerate(names)
    ]


def stacked_limits(
    problems: Sequence[OptimalControlProblem],
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return (lower, upper) of the states, and of the controls, of all problems."""
    states, controls = (
        tuple(np.concatenate(side) for side in zip(*limits, strict=True))
        for limits in (
            [problem.state_limits for problem in problems],
            [problem.control_limits for problem in problems],
        )
    )
    return (states[0], states[1]), (controls[0], controls[1])


def panels_figure(blocks: Mapping[str, Sequence[Panel]], labels: Labels) -> "Figure":
    """Return a figure of blocks of panels below one another.

    Args:
        blocks: Name of a block ("states") -> its panels.
        labels: Words on the axes.
    """
    shown = {name: panels[:MOST_PANELS] for name, panels in blocks.items() if panels}
    figure, axes = grid([len(panels) for panels in shown.values()])
    for block, panels in zip(axes, shown.values(), strict=True):
        for place, panel in zip(block, panels, strict=True):
            draw_panel(place, panel, labels)
    more = [
        f"the first {MOST_PANELS} of {len(panels)} {name}"
        for name, panels in blocks.items()
        if len(panels) > MOST_PANELS
    ]
    rests = dict.fromkeys(p.rest for panels in shown.values() for p in panels if p.rest)
    title = f"{' and '.join(shown)} over time".capitalize()
    figure.suptitle("; ".join([title, *more, *rests]), fontsize="medium")
    name_lines(figure)
    return figure


def grid(counts: Sequence[int]) -> "tuple[Figure, list[list[Axes]]]":
    """Return a figure with blocks of panels that share the time axis.

    Each block begins a new row.

    Args:
        counts: Number of panels in each block.
    """
    figure = new_figure(grid_size(counts))
    return figure, grid_in(figure, counts, columns=columns_of(max(counts)))


def grid_size(counts: Sequence[int]) -> tuple[float, float]:
    """Return width and height of a figure of some panels [inches].

    Args:
        counts: Number of panels in each block.
    """
    columns = columns_of(max(counts))
    rows = sum(-(-count // columns) for count in counts)
    width, height = (7.0, 4.2, 3.5, 3.2)[columns - 1] * columns, 1.75 * rows
    return width, max(height, 2.4) + 0.8


def columns_of(panels: int) -> int:
    """Return the number of columns for a number of panels."""
    return next((c for least, c in _COLUMNS if panels <= least), 4)


def grid_in(
    figure: "FigureBase", counts: Sequence[int], *, columns: int
) -> "list[list[Axes]]":
    """Return blocks of axes that share the time axis, in a figure or a part of one.

    Args:
        figure: A figure, or a part of one.
        counts: Number of panels in each block.
        columns: Number of panels beside one another.
    """
    rows = [-(-count // columns) for count in counts]
    blocks: list[list[Axes]] = []
    first: Axes | None = None
    for number, count in enumerate(counts):
        block = []
        for k in range(count):
            place = sum(rows[:number]) * columns + k + 1
            axes = figure.add_subplot(sum(rows), columns, place, sharex=first)
            first = first or axes
            axes.grid(alpha=0.3)
            axes.margins(x=0)
            block.append(axes)
        blocks.append(block)
    _label_time(blocks, columns)
    return blocks


def _label_time(blocks: "list[list[Axes]]", columns: int) -> None:
    """Name the time below the last panel of each column."""
    last = dict((k % columns, axes) for block in blocks for k, axes in enumerate(block))
    for block in blocks:
        for k, axes in enumerate(block):
            if axes is last[k % columns]:
                axes.set_xlabel("time [s]")
            else:
                axes.tick_params(labelbottom=False)


def draw_panel(
    axes: "Axes", panel: Panel, labels: Labels, *, width: int = _LINE_WIDTH
) -> None:
    """Draw values as lines or held steps, and the bounds that are near the values.

    Args:
        axes: Axes of matplotlib to draw into.
        panel: Values and bounds of one quantity.
        labels: Words on the axes.
        width: Number of characters in a line of the vertical label.
    """
    for times, values in panel.beneath:
        axes.plot(
            times, values, color="0.6", lw=0.6, zorder=1, label=panel.beneath_name
        )
    for end in labels.ends:
        if end > panel.times[-1]:
            continue
        axes.axvline(end, color="0.6", ls="-.", lw=1.0, label="end of a phase")
    names = labels.vehicles if labels.are_named else ()
    draw_series(axes, panel.times, panel.values, names=names, numbers=labels.numbers)
    label = wrapped(panel.label, width=width)
    is_small = max(map(len, label.split("\n"))) > min(_SMALL, width - 4)
    axes.set_ylabel(label, fontsize="small" if is_small else None)
    draw_bounds(axes, panel)


def draw_bounds(axes: "Axes", panel: Panel) -> None:
    """Draw the bounds dotted and the space beyond them grey.

    Bounds so far away that the values would be hard to see are not drawn but named.
    If bounds differ between vehicles, each has the colour of its vehicle, and the space
    beyond it stays white.
    """
    near, far = bounds_of(panel)
    for bound, own in near:
        axes.axhline(bound, color=own, ls=":", lw=1.4, label=BOUND)
    moving = [(one, _near(panel, one)) for one in panel.moving]
    for one, values in moving:
        axes.plot(one.times, values, color=SHARED, ls=":", lw=1.4, label=BOUND)
    low, high = axes.get_ylim()
    margin, shared = _MARGIN * (high - low), (panel.lower[0], panel.upper[0])
    for bound, is_upper in zip(shared, (False, True), strict=True):
        if (bound, SHARED) in near:
            end = max(high, bound + margin) if is_upper else min(low, bound - margin)
            axes.axhspan(*sorted((bound, end)), color="0.5", alpha=0.18, lw=0)
            low, high = min(low, end), max(high, end)
    for one, values in moving:
        end = high + margin if one.is_upper else low - margin
        axes.fill_between(one.times, values, end, color="0.5", alpha=0.18, lw=0)
    axes.set_ylim(low, high)  # Without the margin that axhspan has asked for.
    if far:
        text = f"bounds beyond the axis: {', '.join(f'{b:g}' for b in far)}"
        axes.set_title(text, fontsize="x-small", loc="right", color="0.35")


def _near(panel: Panel, bound: MovingBound) -> Array:
    """Return the values of a moving bound; NaN for those that are not drawn."""
    least, most = _reach(panel)
    near = (least <= bound.values) & (bound.values <= most)
    return np.where(near, bound.values, np.nan)


def _reach(panel: Panel) -> tuple[float, float]:
    """Return the values between which a bound is drawn."""
    finite = panel.values[np.isfinite(panel.values)]
    least, most = (finite.min(), finite.max()) if finite.size else (0.0, 0.0)
    reach = FAR * (most - least) or np.inf  # A constant has no range to compare with.
    return float(least - reach), float(most + reach)


def bounds_of(panel: Panel) -> tuple[list[tuple[float, str]], list[float]]:
    """Return the finite bounds near the values with their colours, and those far away.

    A bound that all vehicles share is grey. If bounds differ, and there are more
    vehicles than colours, only the tightest and the widest bounds are returned, in
    grey.
    """
    least, most = _reach(panel)
    pairs = np.stack([panel.lower, panel.upper], axis=1)
    if (pairs == pairs[0]).all() or len(pairs) > MOST_NAMED:
        ends = [*pairs.min(axis=0), *pairs.max(axis=0)]
        every = [(float(bound), SHARED) for bound in np.unique(ends)]
    else:
        every = [
            (float(bound), colour(number))
            for number, pair in enumerate(pairs)
            for bound in np.unique(pair)
        ]
    every = [(bound, own) for bound, own in every if np.isfinite(bound)]
    near = [(b, own) for b, own in every if least <= b <= most]
    far = {b for b, _ in every} - {b for b, _ in near}
    return near, sorted(far)


def wrapped(label: str, *, width: int = _LINE_WIDTH) -> str:
    """Return a label broken into a few lines that fit beside or above a panel."""
    lines = textwrap.wrap(label, width, max_lines=_MOST_LINES, placeholder="...")
    return escaped("\n".join(lines))
