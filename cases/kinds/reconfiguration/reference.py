"""The best J that is known from each state of a flight, for its gap.

The best of the flown plan as it is and, polished by IPOPT, the basins of a long L-SHADE
search and of points drawn at random. From the first state of the text's experiment one
random start in seven finds the best minimum; from the later ones all do.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from swarmstart.heuristics import LSHADE, Budget, RandomSearch, feasibility_first
from swarmstart.ocp import (
    IpoptOptions,
    Plan,
    Planner,
    RecedingHorizon,
    SearchSettings,
    Trajectory,
)

Array = NDArray[np.float64]

LONG = SearchSettings(
    algorithm=LSHADE(size=100),
    budget=Budget(evaluations=30_000),
    order=feasibility_first(),
    basins=5,
)
SCATTERED = SearchSettings(
    algorithm=RandomSearch(size=200),
    budget=Budget(evaluations=200),
    order=feasibility_first(),
    basins=15,
)
EXACT = IpoptOptions(tolerance=1e-10)


def gaps(joint: RecedingHorizon, trajectory: Trajectory) -> Array:
    """Return J of each plan less the best J found there, shape (T,).

    Below 0 where a flown plan is cheap since it breaks a limit.

    Seeded by the step, so that the best does not depend on how a flight was searched.

    Args:
        joint: The controller of all UAVs at once.
        trajectory: What it flew.
    """
    best = best_costs(joint, trajectory.states[:, :-1])
    flown = [decision.plans[0] for decision in trajectory.decisions]
    costs = np.array([plan.cost for plan in flown])
    feasible = np.array([plan.feasible for plan in flown])
    return costs - np.where(feasible, np.minimum(best, costs), best)


def best_costs(joint: RecedingHorizon, states: Array) -> Array:
    """Return the best J found from each state, shape (T,); infinity where none is.

    Args:
        joint: The controller of all UAVs at once.
        states: Shape (uavs * 4, T).
    """
    planners = [
        Planner(joint.planner.problem, search=search, polish=EXACT)
        for search in (LONG, SCATTERED)
    ]
    return np.array(
        [
            min(
                (plan.cost for plan in _plans(planners, state, k) if plan.feasible),
                default=np.inf,
            )
            for k, state in enumerate(states.T)
        ]
    )


def _plans(planners: Sequence[Planner], state: Array, seed: int) -> Iterator[Plan]:
    for planner in planners:
        yield planner.plan(state, rng=np.random.default_rng(seed))
