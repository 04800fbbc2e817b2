"""Figures of the plans of a flight: their cost, their paths, the time they took."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.drawing.drawing import COLOURS, MOST_NAMED, colour, new_figure
from swarmstart.cases.drawing.panels import (
    Labels,
    Panel,
    escaped,
    name_lines,
    panels_figure,
)
from swarmstart.cases.drawing.slack import KnownAt, arguments_of, made_at
from swarmstart.cases.record.trajectory_arrays import new_plans
from swarmstart.ocp import Fitness, Known, OptimalControlProblem, Trajectory
from swarmstart.ocp.fitness import NOTHING
from swarmstart.ocp.shooting import Shooting

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
KnownOf = Callable[[int, int], Known]
"""(number of a step, of a problem) -> parameters and signals of the plan made there."""

MOST_PLANS = 40
"""Plans that are drawn, evenly chosen among all."""
_RATIO = 100.0
"""Of positive values, largest to smallest, from which on their axis is logarithmic."""


def nothing_known(step: int, number: int) -> Known:
    """Return that a problem has neither parameters nor signals."""
    del step, number
    return NOTHING


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Flown:
    """A flight with what was planned in it.

    Attributes:
        problems: One of all vehicles, or that of each, in the order of their states.
        trajectory: The flight; each decision has a plan for each problem.
        labels: The words on the axes.
        known: Parameters and signals of the plans.
    """

    problems: tuple[OptimalControlProblem, ...]
    trajectory: Trajectory
    labels: Labels
    known: KnownOf

    def parts(self) -> Iterator[tuple[OptimalControlProblem, Trajectory, KnownAt]]:
        """Yield each problem with the rows of its model, and what is known in it."""
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
        times: Since the start of the flight, shape (nodes,) [s].
        states: Of one vehicle, or of several one after another, shape (nx, nodes).
    """

    times: Array
    states: Array


def plan_paths(flown: Flown) -> list[PlanPath]:
    """Return the paths of at most MOST_PLANS steps; those not kept are computed."""
    steps = chosen(flown.fresh)
    paths = []
    for problem, flight, known in flown.parts():
        again: Fitness | None = None
        made, shooting = made_at(flight), Shooting(problem)
        lowered, nx = shooting.lowered, problem.model.nx
        for step in steps:
            plan = flight.decisions[step].plans[0]
            if made[step] != step:
                continue
            states = plan.states
            if not states.size:  # A record keeps none.
                again = again or Fitness(shooting, backend="casadi")
                start, at = arguments_of(lowered, plan, flight, int(step), known)
                states = again.states(plan.controls, start, at)
            end = lowered.end_time(states[:, 0])
            times = flight.times[step] + np.linspace(0.0, end, states.shape[1])
            paths.append(PlanPath(times=times, states=states[:nx]))
    return paths


def chosen(steps: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return at most MOST_PLANS of some steps, evenly chosen, first and last too."""
    places = np.linspace(0, steps.size - 1, min(steps.size, MOST_PLANS))
    found: NDArray[np.intp] = steps[places.round().astype(int)]
    return found


def plans_figure(
    panels: Sequence[Panel],
    paths: Sequence[PlanPath],
    labels: Labels,
    *,
    name: str = "plans",
) -> "Figure":
    """Return the flown states over time, and the plans thin beneath them.

    Args:
        panels: Of the states, as `panels_of` returns them.
        paths: The plans.
        labels: The words.
        name: What the thin lines are called.
    """
    count = len(panels)
    beneath: list[list[tuple[Array, Array]]] = [[] for _ in panels]
    for path in paths:
        for row, values in enumerate(path.states):
            beneath[row % count].append((path.times, values))
    drawn = [
        replace(panel, beneath=lines, beneath_name=name)
        for panel, lines in zip(panels, beneath, strict=True)
    ]
    return panels_figure({"states": drawn}, labels)


def cost_figure(flown: Flown) -> "Figure | None":
    """Return the search's best cost over evaluations, and the cost of the plans.

    Of one plan: its search, and its cost as a line. Of several: the searches of all,
    and the costs of the plans over time. None: one plan that was not searched.
    """
    steps, decisions = flown.fresh, flown.trajectory.decisions
    searched = any(p.search.history.size for k in steps for p in decisions[k].plans)
    if steps.size == 0 or (steps.size == 1 and not searched):
        return None
    panels = int(searched) + int(steps.size > 1)
    figure = new_figure((5.0 + 3.0 * (panels - 1), 4.0))
    places = iter(np.atleast_1d(figure.subplots(1, panels)))
    if searched:
        _draw_searches(next(places), flown, alone=steps.size == 1)
    if steps.size > 1:
        _draw_costs(next(places), flown)
    name_lines(figure)
    return figure


def _draw_searches(axes: "Axes", flown: Flown, *, alone: bool) -> None:
    """Draw the cost of each search's best point; of a plan alone its cost, too."""
    labels, decisions = flown.labels, flown.trajectory.decisions
    plans = [
        (number, plan)
        for step in chosen(flown.fresh)
        for number, plan in enumerate(decisions[step].plans)
    ]
    histories = [plan.search.history for _, plan in plans]
    name = "best of the search"
    if any((costs[1:] > costs[:-1]).any() for costs in histories):
        name += ", rising where it breaks less"
    values = []
    for number, plan in plans:
        values.append(labels.sign * plan.search.history)
        axes.plot(
            plan.search.evaluations, values[-1], color=colour(number), label=name,
            lw=1.4 if alone else 0.6, drawstyle="steps-post",
        )  # fmt: skip
        if alone:
            cost = labels.sign * plan.cost
            axes.axhline(
                cost, color=COLOURS[1], ls="--", lw=1.0, label=f"plan, {cost:.5g}"
            )
            values.append(np.array([cost]))
    axes.set(xlabel="evaluations", ylabel=labels.cost)
    _scale(axes, np.concatenate(values))
    axes.grid(alpha=0.3)


def _draw_costs(axes: "Axes", flown: Flown) -> None:
    """Draw the cost of each plan over time."""
    labels, decisions = flown.labels, flown.trajectory.decisions
    times = flown.trajectory.times[flown.fresh]
    names = labels.vehicles if len(flown.problems) > 1 else ("",)
    every = []
    for number in range(len(flown.problems)):
        plans = [decisions[step].plans[number] for step in flown.fresh]
        costs = labels.sign * np.array([plan.cost for plan in plans])
        name = escaped(names[number]) or "plan"
        axes.plot(
            times, costs, ".-", color=colour(number), lw=1.0, ms=4,
            label=name if len(flown.problems) <= MOST_NAMED else None,
        )  # fmt: skip
        bad = np.array([not plan.feasible for plan in plans])
        if bad.any():
            axes.plot(times[bad], costs[bad], "kx", ms=6, label="infeasible plan")
        every.append(costs)
    axes.set(xlabel="time [s]", ylabel=f"{labels.cost} of the plan")
    _scale(axes, np.concatenate(every))
    axes.grid(alpha=0.3)


def step_time_figure(trajectory: Trajectory) -> "Figure":
    """Return the wall time of each decision against the control interval dt."""
    figure = new_figure()
    axes = figure.add_subplot()
    seconds, dt = trajectory.step_seconds, float(np.diff(trajectory.times).mean())
    axes.stairs(
        seconds, trajectory.times, baseline=None, color=COLOURS[0], lw=1.2,
        label="decision",
    )  # fmt: skip
    axes.axhline(dt, color=COLOURS[1], ls="--", lw=1.0, label=f"dt, {dt:g} s")
    axes.set(xlabel="time [s]", ylabel="wall time of a step [s]")
    _scale(axes, np.append(seconds, dt))
    if axes.get_yscale() == "linear":
        axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    name_lines(figure)
    return figure


def _scale(axes: "Axes", values: Array) -> None:
    """Make the vertical axis logarithmic where positive values span decades."""
    finite = values[np.isfinite(values)]
    if finite.size and 0 < finite.min() * _RATIO < finite.max():
        axes.set_yscale("log")
