"""Compare a search of your own, ten lines long, with those of the library.

Shows: a function (problem, x0, budget, rng, evaluate) -> controls as a solver of
`compare`, judged and timed like the others, with the same budget and paired seeds.

Prints:
    climb: 10 of 10 feasible, 10 near the best
    random: 10 of 10 feasible, 0 near the best; costlier
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import swarmstart as ss


def climb(
    problem: ss.OptimalControlProblem,
    x0: NDArray[np.float64],
    budget: ss.Budget,
    rng: np.random.Generator,
    evaluate: Callable[[Any], Any],
) -> NDArray[np.float64]:
    """Keep the best of sixteen moves, with steps that shrink; `evaluate` ends it."""
    lower, upper = (side[:, None, None] for side in problem.control_limits)
    best, size = (lower + upper)[:, :, 0] / 2 * np.ones(problem.intervals), 0.5
    while size > 1e-4:
        moves = rng.normal(size=(*best.shape, 16)) * size * (upper - lower)
        tried = np.clip(best[:, :, None] + moves, lower, upper)
        tried[:, :, 0] = best
        cost, violation = evaluate(tried)
        chosen = int(np.argmin(cost + 1e3 * violation))
        best, size = tried[:, :, chosen], size * (0.95 if chosen == 0 else 1.0)
    return best


def main() -> None:
    """Compare it with random search on a reactor that has two local optima."""
    rows = ss.compare("two_reaction_reactor", [climb, "random"], seeds=10, budget=4000)
    for row in rows:
        said = f"; {row.against_first.partition(' (')[0]}" if row.against_first else ""
        count = len(row.outcomes)
        print(
            f"{row.solver}: {row.feasible} of {count} feasible, "
            f"{row.successes} near the best{said}"
        )


if __name__ == "__main__":
    main()
