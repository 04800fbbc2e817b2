"""The default algorithm for a given budget, and the default order.

The default algorithm is L-SHADE. Below 400 evaluations, which are too few for its
population to shrink, it is the chaotic swarm with c1 = c2 = 1.496 and lengths taken
from the box. Both were chosen by measurements on this project's own planning problems:
docs/measured/planning.md, made by benchmarks/planning.py. CMA-ES alone, or with half of
the budget from the best point of L-SHADE, has no advantage after the polish:
docs/measured/search_2017.md, docs/measured/lane_searches.md.

The default order is the adaptive epsilon level, which is feasibility first as soon as a
tenth of a generation is feasible. It was measured on constrained problems of CEC 2006:
docs/measured/orders.md, made by benchmarks/orders.py.

Neither depends on the units of the cost or of the variables.
"""

from swarmstart.heuristics.laws.algorithm import Algorithm
from swarmstart.heuristics.laws.order import Order, epsilon_level
from swarmstart.heuristics.searches.chaotic_pso import ChaoticPSO
from swarmstart.heuristics.searches.lshade import LSHADE

FEWEST = 400
"""Least number of evaluations for which L-SHADE is the default."""


def default_algorithm(evaluations: int | None) -> Algorithm:
    """Return the default algorithm for a budget.

    Args:
        evaluations: The budget; None if it is wall time.

    Example:
        >>> import swarmstart as ss
        >>> [type(ss.default_algorithm(n)).__name__ for n in (100, 20_000)]
        ['ChaoticPSO', 'LSHADE']
    """
    if evaluations is not None and evaluations < FEWEST:
        return ChaoticPSO(
            cognitive=1.496, social=1.496, velocity_max=None, search_length=None
        )
    return LSHADE()


def default_order(tolerance: float = 0.0) -> Order:
    """Return the order of individuals: the adaptive epsilon level.

    Args:
        tolerance: Largest violation that counts as feasible, at least 0.

    Returns:
        `epsilon_level(tolerance)`.

    Raises:
        InvalidOrderError: If the tolerance is negative or not finite.

    Example:
        >>> import swarmstart as ss
        >>> ss.default_order(1e-6) == ss.epsilon_level(1e-6)
        True
    """
    return epsilon_level(tolerance)
