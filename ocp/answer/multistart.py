"""Multistart: the local solver from many random starts, an alternative to a search."""

from __future__ import annotations

import time as clock

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import RNG, checked, function, of_kind, optional, reals
from swarmstart.heuristics import Budget
from swarmstart.ocp.answer.plan import Plan, PlanningInterrupted, Source
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.presentation import ProgressCallback, of_budget, tell_nothing
from swarmstart.ocp.nlp.polish import Polished, Polisher, is_better
from swarmstart.ocp.rollout.fitness import KNOWN, NOTHING, Known
from swarmstart.ocp.search.search_space import TrajectoryFamily, space_of


@checked(
    refused,
    planner=of_kind(Planner, "a Planner"),
    x0=reals(),
    budget=of_kind(Budget, "a Budget"),
    known=KNOWN,
    family=optional(of_kind(TrajectoryFamily, "a TrajectoryFamily")),
    rng=RNG,
    progress=function(),
)
def multistart(  # noqa: PLR0913 - a whole solver in one call
    planner: Planner,
    x0: ArrayLike,
    *,
    budget: Budget,
    known: Known = NOTHING,
    family: TrajectoryFamily | None = None,
    rng: np.random.Generator,
    progress: ProgressCallback = tell_nothing,
) -> Plan:
    """Run the NLP solver from random points within a budget; return the best plan.

    The points are uniform within the bounds of the controls, or of the family. At least
    one start is always made. Each start runs to its end, within the limits in the
    options of the polish.

    Args:
        planner: Planner of the problem, with a polish; its search is not used.
        x0: Initial state, shape (nx,), of the problem as it is stated.
        budget: Budget as for a search; checked after each start. Its `stagnation` is
            the number of starts in a row that may find nothing better.
        known: Values of the parameters and signals.
        family: Family of trajectories to draw the points from; None: control sequences.
        rng: Source of all randomness.
        progress: Called with (evaluations so far, their limit, "polishing from random
            starts") after each start; with seconds in place of evaluations if the
            budget has only seconds.

    Returns:
        The best plan.

    Raises:
        InvalidProblemError: If the planner has no polish, a control is unbounded or
            takes whole numbers, or the family does not fit the problem.
        PlanningInterrupted: On Ctrl-C after the first start, with the best plan so far.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=1,
        ...     terminal_cost=4 * (x**2 - 1) ** 2 - x / 2,
        ...     bounds=ss.Bounds(controls=(-2, 2)),
        ... )
        >>> planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
        >>> budget, rng = ss.Budget(evaluations=150), np.random.default_rng(0)
        >>> plan = ss.multistart(planner, [0.0], budget=budget, rng=rng)
        >>> round(float(plan.controls[0, 0]), 4)
        1.0153
    """
    polish, tolerance = _polisher_of(planner), planner.problem.tolerance
    space = space_of(planner.fitness, family)
    x0, known, _ = planner.posed(x0, known)
    best, evaluations, since_better = None, 0, 0
    began = clock.perf_counter()
    tell = of_budget(progress, budget, "polishing from random starts")

    def goes_on(best: Polished) -> bool:
        target = -np.inf if budget.target is None else budget.target
        reached = best.violation <= tolerance and best.cost <= target
        return not (
            reached
            or planner.watch.is_over
            or evaluations >= (budget.evaluations or np.inf)
            or clock.perf_counter() - began >= (budget.seconds or np.inf)
            or since_better >= (budget.stagnation or np.inf)
        )

    try:
        while best is None or goes_on(best):
            x = space.box.lower + space.box.width * rng.random(space.box.dim)
            start = space.decoded(x, x0, known)
            at = x0 if start.x0 is None else start.x0
            one = polish(start.controls, at, known, states=start.states)
            evaluations += max(one.evaluations, 1)  # The loop ends in any case.
            since_better += 1
            if best is None or is_better(
                (one.cost, one.violation),
                (best.cost, best.violation),
                tolerance=tolerance,
            ):
                best, since_better = one, 0
            if tell is not None:
                tell(evaluations)
    except KeyboardInterrupt:
        if best is None:
            raise
        raise PlanningInterrupted(_planned(planner, best, evaluations, known)) from None
    return _planned(planner, best, evaluations, known)


def _polisher_of(planner: Planner) -> Polisher:
    if planner.polisher is None:
        raise InvalidProblemError("multistart needs a planner with a polish, got none")
    if planner.problem.integer:
        raise InvalidProblemError(
            "multistart takes no controls of whole numbers: solve rounds them"
        )
    return planner.polisher


def _planned(planner: Planner, best: Polished, evaluations: int, known: Known) -> Plan:
    return planner.evaluated(
        best.controls,
        best.x0,
        known=known,
        source=Source.POLISH,
        evaluations=evaluations,
        polish_status=best.status,
        point=best.point,
    )
