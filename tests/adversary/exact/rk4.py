"""Number of steps that a problem needs from the package's integrator, found apart."""

import numpy as np

from swarmstart.arrays import Array
from swarmstart.tests.adversary.judge import Truth

CLOSE = 1e-6
MOST = 512


def rk4(truth: Truth, controls: Array, steps: int) -> Array:
    """Return the final states, and the cost as one more row, by RK4.

    Args:
        truth: The problem.
        controls: Shape (nu, N).
        steps: In each interval.
    """

    def rate(y: Array, u: Array) -> Array:
        x = y[:-1]
        return np.array([*truth.dynamics(x, u), truth.stage_cost(x, u)])

    h, y = truth.horizon / truth.intervals / steps, np.array([*truth.x0, 0.0])
    for u in np.repeat(controls, steps, axis=1).T:
        k1 = rate(y, u)
        k2 = rate(y + h / 2 * k1, u)
        k3 = rate(y + h / 2 * k2, u)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(y + h * k3, u))
    y[-1] += truth.terminal_cost(y[:-1])
    return y


def substeps_needed(truth: Truth, controls: Array, *, checks: int = 1) -> int:
    """Return the substeps of a check that make RK4 right to CLOSE, at least 2.

    Args:
        truth: The problem.
        controls: About where the optimum is, shape (nu, N).
        checks: Of each interval.
    """
    substeps, coarse = 2, rk4(truth, controls, 2 * checks)
    while substeps < MOST:
        fine = rk4(truth, controls, 2 * substeps * checks)
        with np.errstate(all="ignore"):
            size = np.maximum(np.abs(fine), np.array([*truth.sizes, truth.cost_size]))
            if (np.abs(fine - coarse) <= CLOSE * size).all():
                return substeps
        substeps, coarse = 2 * substeps, fine
    return MOST
