"""Small panels over time for the player: lines, held steps, bounds.

Matplotlib draws them; the player's script adds a cursor, and the value there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing import palette
from swarmstart.cases.drawing.drawing import COLOURS, draw_series
from swarmstart.cases.drawing.panels import Panel, bounds_of
from swarmstart.cases.drawing.report import svg
from swarmstart.cases.drawing.report.tracks import Series, Tracks
from swarmstart.cases.drawing.wording import number
from swarmstart.cases.format.document import counted

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE, MARGINS = (300, 140), (48, 6, 22, 22)
"""Width and height of a panel; its margins left, right, below and above."""
MOST_POINTS = 300
ALL_POINTS = 30_000
"""Of the lines of all panels together."""
_DECADES = 30.0
"""Of positive values, largest to smallest, from which on their axis is logarithmic."""
_LEVEL: dict[str, Any] = {
    "color": palette.LIGHT_PAGE["ink-soft"],
    "ls": (0, (5, 3)),
    "lw": 1.2,
}


@dataclass(frozen=True, kw_only=True, slots=True)
class PanelDrawn:
    """A panel as the player takes it.

    Attributes:
        alt: The panel in words.
        drawing: What is within its `svg` element.
        has_bounds: Whether bounds are drawn.
        far: Bounds too far away to be drawn, in words; empty: there are none.
        times: Times [s] of the values to be told; empty: they are not.
        values: These.
        held: Whether they are held.
    """

    alt: str
    drawing: "Markup"
    has_bounds: bool = False
    far: str = ""
    times: Sequence[float | None] = ()
    values: Sequence[float | None] = ()
    held: bool = False


def series_panels(tracks: Tracks) -> list[PanelDrawn]:
    """Return a panel for each state and control of a flight."""
    lines = max(1, len(tracks.series) * len(tracks.vehicles))
    most = min(MOST_POINTS, max(60, ALL_POINTS // lines))
    with svg.page_style():
        return [_series_panel(one, tracks, most) for one in tracks.series]


def _series_panel(one: Series, tracks: Tracks, most: int) -> PanelDrawn:
    times, values = reduced(one.times, one.values, most)
    values = np.where(np.isfinite(values), values, np.nan)
    label = f"{one.name} [{one.unit}]" if one.unit else one.name
    figure, axes = new_panel(label, end=float(tracks.times[-1]))
    draw_series(axes, times, values)
    lower, upper = np.array([one.lower]), np.array([one.upper])
    near, far = bounds_of(
        Panel(label=label, times=times, values=values, lower=lower, upper=upper)
    )
    for bound, _ in near:
        axes.axhline(bound, **_LEVEL)
    alone = len(values) == 1
    return PanelDrawn(
        drawing=_markup(figure),
        has_bounds=bool(near),
        far=f"{one.name} {' and '.join(map(_told, far))}" if far else "",
        times=rounded(times, 5) if alone else (),
        values=rounded(values[0], 4) if alone else (),
        held=one.is_held,
        alt=_range_told(label, values[np.isfinite(values)]),
    )


def solver_panel(tracks: Tracks, *, name: str = "flight") -> PanelDrawn | None:
    """Return the solver's time of each step beside the length of the step.

    None if one plan is carried out to its end: nothing is solved on the way.

    Args:
        tracks: The flight.
        name: A word that no other player of the page has, for ids.
    """
    seconds = tracks.step_seconds
    if tracks.is_one_plan or not seconds.size or not np.isfinite(seconds).any():
        return None
    lengths = np.diff(tracks.step_times)
    # Peaks, not samples: the slowest step must be seen.
    times, values = _peaks(tracks.step_times, np.maximum(seconds, 0.0), MOST_POINTS)
    positive = values[np.isfinite(values) & (values > 0)]
    each = float(np.median(lengths))
    every = np.append(positive, each)
    # A logarithmic axis has no place for 0.
    drawn = np.maximum(values, every.min())
    # Differences of times are equal up to rounding only.
    is_even = np.allclose(lengths, each, rtol=1e-6)
    said = f"dt = {_told(each)} s" if is_even else f"median dt = {_told(each)} s"
    late = int((seconds > lengths).sum())
    with svg.page_style():
        figure, axes = new_panel(
            "solver's time a step [s]", end=float(tracks.times[-1])
        )
        axes.stairs(drawn, times, baseline=None, color=COLOURS[0], lw=1.7)
        axes.axhline(each, **_LEVEL)
        where = np.flatnonzero(tracks.without_plan)[:MOST_POINTS]
        if where.size:
            failed = np.maximum(seconds[where], every.min())
            axes.plot(
                tracks.step_times[where], failed, "x", mew=1.8, ms=6,
                color=palette.LIGHT_PAGE["bad"],
            )  # fmt: skip
        if every.max() > _DECADES * every.min():
            svg.make_logarithmic(axes.yaxis, ticks=4)
        else:
            axes.set_ylim(bottom=0.0)
        is_high = axes.transData.transform((0, each))[1] > SIZE[1] - MARGINS[3] - 14
        axes.annotate(
            said, (1, each), xycoords=axes.get_yaxis_transform(), ha="right",
            xytext=(-2, -13 if is_high else 4), textcoords="offset points",
            fontsize=11, color=palette.LIGHT_PAGE["ink-soft"],
        )  # fmt: skip
        drawing = _markup(figure, salt=name)
    return PanelDrawn(
        drawing=drawing,
        times=rounded(times, 5),
        values=rounded(values, 3),
        held=True,
        alt=f"Solver's time of each step: median {_told(float(np.median(seconds)))} s,"
        f" longest {_told(float(np.nanmax(seconds)))} s; {said}; {late} of "
        f"{counted(seconds.size, 'step')} took longer than the step itself.",
    )


def new_panel(label: str, *, end: float, begin: float = 0.0) -> "tuple[Figure, Axes]":
    """Return an empty panel over a span of time [s]."""
    figure, axes = svg.new_chart(width=SIZE[0], height=SIZE[1], margins=MARGINS)
    axes.set_title(svg.label_of_series(label))
    axes.set_xlim(begin, end if end > begin else begin + 1.0)
    axes.margins(y=0.06)
    axes.tick_params(labelsize=11)
    axes.locator_params(nbins=4, steps=(1, 2, 5, 10))
    # In place of the last tick, which may be at the edge.
    axes.locator_params(axis="x", prune="upper")
    axes.set_xlabel("s", loc="right", labelpad=-11, fontsize=11)
    return figure, axes


def _markup(figure: "Figure", *, salt: str = "") -> "Markup":
    from markupsafe import Markup

    return Markup(svg.as_svg(figure, salt=salt))


def _told(value: float) -> str:
    return number(value, digits=4)


def reduced(times: Array, values: Array, most: int) -> tuple[Array, Array]:
    """Return at most about `most` of the instants, the first and the last among them.

    Args:
        times: Shape (n,), or (n + 1,) where values are held.
        values: Shape (rows, n).
        most: Instants.
    """
    count = values.shape[1]
    if count <= most:
        return times, values
    places = np.unique(np.linspace(0, count - 1, most).round().astype(int))
    if times.size == count:
        return times[places], values[:, places]
    return np.append(times[places], times[-1]), values[:, places]


def _peaks(times: Array, values: Array, most: int) -> tuple[Array, Array]:
    """Return held values over fewer, longer intervals: the largest of each."""
    count = values.size
    if count <= most:
        return times, values
    begins = np.unique(np.linspace(0, count, most + 1).astype(int)[:-1])
    return np.append(times[begins], times[-1]), np.maximum.reduceat(values, begins)


def rounded(values: Array, digits: int) -> list[float | None]:
    """Return numbers with a few digits; None for one that is not finite."""
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in values]


def _range_told(label: str, finite: Array) -> str:
    if not finite.size:
        return f"{label} over time: no finite value."
    return (
        f"{label} over time: from {_told(float(finite.min()))} to "
        f"{_told(float(finite.max()))}."
    )
