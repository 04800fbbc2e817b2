"""Minimise a function of your own with the searches alone, without optimal control.

Shows: `minimize` on a function of whole populations, two algorithms, and a budget.
Rastrigin's function in five dimensions has thousands of local minima; the least is 0.

Prints:
    L-SHADE: at the least value: True
    random search: at the least value: False
"""

import numpy as np
from numpy.typing import NDArray

import swarmstart as ss


def rastrigin(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the costs of a population.

    Args:
        points: A column for each individual, shape (dim, size).
    """
    waves = points**2 - 10 * np.cos(2 * np.pi * points) + 10
    return np.asarray(waves.sum(axis=0))


def main() -> None:
    """Search with two algorithms, with the same budget and seed."""
    for name, algorithm in (("L-SHADE", "lshade"), ("random search", "random")):
        found = ss.minimize(
            rastrigin,
            bounds=[(-5.12, 5.12)] * 5,
            algorithm=algorithm,
            budget=10_000,
            seed=0,
        )
        print(f"{name}: at the least value: {bool(found.cost < 1e-6)}")


if __name__ == "__main__":
    main()
