"""Test whether a polish from the last plan is enough, or a search is needed.

In closed loop a plan starts from the last one, shifted by an interval with its
multipliers. The polish from there is enough unless

    it fails            it does not converge, or is not feasible
    the problem jumps   J - J_last > max(S / 2, 1e-3 S_0)

J is its cost and J_last that of the last plan, an upper bound of the cost of that
plan's rest (costs that are not negative only fall along a plan). S is the sum of
|costs| along the new plan, and S_0 the cost's natural size, from the problem's bounds
(scaling.py); without S_0, noise about a target with zero costs would count as a jump.
The cost rises if a target, a reference or an obstacle jumps, or the plant is pushed
away. For costs that are not negative the rule is J > 2 J_last.

Then the search and the lanes run as for a first plan, and the better plan is kept. The
search also runs if nothing of the last plan is left, as for a horizon of one interval.
A first plan is made both ways, too, since a search may miss the answer of a polish
alone.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.ocp.answer.plan import Plan
from swarmstart.ocp.nlp.polish import is_better
from swarmstart.ocp.nlp.polish_options import PolishStatus
from swarmstart.ocp.rollout.fitness import Fitness, Known, at_nodes, shared_arguments
from swarmstart.ocp.search.settings import SearchSettings

JUMP = 0.5
"""Rise of the cost, relative to its size, that counts as a jump."""
_WORTH = 0.01
"""Relative saving needed by a plan that no polish has converged to."""
_NOISE = 1e-3
"""Rise of the cost, relative to its natural size, that counts as noise."""


def begins_warm(search: SearchSettings | None, *, lanes: bool) -> bool:
    """Return whether a plan is first made by a polish alone, if there is one.

    Args:
        search: The population search; None without one.
        lanes: Whether there are lanes.
    """
    return lanes if search is None else search.when == "needed"


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
        warm: The plan.
        x0: Its initial state, shape (nx,).
        known: Parameters and signals.
        last_cost: Cost of the last plan; None if not known.
    """
    if not warm.feasible or warm.polish_status is not PolishStatus.CONVERGED:
        return False
    if last_cost is None or not np.isfinite(last_cost) or warm.cost <= last_cost:
        return True
    size = _size_along(fitness, warm, x0, known)
    natural = fitness.arguments.sizes(x0, known).cost
    return bool(warm.cost - last_cost <= max(JUMP * size, _NOISE * natural))


def better_plan(
    fitness: Fitness, plan: Plan, warm: Plan, x0: ArrayLike, known: Known
) -> Plan:
    """Return the better of a searched plan and another, with the effort of both.

    Of two feasible plans, the one that a polish has converged to is preferred, unless
    the other costs much less: the next polish can start from it.

    Args:
        fitness: The problem's evaluator.
        plan: The searched plan.
        warm: The plan made without a search.
        x0: Initial state, shape (nx,).
        known: Parameters and signals.
    """
    found, before = (plan.cost, plan.violation), (warm.cost, warm.violation)
    takes_warm = is_better(before, found, tolerance=fitness.problem.tolerance)
    if plan.feasible and warm.feasible and _is_solved(plan) != _is_solved(warm):
        solved, other = (warm, plan) if _is_solved(warm) else (plan, warm)
        worth = _WORTH * _size_along(fitness, solved, x0, known)
        takes_warm = (solved is warm) == (solved.cost - other.cost <= worth)
    best = plan
    if takes_warm:
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
