"""Solvers of users in comparisons: functions that return controls.

    def mine(problem, x0, budget, rng):       # -> controls, shape (nu, N)

    problem   the `OptimalControlProblem` as it was stated
    x0        initial state, shape (nx,)
    budget    `Budget` of evaluations, seconds or both
    rng       numpy.random.Generator of the seed, its only source of randomness

A function that has parameters with the following names is given these, too:

    evaluate  controls, shape (nu, N) or (nu, N, size) -> (cost, violation), each
        (size,): minimised costs and violations at the checks, by the compiled
        evaluator. It counts, keeps the best controls, and ends the solver with
        `BudgetSpent` when the budget is spent
    known     parameters and signals of the problem (`Known`)

The function may return a `Start` instead, whose `decided` names an end time or
parameters. If it returns None, or if the budget ends it, the answer is the best of the
controls that it has evaluated. A solver without `evaluate` is charged its whole budget
of evaluations.

Another package announces such a function in the group of entry points
`swarmstart.solvers`; its name is then known to `swarmstart compare`.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import reals
from swarmstart.arrays import Array
from swarmstart.cases.campaign.trials.history import CountedObjective, Meter
from swarmstart.cases.campaign.trials.peer_names import installed_solvers
from swarmstart.cases.campaign.trials.solver_names import (
    Solver,
    UnknownSolverError,
    own_solver,
    solvers_of,
)
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics import Algorithm, Budget, is_algorithm
from swarmstart.ocp import Planner, Start
from swarmstart.ocp.answer import Plan, Source
from swarmstart.ocp.rollout import Known

OwnSolver = Callable[..., ArrayLike | Start | None]
Own = OwnSolver | Algorithm | type[Algorithm]
"""A solver of the user's own: a function, or a search, its settings or their class."""
GivenSolver = str | Own
_GIVEN = ("problem", "x0", "budget", "rng")
_OPTIONAL = ("evaluate", "known")
_OUTSIDE = 1e-9
"""Part of its width by which a control may leave its bounds: round-off."""


class OwnSolverError(SwarmstartError):
    """A solver of a user fails, or does not answer with controls."""


def installed_solver(name: str) -> OwnSolver:
    """Return the solver of another package, imported now.

    Raises:
        OwnSolverError: If the solver cannot be imported, or is no solver.
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


def chosen_solvers(
    given: GivenSolver | Sequence[GivenSolver] | Mapping[str, GivenSolver],
) -> tuple[list[Solver], dict[str, Own]]:
    """Return the solvers, each once, and a mapping from names to the user's own ones.

    Args:
        given: Names, functions, or searches: one, several, or a mapping from names.

    Raises:
        UnknownSolverError: If a solver is unknown, or two have one name.
        OwnSolverError: If a function does not take a solver's arguments.
    """
    if isinstance(given, Mapping):
        several = [*given.items()]
    else:
        is_one = isinstance(given, str) or not isinstance(given, Sequence)
        listed = cast(Sequence[GivenSolver], [given] if is_one else given)
        several = [(_name_of(one), one) for one in listed]
    found: dict[str, Solver] = {}
    own: dict[str, Own] = {}
    for name, one in several:
        solvers = solvers_of(one) if isinstance(one, str) else [_own(one, name)]
        new = {solver.name: solver for solver in solvers}
        # A solver of the library may be named twice.
        if doubled := new.keys() & (own if isinstance(one, str) else found).keys():
            raise UnknownSolverError(
                f"expected solvers of distinct names, found two of {min(doubled)!r}; "
                "name them by a mapping: {name: solver}"
            )
        found |= new
        if not isinstance(one, str):
            own[name] = one
    return [*found.values()], own


def _own(given: Own, name: str) -> Solver:
    """Return a solver of the user's own, which is looked at."""
    solver = own_solver(name, type(given).__module__)
    if is_algorithm(given):
        return replace(solver, family="search", polished=False)
    required_solver(given, name)
    return solver


def _name_of(given: GivenSolver) -> str:
    """Return the name of a solver of the user's own: of the function or the class."""
    if isinstance(given, str):
        return given
    return str(getattr(given, "__name__", None) or type(given).__name__)


def _evaluator(
    planner: Planner, x0: ArrayLike, known: Known, meter: Meter, budget: Budget
) -> tuple[Callable[[ArrayLike], tuple[Array, Array]], CountedObjective]:
    """Return what a solver is given as `evaluate`, and the objective that it calls.

    Args:
        planner: Planner of the problem.
        x0: Initial state of the core, that is, of the problem after all rewrites.
        known: Parameters and signals of the core.
        meter: Counter of the trial.
        budget: Budget of the solver.
    """
    problem, objective = planner.problem, planner.fitness.objective(x0, known)
    shape, start = (problem.model.nu, problem.intervals), np.ravel(np.asarray(x0))
    # Decisions about the start follow the controls, and stay as they are given.
    extra = planner.fitness.decision(np.zeros(shape), x0)[math.prod(shape) :]

    def controls_in(points: Array) -> Array:
        return points[: math.prod(shape)].reshape(*shape, -1, order="F")

    def values(points: Array) -> tuple[Array, Array]:
        cost, violation = objective(points)
        # Controls outside of their bounds are no answer, however cheap they are.
        return cost, violation + _outside(problem.control_limits, controls_in(points))

    counted = CountedObjective(
        values,
        meter,
        (budget.evaluations, budget.seconds),
        lambda x: (controls_in(x)[:, :, 0], start),
    )

    def evaluate(controls: ArrayLike) -> tuple[Array, Array]:
        is_real = reals().accepts(controls)
        given = np.asarray(controls, dtype=np.float64) if is_real else np.empty(0)
        if given.shape[:2] != shape or given.ndim not in (2, 3) or not given.size:
            raise OwnSolverError(
                f"evaluate: expected real controls of shape {shape}, or {shape} and a "
                f"size, found {given.shape if is_real else type(controls).__name__}"
            )
        columns = given.reshape(*shape, -1).reshape(math.prod(shape), -1, order="F")
        rest = np.repeat(extra[:, None], columns.shape[1], axis=1)
        return counted(np.concatenate([columns, rest]))

    return evaluate, counted


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
        known: Parameters and signals as stated.
        budget: Budget of the solver.
        meter: Counter of the trial.
        rng: Source of all randomness.

    Raises:
        OwnSolverError: If the solver fails, or does not answer with controls.
    """
    begin: ArrayLike
    start, core, _ = planner.posed(x0, known)
    evaluate, counted = _evaluator(planner, start, core, meter, budget)
    offered = {"evaluate": evaluate, "known": known}
    asked = {n: offered[n] for n in _asked_of(inspect.signature(function))}
    answer: ArrayLike | Start | None = None
    try:
        answer = function(planner.stated, np.array(x0), budget, rng, **asked)
    except Exception as error:
        # The end of the budget may come as another error, through a library's handler.
        if not counted.spent:
            said = " ".join(str(error).split())
            raise OwnSolverError(
                f"{name} failed: {type(error).__name__}{': ' if said else ''}{said}"
            ) from error
    if not meter.evaluations and budget.evaluations is not None:
        meter.counted(float(budget.evaluations))
    if answer is None:
        if meter.best is None:
            raise OwnSolverError(f"{name} returned no controls, and evaluated none")
        controls, begin = meter.best
        plan = planner.evaluated(
            _within(planner, controls, name),
            begin,
            known=core,
            source=Source.SEARCH,
            evaluations=round(meter.evaluations),
        )
    else:
        plan = plan_of(planner, answer, name, x0=x0, known=known)
        plan = replace(plan, evaluations=round(meter.evaluations))
    meter.ended = counted.spent
    return plan, not counted.spent


def plan_of(
    planner: Planner, answer: ArrayLike | Start, name: str, *, x0: Array, known: Known
) -> Plan:
    """Return the plan of given controls: evaluated, neither searched nor polished.

    Args:
        planner: Planner of the problem, without search and polish.
        answer: Controls, shape (nu, N), or a Start, whose `decided` has the decided
            numbers by name.
        name: Name of their origin for messages.
        x0: Initial state as stated.
        known: Parameters and signals as stated.

    Raises:
        OwnSolverError: If the controls have another shape, are not finite, are outside
            of their bounds, or are no whole numbers although these are required.
    """
    begin, core, moved = planner.posed(x0, known, _checked(answer, name, planner))
    controls = moved.controls if isinstance(moved, Start) else np.asarray(moved)
    return planner.evaluated(
        _within(planner, controls, name), begin, known=core, source=Source.SEARCH
    )


def _checked(answer: ArrayLike | Start, name: str, planner: Planner) -> Start:
    """Return an answer as a Start whose controls are finite, and of the right shape."""
    stated = planner.stated
    shape = (stated.model.nu, stated.intervals + stated.has_knots)
    try:
        start = answer if isinstance(answer, Start) else Start(np.asarray(answer))
    except (ValueError, SwarmstartError) as error:
        raise OwnSolverError(
            f"{name}: expected real controls of shape {shape}: {error}"
        ) from None
    controls = np.asarray(start.controls, dtype=np.float64)
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
