"""Lower bounds of optimal-control problems, from the problem to the answer.

    statement    the problem in numbers
    tube         a set that holds all admissible trajectories
    prunings     points leave the set if no trajectory through them costs less than an
                 answer that is known
    polynomials  of rising degree; each proves a bound, until time is up or the bound
                 reaches the cost of that answer

Source: Lasserre, Henrion, Prieur and Trelat (2008), Nonlinear optimal control via
occupation measures and LMI relaxations: the polynomials are the dual variables of their
linear program.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable
from dataclasses import replace
from pkgutil import resolve_name
from typing import Protocol, runtime_checkable

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from swarmstart.arguments import SEED, a_number, checked, function, of_kind, reals
from swarmstart.machine_code import working
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.expressions import shortened
from swarmstart.ocp.common.limits import require_number, require_seconds
from swarmstart.ocp.common.presentation import ProgressCallback, tell_nothing
from swarmstart.ocp.lower_bound.ascent import Ascent, Best
from swarmstart.ocp.lower_bound.region import Region
from swarmstart.ocp.lower_bound.stated.answer import BoundKind, LowerBound, Tube
from swarmstart.ocp.lower_bound.stated.statement import (
    NoBoundError,
    Statement,
    statement_of,
)
from swarmstart.ocp.lower_bound.tubes.tube import NoTubeError, tube_of
from swarmstart.ocp.rollout.fitness import KNOWN, NOTHING, Known
from swarmstart.ocp.rollout.status import SolutionStatus
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.terminal_set.interval_arithmetic import (
    UnknownIntervalOperationError,
    interval_function,
)

CLOSED = 1e-5
"""Gap, relative to the known cost, at which the search ends."""


@runtime_checkable
class Answered(Protocol):
    """An answer to a problem: a `Solution`, or an object with the same attributes."""

    @property
    def status(self) -> SolutionStatus:
        """Status of the answer."""

    @property
    def verified_cost(self) -> float:
        """Cost of the answer, accurately integrated, as the problem states it."""


@checked(
    refused,
    problem=of_kind(OptimalControlProblem, "an OptimalControlProblem"),
    known=KNOWN,
    x0=reals(),
    work=a_number(above=0),
    seed=SEED,
    progress=function(),
)
def lower_bound(  # noqa: PLR0913 - everything but the problem has a default
    problem: OptimalControlProblem,
    x0: ArrayLike,
    *,
    known: Known = NOTHING,
    answer: Answered | float | None = None,
    work: float = 60.0,
    seconds: float | None = None,
    seed: int = 0,
    progress: ProgressCallback = tell_nothing,
) -> LowerBound:
    """Prove a lower bound of the cost of every answer to a problem.

    Args:
        problem: The problem, of at most three states.
        x0: Initial state, shape (nx,).
        known: Parameters, and the time at the start.
        answer: An answer, or its cost as the problem states it; the proof may then skip
            trajectories that cost more. The bound is valid even if the cost is wrong,
            but it is never above that cost. None means that the problem is solved to
            get one.
        work: Budget of work, in units of about a second. The same work proves the same
            bound on every machine.
        seconds: Wall time [s] after which the proof ends even if work is left; the
            bound's `reason` then says so. None: no limit.
        seed: Seed of the samples. They influence how high the bound is, not whether it
            is valid.
        progress: Function called now and then with (whole units of work done, the
            budget, "bounding").

    Returns:
        The best bound that was proven; if there is no bound, a result of kind NONE with
        the reason. After Ctrl-C the best bound so far is returned, as at the end of the
        time.

    Raises:
        InvalidProblemError: If a shape does not fit the problem, or work or seconds is
            not positive.

    Example:
        x' = u from x(0) = 1, with the integral of x^2 + u^2 over 1 s as cost. The
        optimum is tanh(1) = 0.7616; the cost of an answer is 0.77:

        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u),
        ...     horizon=1.0,
        ...     intervals=10,
        ...     stage_cost=x**2 + u**2,
        ...     bounds=ss.Bounds(controls=(-5, 5)),
        ... )
        >>> bound = ss.lower_bound(problem, [1.0], answer=0.77, work=0.2)
        >>> bound.kind.is_bound, bool(bound.value <= 0.7616)
        (True, True)
    """
    require_seconds("seconds", seconds)
    cpu = clock.process_time()
    try:
        statement = statement_of(problem, x0, known)
    except NoBoundError as error:
        return _none(str(error), problem.sense)
    cost = _cost_of(problem, x0, known, answer, seed)
    # The matrices are small: threads of BLAS would only wait for each other.
    with (
        threadpool_limits(limits=1, user_api="blas"),
        working(seconds=seconds) as spent,
    ):

        def tell() -> None:
            progress(min(int(spent.work), math.ceil(work)), math.ceil(work), "bounding")

        found = _bounded(statement, cost, work, np.random.default_rng(seed), tell)
    if spent.was_late:
        late = f"{found.reason}; stopped by the limit of {seconds:g} s"
        found = replace(found, reason=late)
    return replace(found, cpu_seconds=clock.process_time() - cpu)


def _none(reason: str, sense: float) -> LowerBound:
    return LowerBound(kind=BoundKind.NONE, value=math.nan, reason=reason, sense=sense)


def _cost_of(
    problem: OptimalControlProblem,
    x0: ArrayLike,
    known: Known,
    answer: Answered | float | None,
    seed: int,
) -> float:
    """Return the cost to compare with, as the problem states it; NaN without one.

    The cost of an infeasible answer is not used: pruning by it would make no sense.
    """
    if answer is None:
        try:  # Duck typing: `Solution` imports this module.
            # Any cost serves, so a local solve without a search is enough.
            solve = resolve_name("swarmstart.ocp.answer.solving:solve")
            answer = solve(problem, x0, known=known, search=None, seed=seed)
        except InvalidProblemError:
            return math.nan
    if isinstance(answer, Answered):
        return answer.verified_cost if answer.status.is_confirmed else math.nan
    # A bool is an int to Python, but no cost.
    if isinstance(answer, bool) or not isinstance(answer, int | float | np.number):
        raise InvalidProblemError(
            f"answer must be a Solution or a cost, got {shortened(answer)}"
        )
    return require_number("answer, the cost of one,", answer)


def _bounded(
    statement: Statement,
    cost: float,
    until: float,
    rng: np.random.Generator,
    tell: Callable[[], None],
) -> LowerBound:
    """Return the best bound that can be proven until `now()` reaches a value."""
    best = _trivial(statement, None)
    try:
        tube = tube_of(statement)
        best = _better(best, _trivial(statement, tube))
        goal = statement.sense * cost - statement.offset
        if not Region(statement, tube).paving[0].size:
            raise NoTubeError("no trajectory keeps the bounds of the states")
        ascent = Ascent(statement, tube, goal, until, rng)
        for found in ascent.bounds():
            best = _better(best, found)
            tell()
            if goal - best.value < CLOSED * abs(goal):
                break
    except (NoTubeError, UnknownIntervalOperationError) as error:
        best = replace(best, reason=f"{best.reason}; {error}")
    # What is proven so far stays proven.
    except KeyboardInterrupt:
        best = replace(best, reason=f"{best.reason}; interrupted")
    return best.answer()


def _better(one: Best, other: Best) -> Best:
    if not other.kind.is_bound:
        return one
    return other if not one.kind.is_bound or other.value > one.value else one


def _trivial(statement: Statement, tube: Tube | None) -> Best:
    """Return the bound that follows from the least stage cost.

    Args:
        statement: The problem.
        tube: Set that holds the states; None if only their bounds are known.
    """
    n, latest = statement.n, statement.horizon[1]
    low, high = statement.state_box
    if tube is not None:
        # The first 2n faces of a tube are the axes, e_1, -e_1, ...: their levels are
        # bounds of the states.
        low = np.maximum(low, -tube.levels[:, 1 : 2 * n : 2].max(axis=0))
        high = np.minimum(high, tube.levels[:, 0 : 2 * n : 2].max(axis=0))
    at = ca.vertcat(statement.point, statement.controls)
    costs = ca.Function(
        "costs", [at], [ca.densify(ca.vertcat(statement.stage, statement.end))]
    )
    none = Best(
        statement, math.nan, BoundKind.NONE, "no bound was proven with this work"
    )
    try:
        evaluate = interval_function(costs)
    except UnknownIntervalOperationError as error:
        return replace(none, reason=str(error))
    control_low, control_high = statement.control_box
    lower = np.concatenate([[0.0], low, control_low])[:, None]
    upper = np.concatenate([[latest], high, control_high])[:, None]
    least, _ = evaluate(lower, upper)
    stage, end = float(least[0, 0]), float(least[1, 0])
    # A negative rate counts over the whole of the longest horizon.
    duration = latest if stage < 0 else statement.horizon[0]
    value = stage * duration + end
    # Far more than the rounding of the product and of the sum.
    value -= 1e-14 * (abs(stage * duration) + abs(end))
    if not math.isfinite(value):
        return none
    reason = "the least stage cost over the horizon, and the least terminal cost"
    return Best(statement, value, BoundKind.TRIVIAL, reason)
