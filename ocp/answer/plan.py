"""Plan: controls over one horizon, with their cost; and starts made from a plan.

A plan becomes a start on another grid, or from another initial state, by

    states       interpolated over the time
    controls     means over the new intervals; knots are interpolated
    decided      unchanged: parameters, a free end time, a free start
    multipliers  as in nlp/start.py

If the horizon differs, everything is stretched: start maps to start, end to end. The
states of joined phases are omitted on another grid, since one of them counts intervals.

In closed loop a plan starts from the last one, shifted by an interval with its
multipliers. The polish from there is enough, and no search is needed, unless

    it fails            it does not converge, or is not feasible
    the problem jumps   J - J_last > max(S / 2, 1e-3 S_0)

J is the cost of the new plan and J_last that of the last one. J_last is an upper bound
of what the rest of the last plan costs, if costs are not negative. S is the sum of
|costs| along the new plan, and S_0 the cost's natural size, from the problem's bounds
(scaling.py); without S_0, noise about a target with zero costs would count as a jump.
The cost rises if a target, a reference or an obstacle jumps, or the plant is pushed
away. For costs that are not negative the rule is J > 2 J_last.

In both cases the search and the local solves in lanes run as for a first plan, and the
better plan is kept. The search also runs if nothing of the last plan is left, as for a
horizon of one interval. A first plan is made both ways too, with a search and by the
polish alone, since a search may miss the answer of the polish.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import checked
from swarmstart.arrays import Array
from swarmstart.errors import Sendable
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.lower_bound.stated.answer import SENSE
from swarmstart.ocp.nlp.multipliers import Duals, duals_of
from swarmstart.ocp.nlp.optimality import NlpPoint
from swarmstart.ocp.nlp.polish import is_better
from swarmstart.ocp.nlp.polish_options import PolishStatus
from swarmstart.ocp.nlp.start import Carried, Start
from swarmstart.ocp.rollout.fitness import Fitness, Known, at_nodes, shared_arguments
from swarmstart.ocp.search.account import Lanes, StartsAccount
from swarmstart.ocp.search.settings import SearchSettings
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.chain import Lowered, lowered
from swarmstart.ocp.system.separation import label

JUMP = 0.5
"""Rise of the cost, relative to its size, that counts as a jump."""
_WORTH = 0.01
"""Relative saving needed by a plan that no polish has converged to."""
NOISE = 1e-3
"""Rise of the cost, relative to its natural size, that counts as noise."""


class Source(Enum):
    """Origin of a plan."""

    GUESS = "the guess itself"
    COLD = "the start itself"
    LANES = "the lanes"
    SEARCH = "the search"
    POLISH = "the polish"
    SHIFTED = "the last plan, shifted, since no feasible one was found"
    LINEAR = "the linear law of the terminal set"
    COMMITTED = "the plan that its vehicle has committed to"


@dataclass(frozen=True, slots=True, eq=False)
class SearchReport:
    """Result of a population search, before any local solve (polish).

    Attributes:
        cost: Cost of the search's answer; NaN without a search.
        violation: Violation of that answer; NaN without a search.
        history: Cost of the best point after each generation, shape (generations,);
            empty without a search.
        evaluations: Evaluations spent up to each generation, same shape.
        lanes: Results of local solves in lanes, if the search uses them; else None.
        without_lanes: Reason why a search that should use lanes did not; else empty.
        violations: Violation of the best point after each generation, same shape as
            `history`; 0 for a feasible one. Empty if it is not known.
    """

    cost: float = np.nan
    violation: float = np.nan
    history: Array = field(default_factory=lambda: np.empty(0))
    evaluations: Array = field(default_factory=lambda: np.empty(0))
    lanes: Lanes | None = None
    without_lanes: str = ""
    violations: Array = field(default_factory=lambda: np.empty(0))

    @checked(refused, sense=SENSE)
    def lines(self, sense: float = 1.0) -> list[str]:
        """Return a line on the local solves in lanes during the search, or no line.

        Args:
            sense: 1 for a minimised cost, -1 for a maximised one.
        """
        if self.lanes is not None:
            return [f"  searched    {self.lanes.line(sense)}"]
        if self.without_lanes:
            return [f"  searched    without lanes: {self.without_lanes}"]
        return []

    @checked(refused, sense=SENSE)
    def told(self, sense: float = 1.0) -> dict[str, Any] | None:
        """Return the lanes' results as a dictionary for JSON; None without lanes.

        Args:
            sense: 1 for a minimised cost, -1 for a maximised one.
        """
        if self.lanes is None and not self.without_lanes:
            return None
        lanes = None if self.lanes is None else self.lanes.told(sense)
        return {"lanes": lanes, "without_lanes": self.without_lanes}


NO_SEARCH = SearchReport()


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Plan:
    """A control sequence over one horizon, with its cost and violation.

    Attributes:
        controls: Controls, shape (nu, N).
        states: States at the nodes, shape (nx, nodes).
        cost: Cost by the problem's evaluator (`Fitness`); to be minimised.
        violation: Sum of the scaled excesses of all constraints, by the same evaluator.
        feasible: Whether the violation is within the problem's tolerance.
        source: Origin of the plan.
        search: Result of the search; `NO_SEARCH` without one.
        evaluations: Evaluations spent, including those of the polish.
        polish_status: Status of the polish, the final local solve; None without one.
        start_excess: Largest excess of the start over bounds of states and path
            constraints without controls, relative to their scales; 0: the start keeps
            them.
        point: The plan as a stationary point of the NLP; None: it was not shown to be
            one.
        relaxed_cost: Cost of a local optimum without the requirement of whole numbers;
            NaN: not known.
        ends: States between the intervals, shape (nx, N + 1), of a plan that is judged
            interval by interval, each from its own state: deviations grow so much that
            no roll-out over the whole horizon confirms it. None: the plan is judged by
            its roll-out.
        start: Initial state of a plan whose states are not stored; None if they are.
        starts: Report on all starts of the polish; None if there was only one.
        duals: Multipliers of a plan whose point is not stored; None if the point is
            stored or there are no multipliers.
        spent: Iterations of each polish, up to this plan, that started from
            multipliers; see `Carried.spent`.
        stopped: Whether the time limit of the step (`within`) was reached before
            planning ended. The plan is then the best one found until that time.
        settled: Whether perturbed starts found nothing better. A stationary point that
            is flat to second order then counts as a local optimum, too.
    """

    controls: Array
    states: Array
    cost: float
    violation: float
    feasible: bool
    source: Source
    search: SearchReport = NO_SEARCH
    evaluations: int = 0
    polish_status: PolishStatus | None = None
    start_excess: float = 0.0
    point: NlpPoint | None = None
    relaxed_cost: float = np.nan
    ends: Array | None = None
    start: Array | None = None
    starts: StartsAccount | None = None
    duals: Duals | None = None
    spent: tuple[int, ...] = ()
    stopped: bool = False
    settled: bool = False

    @property
    def is_searched(self) -> bool:
        """True if a population search took part; False if a warm start was enough."""
        return self.search.evaluations.size > 0

    @property
    def x0(self) -> Array:
        """Initial state, including the decisions about it, shape (nx,)."""
        if self.start is not None and not self.states.size:
            return self.start
        return self.states[:, 0]

    def __repr__(self) -> str:
        """Return cost, violation and source in one line."""
        kind = "feasible" if self.feasible else "infeasible"
        return (
            f"Plan: {kind}, cost {self.cost:.9g}, violation {self.violation:.3g}, "
            f"{self.controls.shape[1]} intervals, from {self.source.value}, "
            f"{self.evaluations} evaluations"
            f"{', stopped when its time was over' if self.stopped else ''}"
        )


def start_of(problem: OptimalControlProblem, plan: Plan, x0: ArrayLike) -> ArrayLike:
    """Return the initial state of a plan, with the values that the plan decided.

    Args:
        problem: The problem of the plan.
        plan: The plan.
        x0: Initial state as given, shape (nx,).
    """
    return plan.x0 if problem.nlp_starts else x0


class Account(TypedDict, total=False):
    """The fields of `Plan` that describe its effort, as keywords; all are optional."""

    search: SearchReport
    evaluations: int
    polish_status: PolishStatus | None
    point: NlpPoint | None
    ends: Array | None
    relaxed_cost: float
    starts: StartsAccount | None
    spent: tuple[int, ...]
    stopped: bool


class PlanningInterrupted(Sendable, KeyboardInterrupt):
    """Ctrl-C during planning.

    Attributes:
        partial: The best plan so far.
    """

    def __init__(self, partial: Plan) -> None:
        """Keep the best plan so far."""
        super().__init__("planning was interrupted before its end")
        self.partial = partial


def guess_of(
    plan: Plan, stated: OptimalControlProblem, problem: OptimalControlProblem
) -> Start:
    """Return a plan as a start of another problem with the same names.

    Args:
        plan: The plan, with its states.
        stated: The problem that the plan answers.
        problem: The problem to solve.

    Raises:
        InvalidProblemError: If states, controls, constraints or decisions have other
            names, or controls another shape.
    """
    _require_same(stated, problem)
    before, after = lowered(stated), lowered(problem)
    start = before.as_stated(plan.x0)
    decided = {
        before.core.model.state_names[one.states[0]]: float(start[one.states[0]])
        for one in before.core.free_starts
    }
    controls = _controls(before.knots(plan.controls, plan.x0), problem, stated)
    carried = None
    if plan.point is not None:
        carried = Carried(
            duals=duals_of(plan.point),
            program=plan.point.program,
            stretch=_length(after, decided) / before.end_time(plan.x0),
        )
    # Joined phases count their intervals in a state.
    counts = bool(stated.clock) and problem.intervals != stated.intervals
    return Start(
        controls=controls,
        states=None if counts else _states(plan, before, after, controls),
        is_guess=not counts,
        carried=carried,
        decided=decided,
    )


def _length(after: Lowered, decided: dict[str, float]) -> float:
    """Return the length of the new horizon [s]; a free one keeps it, in bounds."""
    horizon = after.stated.horizon
    if not isinstance(horizon, Free):
        return after.stated.length
    names = after.core.model.state_names
    (place,) = after.places["end time"]
    guess = decided.get(names[place], horizon.first)
    return float(np.clip(guess, horizon.lower, horizon.upper))


def _controls(
    given: Array, problem: OptimalControlProblem, stated: OptimalControlProblem
) -> Array:
    """Return controls, or knots, over the intervals of a problem."""
    N, before = problem.intervals, stated.intervals
    if problem.has_knots:
        at = np.linspace(0.0, before, N + 1)
        return np.array([np.interp(at, np.arange(before + 1), row) for row in given])
    if N == before:
        return given.copy()
    edges, old = np.linspace(0.0, 1.0, N + 1), np.linspace(0.0, 1.0, before + 1)
    totals = np.hstack([np.zeros((given.shape[0], 1)), np.cumsum(given, axis=1)])
    means = [np.diff(np.interp(edges, old, row)) * N / before for row in totals]
    return np.array(means).reshape((given.shape[0], N))


def _states(plan: Plan, before: Lowered, after: Lowered, controls: Array) -> Array:
    """Return the states of the new core at its nodes, counted as its problem does."""
    old = np.linspace(0.0, 1.0, plan.states.shape[1])
    new = np.linspace(0.0, 1.0, after.core.nodes)
    names, states = before.core.model.state_names, before.as_stated(plan.states)
    found = np.zeros((after.core.model.nx, new.size))
    for i, name in enumerate(after.core.model.state_names):
        if name in names:
            found[i] = np.interp(new, old, states[names.index(name)])
    start, held = after.guess(found[:, 0], controls)
    return after.as_stated(after.states(found, held, start))


def _require_same(
    stated: OptimalControlProblem, problem: OptimalControlProblem
) -> None:
    """Raise unless two problems have the same names."""
    if not isinstance(problem, OptimalControlProblem):
        raise InvalidProblemError(
            f"as_guess takes an OptimalControlProblem, got {type(problem).__name__}"
        )
    for what, own, others in zip(
        ("states", "controls", "path constraints", "terminal constraints", "decisions"),
        _names(stated),
        _names(problem),
        strict=True,
    ):
        if own != others:
            raise InvalidProblemError(
                f"an answer is a guess of the same problem only: its {what} are "
                f"{_listed(own)}, those of the new one {_listed(others)}"
            )
    if problem.has_knots != stated.has_knots:
        shapes = stated.control_shape, problem.control_shape
        raise InvalidProblemError(
            f"an answer is a guess of the same problem only: its controls are "
            f"{shapes[0]}, those of the new one {shapes[1]}"
        )


def _names(problem: OptimalControlProblem) -> list[list[str]]:
    model = problem.model
    every = [*problem.stated, *problem.soft]
    free = ["end time"] if isinstance(problem.horizon, Free) else []
    return [
        [*model.state_names],
        [*model.control_names],
        sorted(map(label, every)),  # In any order: multipliers are found by name.
        sorted(map(label, problem.terminal_constraints)),
        sorted([*free, *problem.decided]),
    ]


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"


def begins_warm(search: SearchSettings | None, *, lanes: bool) -> bool:
    """Return whether a planner with a polish tries the polish alone before a search.

    Args:
        search: The population search; None without one.
        lanes: Whether starts are solved in lanes.
    """
    return lanes if search is None else search.when != "always"


def is_enough(
    fitness: Fitness,
    warm: Plan,
    x0: ArrayLike,
    known: Known,
    last_cost: float | None,
) -> bool:
    """Return whether a plan polished from the last one needs no search.

    Args:
        fitness: The problem's evaluator.
        warm: The plan polished from the last one.
        x0: Initial state of the new plan, shape (nx,).
        known: Values of the parameters and signals.
        last_cost: Cost of the last plan; None if not known.
    """
    if not warm.feasible or warm.polish_status is not PolishStatus.CONVERGED:
        return False
    if last_cost is None or not np.isfinite(last_cost) or warm.cost <= last_cost:
        return True
    size = _size_along(fitness, warm, x0, known)
    natural = fitness.arguments.sizes(x0, known).cost
    return bool(warm.cost - last_cost <= max(JUMP * size, NOISE * natural))


def better_plan(
    fitness: Fitness, plan: Plan, warm: Plan, x0: ArrayLike, known: Known
) -> Plan:
    """Return the better of a searched and an unsearched plan, with the effort of both.

    Of two feasible plans, the one that a polish has converged to is preferred, unless
    the other costs much less: the next polish can start from a converged plan.

    Args:
        fitness: The problem's evaluator.
        plan: The searched plan.
        warm: The plan made without a search.
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
    """
    found, before = (plan.cost, plan.violation), (warm.cost, warm.violation)
    takes_warm = is_better(before, found, tolerance=fitness.problem.tolerance)
    if plan.feasible and warm.feasible and _is_solved(plan) != _is_solved(warm):
        solved, other = (warm, plan) if _is_solved(warm) else (plan, warm)
        worth = _WORTH * _size_along(fitness, solved, x0, known)
        # True if the solved one is `warm` and good enough, or neither.
        takes_warm = (solved is warm) == (solved.cost - other.cost <= worth)
    best = plan
    if takes_warm:
        # The search did run, so its results stay.
        best = replace(warm, search=plan.search, starts=plan.starts)
    return replace(best, evaluations=plan.evaluations + warm.evaluations)


def _is_solved(plan: Plan) -> bool:
    return plan.polish_status is PolishStatus.CONVERGED


def _size_along(fitness: Fitness, plan: Plan, x0: ArrayLike, known: Known) -> float:
    """Return the sum of |costs| along a plan."""
    _, p, flat = shared_arguments(fitness.problem, x0, known)
    signals = at_nodes(fitness.problem, flat)
    sizing = fitness.shooting.sizing
    return sizing.cost_along(plan.states, plan.controls, p, signals)
