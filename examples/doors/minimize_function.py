"""The least value of a function of your own
=========================================

The searches work without optimal control, too. Rastrigin's function in five dimensions
has a local minimum near every point of whole numbers, more than 100,000 in these
bounds. The least value is 0.

L-SHADE finds it within 10,000 evaluations; random search stays far above. `ss.minimize`
takes a function of whole populations, a column for each point, the name of an
algorithm, and a budget.

Prints::

    L-SHADE: at the least value: True
    random search: at the least value: False

There is no YAML form: a file states an optimal-control problem.
"""

import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss


def rastrigin(points: np.ndarray) -> np.ndarray:
    """Return the costs of a population, of shape (dim, size)."""
    waves = points**2 - 10 * np.cos(2 * np.pi * points) + 10
    return waves.sum(axis=0)


figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.4))
for name, algorithm in (("L-SHADE", "lshade"), ("random search", "random")):
    found = ss.minimize(
        rastrigin,
        bounds=[(-5.12, 5.12)] * 5,
        algorithm=algorithm,
        budget=10_000,
        seed=0,
    )
    print(f"{name}: at the least value: {bool(found.cost < 1e-6)}")
    right.semilogy(found.history_evaluations, found.history_cost, label=name)
right.set(xlabel="evaluations", ylabel="least value so far", ylim=(1e-9, 200))
right.legend()

side = np.linspace(-5.12, 5.12, 200)
plane = np.stack([axis.ravel() for axis in np.meshgrid(side, side)])
left.contourf(side, side, rastrigin(plane).reshape(200, 200), 20, cmap="cividis")
left.set(aspect="equal", xlabel="first variable", ylabel="second variable")
plt.show()
