"""Convergence of one plan: the search's best cost, the plan's cost, other optima."""

from typing import TYPE_CHECKING

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.drawing import COLOURS
from swarmstart.cases.drawing.panels import Labels
from swarmstart.cases.drawing.series import make_logarithmic
from swarmstart.ocp import Plan

if TYPE_CHECKING:
    from matplotlib.axes import Axes


FAR = 1e6
"""Times the plan's cost from which on a cost of the search is left out."""
LEAST_SPAN = 1e-3
"""Of the plan's cost: an axis of optima shows at least so much."""
MOST_OPTIMA = 25
"""Local optima that are drawn, the cheapest first."""


def draw_convergence(axes: "Axes", plan: Plan, labels: Labels) -> None:
    """Draw the best cost of a plan's search over evaluations, and the plan's cost.

    Args:
        axes: The panel.
        plan: A plan that was searched.
        labels: The words.
    """
    costs, cost = labels.sign * plan.search.history, labels.sign * plan.cost
    name = "best of the search"
    if (plan.search.history[1:] > plan.search.history[:-1]).any():
        name += ", which may break constraints at first"
    far = np.isfinite(costs) & (np.abs(costs) > FAR * max(abs(cost), 1.0))
    if far.any():  # They belong to points that break the constraints.
        beyond = np.abs(costs[far]).max()
        text = f"costs of points that break limits beyond the axis: up to {beyond:.3g}"
        axes.set_title(text, fontsize="small", loc="right")
    drawn = np.where(far, np.nan, costs)
    axes.plot(
        plan.search.evaluations, drawn, color=COLOURS[0], lw=1.4, label=name,
        drawstyle="steps-post", marker="." if costs.size == 1 else None,
    )  # fmt: skip
    axes.axhline(cost, color=COLOURS[1], ls="--", lw=1.2, label=f"plan, {cost:.5g}")
    axes.set(xlabel="evaluations", ylabel=labels.cost)
    make_logarithmic(axes, np.append(drawn, cost))
    axes.set_xlim(0, plan.search.evaluations.max(initial=1))
    axes.grid(alpha=0.3)


def optima_of(plan: Plan) -> tuple[Array, Array]:
    """Return the costs of the distinct local optima found, and how many ended there.

    Without a count of optima the answers of the local solver from its starts are
    returned, each found once.

    Returns:
        Costs, which are minimised, ascending, and counts, each of shape (optima,).
    """
    if plan.starts is None:
        return np.empty(0), np.empty(0)
    lanes = plan.starts.lanes or plan.search.lanes
    if lanes is not None and lanes.optima:
        found = [(one.cost, one.count) for one in lanes.optima]
    else:
        found = sorted((one.cost, 1) for one in plan.starts.tried if one.feasible)
    pairs = np.array(found, dtype=float).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def draw_optima(axes: "Axes", plan: Plan, labels: Labels) -> None:
    """Draw the costs of the local optima found, the cheapest first.

    Args:
        axes: The panel.
        plan: A plan with optima.
        labels: The words.
    """
    from matplotlib.ticker import MaxNLocator

    costs, counts = optima_of(plan)
    shown = labels.sign * costs[:MOST_OPTIMA]
    rank = np.arange(1, shown.size + 1)
    sizes, name = np.full(shown.size, 50.0), "local optimum"
    if (counts > 1).any():
        sizes = 20 + 120 * np.sqrt(counts[: shown.size] / counts.max())
        name += ", larger: found more often"
    axes.scatter(
        rank, shown, s=sizes, facecolor="none", edgecolor=COLOURS[0], lw=1.4, label=name
    )
    if (counts > 1).any() and shown.size <= MOST_OPTIMA // 2:
        for place, value, count in zip(rank, shown, counts, strict=False):
            axes.annotate(
                f"{count:g}", (place, value), textcoords="offset points",
                xytext=(9, 4), fontsize="x-small",
            )  # fmt: skip
    cost = labels.sign * plan.cost
    axes.axhline(cost, color=COLOURS[1], ls="--", lw=1.2, label=f"plan, {cost:.5g}")
    left = costs.size - shown.size
    axes.set(xlabel="local optimum, by cost", ylabel=labels.cost)
    if left:
        text = f"the best {shown.size} of {costs.size}"
        axes.set_title(text, fontsize="small", loc="right")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlim(0.3, shown.size + 0.7)
    make_logarithmic(axes, np.append(shown, cost))
    if axes.get_yscale() == "linear":
        low, high = axes.get_ylim()
        missing = max(0.0, LEAST_SPAN * abs(cost) - (high - low)) / 2
        axes.set_ylim(low - missing, high + missing)
        axes.ticklabel_format(axis="y", useOffset=False)
    axes.grid(alpha=0.3)
