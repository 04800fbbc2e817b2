"""Perturbed starts: is a stationary point a local optimum, if its curvature is flat?

The controls are moved a little, at random, and polished again. If that leads down, the
point was none, and the better one is taken; if twenty starts do not, it is called a
local optimum.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.ocp.fitness import Fitness, Known
from swarmstart.ocp.optimality import Curvature, curvature
from swarmstart.ocp.planner import Plan, Planner, Source
from swarmstart.ocp.polish import SAME_COST, Polished, Polisher, PolishStatus

Array = NDArray[np.float64]
STARTS = 20
ROUNDS = 3
"""Times that a better point is taken before it is left undecided."""
_SMALLEST, _LARGEST = 1e-3, 1e-1
"""Sizes of the moves, in parts of the controls' sizes; drawn log-uniformly."""


def settled(
    planner: Planner,
    plan: Plan,
    x0: ArrayLike,
    known: Known,
    *,
    rng: np.random.Generator,
) -> tuple[Plan, bool]:
    """Return a plan from which no perturbed start leads down, and whether that is so.

    Args:
        planner: The planner whose polish ended there.
        plan: A stationary point.
        x0: Initial state, shape (nx,).
        known: Parameters and signals.
        rng: Source of all randomness.
    """
    polisher, fitness = planner.polisher, planner.fitness
    for _ in range(ROUNDS):
        if plan.point is None or polisher is None:
            return plan, False
        bent = curvature(plan.point)
        if bent is Curvature.POSITIVE:
            return plan, True
        better, evaluations = _descended(fitness, polisher, plan, x0, known, rng)
        evaluations += plan.evaluations
        if better is None:
            plan = replace(plan, evaluations=evaluations)
            return plan, bent is not Curvature.NEGATIVE
        plan = planner.evaluated(
            better.controls,
            x0,
            known=known,
            value=(better.cost, better.violation),
            source=Source.POLISH,
            search=plan.search,
            evaluations=evaluations,
            polish_status=better.status,
            point=better.point,
        )
    return plan, False


def _descended(
    fitness: Fitness,
    polisher: Polisher,
    plan: Plan,
    x0: ArrayLike,
    known: Known,
    rng: np.random.Generator,
) -> tuple[Polished | None, int]:
    """Return the first answer from a perturbed start that is better, and the effort."""
    sizes = fitness.arguments.sizes_along(plan.controls, plan.states, x0, known)
    evaluations = 0
    for _ in range(STARTS):
        part = np.exp(rng.uniform(np.log(_SMALLEST), np.log(_LARGEST)))
        move = part * sizes.controls[:, None] * rng.standard_normal(plan.controls.shape)
        found = polisher(plan.controls + move, x0, known, near=True)
        evaluations += found.evaluations
        falls = plan.cost - found.cost > SAME_COST * max(abs(plan.cost), sizes.cost)
        feasible = found.violation <= fitness.problem.tolerance
        if feasible and falls and found.status is PolishStatus.CONVERGED:
            return found, evaluations
    return None, evaluations
