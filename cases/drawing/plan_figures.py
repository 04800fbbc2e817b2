"""Plans of a run: their paths, their costs, their searches, and other optima found.

For a single plan the convergence is drawn: the search's best cost, and the plan's cost.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.cases.drawing.drawing import (
    COLOURS,
    MOST_NAMED,
    colour,
    escaped,
    line_style,
    make_logarithmic,
    name_lines,
    new_figure,
)
from swarmstart.cases.drawing.panels import Labels, Panel
from swarmstart.cases.drawing.slack import KnownAt, arguments_of, made_at
from swarmstart.cases.drawing.wording import KEPT
from swarmstart.cases.record.trajectory_arrays import new_plans
from swarmstart.ocp import (
    Fitness,
    Known,
    OptimalControlProblem,
    Plan,
    SearchReport,
    Trajectory,
)
from swarmstart.ocp.loop import ReferenceSignals
from swarmstart.ocp.rollout import NOTHING, shooting_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase

KnownOf = Callable[[int, int], Known]
"""(number of a step, of a problem) -> parameters and signals of the plan made there."""

MOST_PLANS = 40
"""Plans that are drawn, evenly chosen among all."""
FAR = 1e6
"""Multiple of the plan's cost above which a cost of the search is left out."""
KEEPING: dict[str, Any] = {
    "color": COLOURS[0], "lw": 1.4, "drawstyle": "steps-post",
    "label": "best of the search",
}  # fmt: skip
BREAKING: dict[str, Any] = KEEPING | {
    "color": "0.45", "ls": "--", "lw": 1.0,
    "label": "best of the search, while it breaks limits",
}  # fmt: skip
LEAST_SPAN = 1e-3
"""Least range of the axis of optima, as a part of the plan's cost."""
MOST_OPTIMA = 25
"""Local optima that are drawn, the cheapest first."""


def nothing_known(step: int, number: int) -> Known:
    """Return a Known without parameters and signals."""
    del step, number
    return NOTHING


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Flown:
    """A run with its plans.

    Attributes:
        problems: The one problem of all vehicles, or the problem of each, in the order
            of their states.
        trajectory: The run; each decision has a plan for each problem.
        labels: The words on the axes.
        known: Function from the number of a step, and of a problem, to the parameters
            and signals of the plan.
        true: For each problem a function from times to its first signals (those before
            the plans of other vehicles), as the simulated system has them. None in its
            place, or an empty sequence, means that they are those of the plans.
    """

    problems: tuple[OptimalControlProblem, ...]
    trajectory: Trajectory
    labels: Labels
    known: KnownOf
    true: Sequence[ReferenceSignals | None] = ()

    def signals_of(self, number: int) -> ReferenceSignals | None:
        """Return the signals of a problem as the simulated system has them.

        None means that they are those of the plans.
        """
        return self.true[number] if self.true else None

    def parts(self) -> Iterator[tuple[OptimalControlProblem, Trajectory, KnownAt]]:
        """Yield each problem with its own part of the run.

        The third value is a function: number of a step -> parameters and signals of the
        plan that was made at this step.
        """
        flight, nx, nu = self.trajectory, 0, 0
        for number, problem in enumerate(self.problems):
            rows = slice(nx, nx := nx + problem.model.nx)
            held = slice(nu, nu := nu + problem.model.nu)
            own = replace(
                flight,
                states=flight.states[rows],
                dense_states=flight.dense_states[rows],
                controls=flight.controls[held],
                decisions=tuple(
                    replace(d, plans=(d.plans[number],)) for d in flight.decisions
                ),
            )
            yield problem, own, self._known_of(number)

    def _known_of(self, number: int) -> KnownAt:
        def known(step: int) -> Known:
            return self.known(step, number)

        return known

    @property
    def fresh(self) -> NDArray[np.intp]:
        """Numbers of the steps in which anything was planned, shape (k,)."""
        if not self.trajectory.decisions:
            return np.empty(0, dtype=np.intp)
        return np.flatnonzero(new_plans(self.trajectory.decisions).any(axis=1))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PlanPath:
    """The path of one plan of one problem.

    Attributes:
        times: Times since the start of the flight, shape (nodes,) [s].
        states: States of one vehicle, or of several one after another, shape (nx,
            nodes).
    """

    times: Array
    states: Array


def plan_paths(flown: Flown) -> list[PlanPath]:
    """Return paths of plans at MOST_PLANS steps at most.

    If the run does not contain the states of a plan, they are computed.
    """
    steps = chosen(flown.fresh)
    paths = []
    for problem, flight, known in flown.parts():
        again: Fitness | None = None
        made, shooting = made_at(flight), shooting_of(problem)
        lowered, nx = shooting.lowered, problem.model.nx
        for step in steps:
            plan = flight.decisions[step].plans[0]
            if made[step] != step:
                continue  # At this step another vehicle planned.
            states = plan.states
            if not states.size:  # A record keeps none.
                # A few paths do not repay the compiling of machine code.
                again = again or Fitness(shooting, backend="casadi")
                start, at = arguments_of(lowered, plan, flight, int(step), known)
                states = again.states(plan.controls, start, at)
            end = lowered.end_time(states[:, 0])
            times = flight.times[step] + np.linspace(0.0, end, states.shape[1])
            # Further rows of the core are decided numbers and remembered values.
            own = lowered.as_stated(states)[:nx]
            paths.append(PlanPath(times=times, states=own))
    return paths


def chosen(steps: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return at most MOST_PLANS of some steps, evenly chosen, with first and last."""
    places = np.linspace(0, steps.size - 1, min(steps.size, MOST_PLANS))
    found: NDArray[np.intp] = steps[places.round().astype(int)]
    return found


def with_plans(
    panels: Sequence[Panel], paths: Sequence[PlanPath], *, name: str = "plans"
) -> list[Panel]:
    """Return panels of simulated states with plans as thin lines beneath.

    Args:
        panels: Panels of the states, as `panels_of` returns them.
        paths: The plans.
        name: Name of the thin lines.
    """
    count = len(panels)
    beneath: list[list[tuple[Array, Array]]] = [[] for _ in panels]
    for path in paths:
        for row, values in enumerate(path.states):
            beneath[row % count].append((path.times, values))
    return [
        replace(panel, beneath=lines, beneath_name=name)
        for panel, lines in zip(panels, beneath, strict=True)
    ]


def searches_figure(flown: Flown) -> "Figure | None":
    """Return a figure of each search's best cost over evaluations.

    None if no plan was searched.
    """
    labels, decisions = flown.labels, flown.trajectory.decisions
    plans = [
        (number, plan)
        for step in chosen(flown.fresh)
        for number, plan in enumerate(decisions[step].plans)
        if plan.search.history.size
    ]
    if not plans:
        return None
    figure = new_figure((7.0, 4.2))
    axes = figure.add_subplot()
    several = len(flown.problems) > 1
    for number, plan in plans:
        name = escaped(labels.vehicles[number]) if several else "best of each search"
        kept, broken = by_violation(
            labels.sign * plan.search.history, plan.search.violations
        )
        at, own = plan.search.evaluations, colour(number)
        axes.plot(
            at, kept, color=own, ls=line_style(number), lw=0.7, label=name,
            drawstyle="steps-post",
        )  # fmt: skip
        if np.isfinite(broken).any():
            axes.plot(at, broken, **BREAKING | {"lw": 0.5, "color": "0.6"})
    every = np.concatenate([plan.search.history for _, plan in plans])
    make_logarithmic(axes, labels.sign * every)
    axes.set(xlabel="evaluations", ylabel=labels.cost)
    axes.set_title(f"searches of {len(plans)} plans", fontsize="medium")
    axes.grid(alpha=0.3)
    name_lines(figure)
    return figure


def draw_costs(axes: "Axes", run: Flown) -> None:
    """Draw the cost of each plan over time; logarithmic if it spans decades."""
    labels, decisions = run.labels, run.trajectory.decisions
    times = run.trajectory.times[run.fresh]
    several = 1 < len(run.problems) <= MOST_NAMED
    every = []
    for number in range(len(run.problems)):
        plans = [decisions[step].plans[number] for step in run.fresh]
        costs = labels.sign * np.array([plan.cost for plan in plans])
        name = escaped(labels.vehicles[number]) if several else "plan"
        axes.plot(
            times, costs, marker=".", color=colour(number), ls=line_style(number),
            lw=1.2, ms=4, label=name,
        )  # fmt: skip
        bad = np.array([not plan.feasible for plan in plans])
        if bad.any():
            axes.plot(times[bad], costs[bad], "kx", ms=6, label="infeasible plan")
        every.append(costs)
    axes.set(xlabel="time [s]", ylabel=f"{labels.cost} of the plan")
    make_logarithmic(axes, np.concatenate(every), ratio=20.0)
    axes.grid(alpha=0.3)


def draw_convergence(part: "FigureBase", plan: Plan, labels: Labels) -> None:
    """Draw the best cost of a plan's search over evaluations, and the plan's cost.

    While the best point breaks limits, its cost says little and is dashed; the
    violation has an axis of its own beneath.

    Args:
        part: A figure, or a part of one, that is empty.
        plan: The plan, with a search.
        labels: The words.
    """
    search, cost = plan.search, labels.sign * plan.cost
    kept, broken = by_violation(labels.sign * search.history, search.violations)
    beneath: Axes | None = None
    if (search.violations > KEPT).any():
        axes, beneath = part.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    else:
        axes = part.subplots()
    most = FAR * max(abs(cost), 1.0)
    marker = "." if search.history.size == 1 else None
    for values, style in ((broken, BREAKING), (kept, KEEPING)):
        drawn = np.where(np.abs(values) <= most, values, np.nan)
        if not np.isnan(drawn).all():
            axes.plot(search.evaluations, drawn, marker=marker, **style)
    axes.axhline(cost, color=COLOURS[1], ls="--", lw=1.2, label=f"plan, {cost:.5g}")
    axes.set_ylabel(labels.cost)
    shown = np.concatenate([kept, broken])
    make_logarithmic(axes, np.append(shown[np.abs(shown) <= most], cost))
    axes.set_title(_left_out(kept, broken, most), fontsize="small", loc="right")
    axes.grid(alpha=0.3)
    # At least 1: limits that coincide make matplotlib warn.
    axes.set_xlim(0, search.evaluations.max(initial=1))
    if beneath is not None:
        _draw_violations(beneath, search)
        axes.tick_params(labelbottom=False)
    (beneath or axes).set_xlabel("evaluations")


def _left_out(kept: Array, broken: Array, most: float) -> str:
    """Return what a panel of costs does not show, in words; empty if it shows all."""
    words = []
    if not np.isfinite(kept).any():
        words.append("no point of the search kept all limits")
    every = np.abs(np.concatenate([kept, broken]))
    far = every[np.isfinite(every) & (every > most)]
    if far.size:
        words.append(f"costs beyond the axis: up to {far.max():.3g}")
    return "; ".join(words)


def _draw_violations(axes: "Axes", search: SearchReport) -> None:
    """Draw how much the best point breaks limits; what breaks none is left out."""
    violations = np.where(search.violations > KEPT, search.violations, np.nan)
    marker = "." if np.isfinite(violations).sum() == 1 else None
    axes.plot(search.evaluations, violations, marker=marker, **BREAKING)
    make_logarithmic(axes, violations, ratio=10.0)
    axes.set_ylabel("violation\n(scaled)")
    axes.grid(alpha=0.3)


def by_violation(costs: Array, violations: Array) -> tuple[Array, Array]:
    """Return costs of points that keep all limits, and costs of the others.

    Args:
        costs: Costs of the best point after each generation, shape (n,).
        violations: Violations of that point, same shape. Another shape means that they
            are not known; no point then counts as breaking a limit.

    Returns:
        Two arrays of shape (n,), with NaN in place of costs that belong to the other
        array. After each stretch of points that break limits, the next cost is in both
        arrays, since the line of that stretch ends there.
    """
    if violations.shape != costs.shape:
        return costs, np.full(costs.shape, np.nan)
    breaks = violations > KEPT
    # One further: the last step of a line lasts until the next generation.
    until = breaks | np.append(False, breaks)[:-1]
    return np.where(breaks, np.nan, costs), np.where(until, costs, np.nan)


def optima_of(plan: Plan) -> tuple[Array, Array]:
    """Return costs of the distinct local optima, and how many starts ended in each.

    If the optima were not counted, the feasible answers of the local solver from its
    starts are returned instead, with the number 1 each.

    Returns:
        Costs, as minimised, ascending, and numbers of starts that ended there, shape
        (optima,) each.
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
    """Draw the costs of the local optima that a plan knows, the cheapest first."""
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
        # Costs that differ by rounding alone must not look far apart.
        low, high = axes.get_ylim()
        missing = max(0.0, LEAST_SPAN * abs(cost) - (high - low)) / 2
        axes.set_ylim(low - missing, high + missing)
        # Whole costs at the ticks, instead of differences to a number in the corner.
        axes.ticklabel_format(axis="y", useOffset=False)
    axes.grid(alpha=0.3)
