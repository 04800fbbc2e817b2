"""SciPy's differential evolution, with a population evaluated at once.

Generations are synchronous (`updating="deferred"`), nothing is polished, and it stops
when the budget is used up.

Source: scipy.optimize.differential_evolution.
"""

import numpy as np

from swarmstart.benchmarks.adapters.peer import Evaluator, PeerResult, generations_of
from swarmstart.heuristics.algorithm import require_size
from swarmstart.heuristics.box import Box
from swarmstart.heuristics.budget import Budget
from swarmstart.heuristics.initial import Initial, initial_population
from swarmstart.heuristics.minimize import Objective
from swarmstart.heuristics.order import Order


def scipy_de(  # noqa: PLR0913
    objective: Objective,
    box: Box,
    *,
    order: Order,
    budget: Budget,
    rng: np.random.Generator,
    size: int = 50,
    strategy: str = "rand1bin",
    F: float | tuple[float, float] = 0.5,
    CR: float = 0.9,
    initial: Initial | None = None,
) -> PeerResult:
    """Search a box with SciPy's differential evolution.

    Args:
        objective: As in `minimize`.
        box: The box to search.
        order: A static penalty.
        budget: Evaluations, no other limit.
        rng: Source of randomness.
        size: Number of individuals NP, at least 5.
        strategy: As SciPy names it.
        F: Weight of the difference, or the two ends of SciPy's dither.
        CR: Crossover probability.
        initial: How the initial population is made (known costs are not used); None
            means `Initial()`.

    Returns:
        The best point found.

    Raises:
        InvalidBudgetError: If the budget has other limits, or fits no generation.
        InvalidSettingsError: If the size is below 5.
        UnsupportedOrderError: If the order is no static penalty.
    """
    from scipy.optimize import differential_evolution  # noqa: PLC0415 - lazy

    require_size(size, at_least=5)
    evaluator = Evaluator(objective, box, order)
    generations = generations_of(budget, size)
    population, _ = initial_population(box, size, initial or Initial(), rng=rng)
    seed = np.random.default_rng(rng.integers(2**63))
    differential_evolution(
        evaluator.merits,
        list(zip(box.lower.tolist(), box.upper.tolist(), strict=True)),
        strategy=strategy,
        maxiter=generations - 1,
        tol=0.0,
        atol=-1.0,  # never: a deviation is not below 0
        mutation=F,
        recombination=CR,
        seed=seed,
        polish=False,
        init=population.T,
        updating="deferred",
        vectorized=True,
    )
    return evaluator.result()
