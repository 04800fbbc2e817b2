"""Phase plane: the second state over the first one, with marks of time."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from swarmstart.cases.drawing.drawing import colour, line_style
from swarmstart.cases.drawing.panels import BOUND, Labels, Panel, bounds_of
from swarmstart.cases.drawing.plan_figures import PlanPath
from swarmstart.cases.drawing.series import escaped
from swarmstart.cases.drawing.tracks import label_times, mark_times

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_phase_plane(
    axes: "Axes",
    first: Panel,
    second: Panel,
    plans: Sequence[PlanPath],
    labels: Labels,
) -> None:
    """Draw the second state of each vehicle against its first, with marks of time.

    Args:
        axes: The panel.
        first: The first state.
        second: The second state.
        plans: Drawn thin beneath.
        labels: The words.
    """
    for plan in plans:
        for x, y in zip(plan.states[::2], plan.states[1::2], strict=True):
            axes.plot(x, y, color="0.6", lw=0.6, zorder=1, label="plans")
    marks = mark_times(first.times)
    at = [int(np.argmin(np.abs(first.times - mark))) for mark in marks]
    for number, (x, y) in enumerate(zip(first.values, second.values, strict=True)):
        own = colour(number)
        name = escaped(labels.vehicles[number]) if labels.are_named else None
        axes.plot(x, y, color=own, ls=line_style(number), lw=1.4, label=name)
        axes.plot(x[0], y[0], "o", color=own, fillstyle="none", label="start")
        axes.plot(x[-1], y[-1], "s", color=own, ms=5, label="end")
        axes.plot(x[at], y[at], ".", color=own, ms=5)
    for panel, line in ((first, axes.axvline), (second, axes.axhline)):
        for bound, own in bounds_of(panel)[0]:
            line(bound, color=own, ls=":", lw=1.4, label=BOUND)
    places = np.stack([first.values[0, at], second.values[0, at]])
    label_times(axes, marks, places)
    axes.set(xlabel=escaped(first.label), ylabel=escaped(second.label))
    axes.grid(alpha=0.3)
