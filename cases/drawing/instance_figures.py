"""Figure of many instances: the cost over the data that differ between them."""

from typing import TYPE_CHECKING

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.drawing import COLOURS, escaped, name_lines, new_figure
from swarmstart.ocp import Solutions, SolutionStatus

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PLANE = 2
"""Data of a plane."""
_SIZE = 18
"""Size of a mark [points squared]."""
_FAILURES = {
    "not confirmed": (SolutionStatus.BROKEN, SolutionStatus.MISMATCH),
    "infeasible": (SolutionStatus.INFEASIBLE, SolutionStatus.NOT_FINITE),
    "not solved": (SolutionStatus.INVALID, SolutionStatus.NOT_REACHED),
}
_MARKS = "x", "v", "s"


def draw_solutions(solutions: Solutions) -> "Figure":
    """Return a figure of the cost over the first two data that differ.

    Colours show the cost if two of the data are on the axes. If only one of the data
    differs, the cost is on the vertical axis; if none differs, the cost is drawn over
    the number of the instance. If the cost is on the vertical axis, failures are drawn
    at their cost, or at the least confirmed cost if theirs is not finite.

    Args:
        solutions: The answers.
    """
    figure = new_figure((7.0, 4.5))
    axes = figure.subplots()
    (x_name, x), *others = varied(solutions)[:_PLANE]
    confirmed, cost = solutions.is_confirmed, solutions.cost
    if others:
        ((y_name, y),) = others
        drawn = axes.scatter(x[confirmed], y[confirmed], c=cost[confirmed], s=_SIZE)
        figure.colorbar(drawn, ax=axes, label="cost")
    else:
        y_name, least = "cost", cost[confirmed].min(initial=np.inf)
        y = np.where(np.isfinite(cost), cost, least if np.isfinite(least) else 0.0)
        axes.scatter(x[confirmed], y[confirmed], s=_SIZE, color=COLOURS[0])
    axes.set_xlabel(escaped(x_name))
    axes.set_ylabel(escaped(y_name))
    for mark, (name, statuses) in zip(_MARKS, _FAILURES.items(), strict=True):
        chosen = np.array([one in statuses for one in solutions.status])
        if chosen.any():
            label = f"{name}: {chosen.sum()}"
            axes.scatter(
                x[chosen],
                y[chosen],
                s=_SIZE,
                color=COLOURS[1],
                marker=mark,
                label=label,
            )
    title = f"cost of {solutions.data.size} instances, {confirmed.sum()} confirmed"
    axes.set_title(title, fontsize="medium")
    name_lines(figure)
    return figure


def varied(solutions: Solutions) -> list[tuple[str, Array]]:
    """Return names and values of the data that differ, or else the instances' numbers.

    Args:
        solutions: The answers.
    """
    data = solutions.data
    found = [
        (name, row)
        for name, row in zip(data.names, data.numbers, strict=True)
        if (row != row[0]).any()
    ]
    return found or [("instance", np.arange(data.size, dtype=np.float64))]
