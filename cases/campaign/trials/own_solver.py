"""Solvers of users in comparisons: functions that return controls.

    def mine(problem, x0, budget, rng):       # -> controls, shape (nu, N)

    problem   the `OptimalControlProblem` as it was stated
    x0        initial state, shape (nx,)
    budget    `Budget` of evaluations, seconds or both
    rng       numpy.random.Generator of the seed, its only source of randomness

If it has further parameters of these names, it is given them, too:

    evaluate  controls, shape (nu, N) or (nu, N, size) -> (cost, violation), each
              (size,): minimised costs and violations at the checks, by the compiled
              evaluator. It counts, keeps the best controls, and ends the solver with
              `BudgetSpent` when the budget is spent
    known     parameters and signals of the problem (`Known`)

It may return a `Start` instead, whose `decided` names an end time or parameters. None
stands for the best controls that it has evaluated, which also are the answer if the
budget ends it. A solver without `evaluate` is charged its whole budget of evaluations.

Another package announces such a function in the group of entry points
`swarmstart.solvers`; its name is then known to `swarmstart compare`.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.cases.campaign.trials.history import Meter
from swarmstart.cases.campaign.trials.peer_names import installed_solvers
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics import Budget
from swarmstart.ocp import Planner, Start
from swarmstart.ocp.answer import Plan, Source
from swarmstart.ocp.rollout import Known

OwnSolver = Callable[..., ArrayLike | Start | None]
_GIVEN = ("problem", "x0", "budget", "rng")
_OPTIONAL = ("evaluate", "known")
_OUTSIDE = 1e-9
"""Part of its width by which a control may leave its bounds: round-off."""


class BudgetSpent(Exception):  # noqa: N818 - no error
    """The budget of a solver that is not this package's is spent."""


class OwnSolverError(SwarmstartError):
    """A solver of a user fails, or does not answer with controls."""


def installed_solver(name: str) -> OwnSolver:
    """Return the solver of another package, imported now.

    Raises:
        OwnSolverError: If it cannot be imported, or is no solver.
    """
    point = installed_solvers()[name]
    try:
        function = point.load()
    except Exception as error:
        raise OwnSolverError(
            f"{name}: expected a solver at {point.value}: {error}"
        ) from error
    return required_solver(function, name)


def required_solver(function: object, name: str) -> OwnSolver:
    """Return a function if it can be called as a solver.

    Args:
        function: The function.
        name: Its name for messages.

    Raises:
        OwnSolverError: If it does not take a solver's arguments.
    """
    expected = f"{name}: expected a function of ({', '.join(_GIVEN)})"
    if not callable(function):
        raise OwnSolverError(f"{expected}, found {type(function).__name__}")
    try:
        signature = inspect.signature(function)
        signature.bind(*_GIVEN, **dict.fromkeys(_asked_of(signature)))
    except (TypeError, ValueError) as error:
        raise OwnSolverError(f"{expected}: {error}") from None
    return function


def _asked_of(signature: inspect.Signature) -> list[str]:
    """Return the optional arguments that a function has parameters for."""
    return [name for name in _OPTIONAL if name in signature.parameters]


class Evaluate:
    """Costs and violations of controls, counted until the budget is spent.

    Attributes:
        spent: The limit that was reached; empty before.
        is_used: Whether it was called.
    """

    def __init__(
        self, planner: Planner, x0: ArrayLike, known: Known, meter: Meter, limit: Budget
    ) -> None:
        """Compile nothing: the planner has the evaluator.

        Args:
            planner: Planner of the problem.
            x0: Initial state of the core.
            known: Parameters and signals of the core.
            meter: Counter of the trial.
            limit: Its budget.
        """
        self._planner, self._x0, self._meter, self._limit = planner, x0, meter, limit
        self._objective = planner.fitness.objective(x0, known)
        self.spent, self.is_used = "", False

    def __call__(self, controls: ArrayLike) -> tuple[Array, Array]:
        """Return cost and violation of each control sequence; see the module.

        Raises:
            OwnSolverError: If the shape is not the problem's.
            BudgetSpent: If the budget is spent.
        """
        problem, meter, limit = self._planner.problem, self._meter, self._limit
        self.is_used = True
        given = np.asarray(controls, dtype=np.float64)
        shape = (problem.model.nu, problem.intervals)
        if given.shape[:2] != shape or given.ndim not in (2, 3):
            raise OwnSolverError(
                f"evaluate: expected controls of shape {shape} or {shape} and a size, "
                f"found {given.shape}"
            )
        many = given.reshape(*shape, -1)
        if limit.evaluations is not None:
            # The last generation is cut where the budget ends.
            many = many[:, :, : limit.evaluations - round(meter.evaluations)]
        size = many.shape[2]
        start = np.asarray(self._x0, dtype=np.float64).ravel()
        columns = many.transpose(1, 0, 2).reshape(-1, size)
        extra = self._planner.fitness.decision(np.zeros(shape), self._x0)
        extra = extra[columns.shape[0] :, None]
        points = np.concatenate([columns, np.repeat(extra, size, axis=1)])
        cost, violation = self._objective(np.ascontiguousarray(points))
        # Controls outside of their bounds are no answer, however cheap they are.
        outside = _outside(problem.control_limits, many)
        violation = violation + outside
        meter.evaluated(
            columns,
            (cost, violation),
            lambda x: (x.reshape(shape, order="F"), start),
        )
        most = limit.evaluations or math.inf
        if meter.evaluations >= most:
            self.spent = "evaluations"
        elif limit.seconds is not None and meter.seconds >= limit.seconds:
            self.spent = "seconds"
        if self.spent:
            raise BudgetSpent
        return cost, violation


def _outside(limits: tuple[Array, Array], controls: Array) -> Array:
    """Return how far sequences leave the bounds of controls, by their widths."""
    lower, upper = (side[:, None, None] for side in limits)
    width = np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    over = np.maximum(controls - upper, lower - controls) / np.maximum(width, 1e-300)
    worst = np.maximum(over, 0.0).max(axis=(0, 1))
    return np.asarray(np.where(worst > _OUTSIDE, worst, 0.0))


def owned(  # noqa: PLR0913 - a solver and all that it is given
    function: OwnSolver,
    name: str,
    *,
    planner: Planner,
    x0: Array,
    known: Known,
    budget: Budget,
    meter: Meter,
    rng: np.random.Generator,
) -> tuple[Plan, bool]:
    """Return the plan of a user's own solver, and whether it ended by itself.

    Args:
        function: The solver.
        name: Its name.
        planner: Planner of the problem, without search and polish.
        x0: Initial state as stated.
        known: Known data as stated.
        budget: Its budget.
        meter: Counter of the trial.
        rng: Source of all randomness.

    Raises:
        OwnSolverError: If it fails, or does not answer with controls.
    """
    begin: ArrayLike
    start, core, _ = planner.posed(x0, known)
    evaluate = Evaluate(planner, start, core, meter, budget)
    offered = {"evaluate": evaluate, "known": known}
    asked = {n: offered[n] for n in _asked_of(inspect.signature(function))}
    answer: ArrayLike | Start | None = None
    try:
        answer = function(planner.stated, np.array(x0), budget, rng, **asked)
    except BudgetSpent:
        pass
    except Exception as error:
        said = " ".join(str(error).split())
        raise OwnSolverError(
            f"{name} failed: {type(error).__name__}{': ' if said else ''}{said}"
        ) from error
    if not evaluate.is_used and budget.evaluations is not None:
        meter.counted(float(budget.evaluations))
    if answer is None:
        if meter.best is None:
            raise OwnSolverError(f"{name} returned no controls, and evaluated none")
        controls, begin = meter.best
    else:
        guess = _checked(answer, name, planner)
        begin, _, moved = planner.posed(x0, known, guess)
        controls = moved.controls if isinstance(moved, Start) else np.asarray(moved)
    plan = planner.evaluated(
        _within(planner, controls, name),
        begin,
        known=core,
        source=Source.SEARCH,
        evaluations=round(meter.evaluations),
    )
    meter.ended = evaluate.spent
    return plan, not evaluate.spent


def _checked(answer: ArrayLike | Start, name: str, planner: Planner) -> Start:
    """Return an answer as a Start whose controls are finite, and of the right shape."""
    stated = planner.stated
    shape = (stated.model.nu, stated.intervals + stated.has_knots)
    try:
        start = answer if isinstance(answer, Start) else Start(np.asarray(answer))
        given = np.asarray(start.controls)
        controls = given.astype(np.float64, casting="same_kind" if given.size else "no")
    except (TypeError, ValueError, SwarmstartError) as error:
        raise OwnSolverError(
            f"{name}: expected real controls of shape {shape}: {error}"
        ) from None
    if controls.shape == shape[1:] and shape[0] == 1:
        controls = controls[None, :]
    if controls.shape != shape:
        raise OwnSolverError(
            f"{name}: expected controls of shape {shape}, found {controls.shape}"
        )
    if not np.isfinite(controls).all():
        raise OwnSolverError(
            f"{name}: expected finite controls, found some that are not"
        )
    return start._replace(controls=controls)


def _within(planner: Planner, controls: Array, name: str) -> Array:
    """Return controls clipped by round-off; raise if they leave bounds by more."""
    problem = planner.problem
    lower, upper = (side[:, None] for side in problem.control_limits)
    if _outside(problem.control_limits, controls[:, :, None])[0] > 0.0:
        row = int(np.argmax(np.maximum(controls - upper, lower - controls).max(axis=1)))
        raise OwnSolverError(
            f"{name}: expected controls within their bounds, found "
            f"{problem.model.control_names[row]} from {controls[row].min():.6g} to "
            f"{controls[row].max():.6g}"
        )
    for row in problem.integer:
        if np.abs(controls[row] - np.round(controls[row])).max() > _OUTSIDE:
            raise OwnSolverError(
                f"{name}: expected whole numbers for {problem.model.control_names[row]}"
            )
    return np.clip(controls, lower, upper)
