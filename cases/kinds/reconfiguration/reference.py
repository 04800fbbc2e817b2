"""The lowest known cost J from each state of a flight, for its gap.

It is the lowest of the flown plan and, polished by IPOPT, the basins of a long L-SHADE
search and of random points. From the first state of the text's experiment one random
start in seven finds the best minimum; from later states all do.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from swarmstart.arrays import Array
from swarmstart.heuristics import LSHADE, Budget, RandomSearch, feasibility_first
from swarmstart.ocp import (
    IpoptOptions,
    Plan,
    Planner,
    RecedingHorizon,
    SearchSettings,
    Trajectory,
)

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
    """Return J of each plan minus the lowest J found there, shape (T,).

    It is below 0 if a plan costs less because it breaks a limit. The seeds are those of
    the steps, so that the result does not depend on the search of a flight.

    Args:
        joint: The controller of all UAVs at once.
        trajectory: The flight.
    """
    best = best_costs(joint, trajectory.states[:, :-1])
    flown = [decision.plans[0] for decision in trajectory.decisions]
    costs = np.array([plan.cost for plan in flown])
    feasible = np.array([plan.feasible for plan in flown])
    return costs - np.where(feasible, np.minimum(best, costs), best)


def best_costs(joint: RecedingHorizon, states: Array) -> Array:
    """Return the lowest J found from each state, shape (T,); infinity if none is found.

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
