"""Which algorithm the library takes where nobody says.

L-SHADE; below 400 evaluations, in which its population cannot shrink any more, the
chaotic swarm with c1 = c2 = 1.496. Measured on this project's own planning problems:
docs/planning.md, made by benchmarks/planning.py.
"""

from swarmstart.heuristics.algorithm import Algorithm
from swarmstart.heuristics.chaotic_pso import ChaoticPSO
from swarmstart.heuristics.lshade import LSHADE

FEWEST = 400
"""Evaluations from which L-SHADE is taken."""


def default_algorithm(evaluations: int | None) -> Algorithm:
    """Return the algorithm for a budget.

    Args:
        evaluations: The budget; None where it is wall time.
    """
    if evaluations is not None and evaluations < FEWEST:
        return ChaoticPSO(cognitive=1.496, social=1.496)
    return LSHADE()
