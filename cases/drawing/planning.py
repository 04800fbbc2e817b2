"""Planning over a closed-loop run: wall time of each step, and source of each plan.

The sources are shown by colours whose lightness differs, so that they survive grey
print, and by letters where a stretch of equal steps is long enough.
"""

import itertools
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.cases.drawing.drawing import (
    COLOURS,
    HALF,
    MOST_NAMED,
    escaped,
    make_logarithmic,
    named_lines,
    put_legend,
)
from swarmstart.cases.record.trajectory_arrays import new_plans
from swarmstart.ocp import Mode, Source, Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

Codes = NDArray[np.intp]


class Kind(NamedTuple):
    """A source of the control of a step: its name, letter and colour."""

    name: str
    letter: str
    colour: str


KINDS = (
    Kind("terminal law", "T", "#fff3b0"),
    Kind("earlier plan goes on", "e", "#cfd6de"),
    Kind("given plan", "g", "#a9b4a0"),
    Kind("warm start", "W", "#8cc2ea"),
    Kind("search", "S", "#e0812e"),
    Kind("polish", "P", "#2a63b0"),
    Kind("no feasible plan: last one shifted", "!", "#2b0611"),
)
TERMINAL, EARLIER, GIVEN, WARM, SEARCH, POLISH, SHIFTED = range(len(KINDS))
_OF_SOURCE = {
    Source.GUESS: WARM, Source.SEARCH: SEARCH, Source.POLISH: POLISH,
    Source.COLD: WARM, Source.LANES: POLISH, Source.SHIFTED: SHIFTED,
    Source.LINEAR: TERMINAL, Source.COMMITTED: EARLIER,
}  # fmt: skip
MOST_STEPS = 400
"""Number of steps whose times are all drawn; of more, neighbours are summed up."""
_DARK = (POLISH, SHIFTED)
_LETTER, _LETTER_ROWS = 0.025, 8
"""Part of the run that a stretch with a letter has at least; most rows with letters."""


def sources_of(trajectory: Trajectory, given: Collection[int] = ()) -> Codes:
    """Return the source of each step of each planner as an index into KINDS.

    Args:
        trajectory: The run.
        given: Numbers of planners that carry out plans given to them.

    Returns:
        Indices, shape (planners, T).
    """
    decisions = trajectory.decisions
    fresh = new_plans(decisions)
    codes = np.array(
        [
            [
                _kind_of(decision.mode, plan.source, is_new, number in given)
                for number, (plan, is_new) in enumerate(
                    zip(decision.plans, fresh[step], strict=True)
                )
            ]
            for step, decision in enumerate(decisions)
        ],
        dtype=np.intp,
    )
    return codes.T


def _kind_of(mode: Mode, source: Source, is_new: bool, is_given: bool) -> int:
    if mode is Mode.LINEAR:
        return TERMINAL
    if is_given:
        return GIVEN
    return _OF_SOURCE[source] if is_new else EARLIER


def draw_planning(
    part: "FigureBase",
    trajectory: Trajectory,
    *,
    names: Sequence[str] = ("",),
    given: Collection[int] = (),
) -> None:
    """Draw the computing time of each step, and below it the sources of its plans.

    Args:
        part: A figure, or a part of one, that is empty.
        trajectory: The run, with decisions.
        names: Names of the planners. If there are more or fewer names than planners,
            the planners are numbered instead.
        given: Numbers of planners that carry out plans given to them.
    """
    codes = sources_of(trajectory, given)
    if len(names) != len(codes):
        names = [str(number) for number in range(1, len(codes) + 1)]
    rows = min(len(codes), MOST_NAMED)
    above, strip = part.subplots(
        2, 1, sharex=True, height_ratios=(3.0, max(0.5, 0.24 * rows))
    )
    draw_step_times(above, trajectory)
    if len(codes) > MOST_NAMED:
        draw_shares(strip, trajectory.times, codes)
    else:
        draw_strip(strip, trajectory.times, codes, names)
    above.tick_params(labelbottom=False)
    strip.set_xlabel("time [s]")
    _name_kinds(part, codes)


def draw_step_times(axes: "Axes", trajectory: Trajectory) -> None:
    """Draw the wall time of planning each step against the control interval dt."""
    seconds, lengths = trajectory.step_seconds, np.diff(trajectory.times)
    dt = float(lengths.mean())
    _draw_seconds(axes, trajectory.times, seconds)
    # Differences of times are equal up to rounding only.
    name = f"dt, {dt:g} s" if np.ptp(lengths) <= 1e-6 * dt else "dt"
    axes.stairs(
        lengths, trajectory.times, baseline=None, color=COLOURS[1], ls="--", lw=1.3,
        label=name,
    )  # fmt: skip
    axes.set_ylabel("wall time of a step [s]")
    make_logarithmic(axes, np.concatenate([seconds, lengths]), ratio=20.0)
    if axes.get_yscale() == "linear":
        axes.set_ylim(0.0, 1.08 * float(max(seconds.max(), lengths.max())))
    axes.set_xlim(*trajectory.times[[0, -1]])
    middle, most = float(np.median(seconds)), float(seconds.max())
    axes.set_title(
        f"median {middle:.3g} s, largest {most:.3g} s", fontsize="small", loc="right"
    )
    axes.grid(alpha=0.3)


def _draw_seconds(axes: "Axes", times: Array, seconds: Array) -> None:
    """Draw a line, or of very many steps the median and the range of neighbours."""
    own = COLOURS[0]
    if seconds.size <= MOST_STEPS:
        axes.stairs(
            seconds, times, baseline=None, color=own, lw=1.3, label="time to plan"
        )
        return
    begins = np.linspace(0, seconds.size, MOST_STEPS // 4 + 1).astype(int)
    groups = [seconds[a:b] for a, b in itertools.pairwise(begins)]
    low, middle, high = np.array(
        [(one.min(), np.median(one), one.max()) for one in groups]
    ).T
    edges = times[begins]
    axes.stairs(
        high, edges, baseline=low, fill=True, color=own, alpha=0.3,
        label="range of neighbouring steps",
    )  # fmt: skip
    axes.stairs(middle, edges, baseline=None, color=own, lw=1.3, label="their median")


def draw_strip(axes: "Axes", times: Array, codes: Codes, names: Sequence[str]) -> None:
    """Draw a row for each planner, coloured by the source of each step's plan.

    Args:
        axes: The panel.
        times: Ends of the steps, shape (T + 1,) [s].
        codes: Indices into KINDS, shape (planners, T).
        names: Names of the planners.
    """
    from matplotlib.colors import ListedColormap

    colours = ListedColormap([kind.colour for kind in KINDS])
    edges = np.arange(len(codes) + 1)
    # Halves: each code lies in the middle of its colour.
    axes.pcolormesh(times, edges, codes, cmap=colours, vmin=-0.5, vmax=len(KINDS) - 0.5)
    axes.set_ylim(len(codes), 0)  # The first planner is on top.
    for edge in edges[1:-1]:
        axes.axhline(edge, color="white", lw=1.0)
    axes.set_yticks(
        edges[:-1] + 0.5, [escaped(name) for name in names], fontsize="small"
    )
    axes.tick_params(axis="y", length=0)
    if len(codes) <= _LETTER_ROWS:
        for row, own in enumerate(codes):
            _write_letters(axes, times, own, row + 0.5)


def _write_letters(axes: "Axes", times: Array, codes: Codes, height: float) -> None:
    """Write the letter of each stretch of equal steps that is long enough."""
    begins = [0, *(np.flatnonzero(np.diff(codes)) + 1)]
    for begin, end in zip(begins, [*begins[1:], codes.size], strict=True):
        wide = times[end] - times[begin]
        if wide >= _LETTER * (times[-1] - times[0]):
            kind = int(codes[begin])
            axes.text(
                (times[begin] + times[end]) / 2, height, KINDS[kind].letter,
                ha="center", va="center", fontsize="x-small",
                color="white" if kind in _DARK else "black",
            )  # fmt: skip


def draw_shares(axes: "Axes", times: Array, codes: Codes) -> None:
    """Draw how many planners had plans from each source, if there are many planners.

    Args:
        axes: The panel.
        times: Ends of the steps, shape (T + 1,) [s].
        codes: Indices into KINDS, shape (planners, T).
    """
    begun = np.zeros(codes.shape[1])
    for number, kind in enumerate(KINDS):
        ended = begun + (codes == number).sum(axis=0)
        if (ended > begun).any():
            axes.stairs(ended, times, baseline=begun, fill=True, color=kind.colour)
        begun = ended
    axes.set(ylim=(0, len(codes)), ylabel="UAVs")


def _name_kinds(part: "FigureBase", codes: Codes) -> None:
    from matplotlib.patches import Patch

    kinds = [KINDS[k] for k in np.unique(codes)]
    patches = {
        f"{kind.letter}  {kind.name}": Patch(facecolor=kind.colour, edgecolor="0.4")
        for kind in kinds
    }
    put_legend(part, named_lines(part) | patches, room=HALF)
