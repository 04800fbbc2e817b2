"""First guesses of a control sequence, shape (nu, N)."""

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.problem import OptimalControlProblem

Array = NDArray[np.float64]


def zero_controls(problem: OptimalControlProblem) -> Array:
    """Return zero controls, or the bound nearest to zero where zero is not allowed."""
    lower, upper = problem.control_limits
    nearest = np.clip(np.zeros(problem.model.nu), lower, upper)
    return np.repeat(nearest[:, None], problem.intervals, axis=1)


def shifted_controls(problem: OptimalControlProblem, controls: Array) -> Array:
    """Return a plan one interval later: the first interval dropped, zeros appended.

    Args:
        problem: The problem the plan was made for.
        controls: The last plan, shape (nu, N); not changed.
    """
    return np.hstack([controls[:, 1:], zero_controls(problem)[:, :1]])
