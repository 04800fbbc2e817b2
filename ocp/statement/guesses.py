"""Guesses of a control sequence, shape (nu, N).

They are zero, the middle of the bounds, a user's own within the bounds, or an earlier
plan shifted by one interval.
"""

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import checked, choice, of_kind, reals
from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.statement.decisions import whole
from swarmstart.ocp.statement.problem import OptimalControlProblem

Appended = Literal["zero", "last"]
"""End of a shifted plan: zero controls, or the plan's own last ones."""
_PROBLEM = of_kind(OptimalControlProblem, "an OptimalControlProblem")


@checked(refused, problem=_PROBLEM)
def zero_controls(problem: OptimalControlProblem) -> Array:
    """Return zero controls, or the bound nearest to zero if zero is not allowed.

    Args:
        problem: The problem.

    Returns:
        Controls, shape (nu, N).
    """
    lower, upper = problem.control_limits
    nearest = np.clip(np.zeros(problem.model.nu), lower, upper)
    return np.repeat(nearest[:, None], problem.intervals, axis=1)


def cold_controls(problem: OptimalControlProblem) -> list[Array]:
    """Return the guesses to start from if none is given, each (nu, N).

    They are zero controls and, if it differs, the middle of the bounds.
    """
    zero, middle = zero_controls(problem), middle_controls(problem)
    return [zero] if np.array_equal(zero, middle) else [zero, middle]


def middle_controls(problem: OptimalControlProblem) -> Array:
    """Return the middle of the controls' bounds, shape (nu, N).

    A control with an infinite bound gets its value in `zero_controls`.
    """
    limits, zero = np.array(problem.control_limits), zero_controls(problem)
    ends = np.isfinite(limits).all(axis=0)
    # Infinite bounds are replaced before the mean, which would be inf - inf.
    middle = np.where(ends, np.where(ends, limits, 0).mean(axis=0), zero[:, 0])
    return np.repeat(middle[:, None], problem.intervals, axis=1)


def given_controls(problem: OptimalControlProblem, guess: ArrayLike) -> Array:
    """Return a guess of controls, shape (nu, N), as an array; a copy.

    Args:
        problem: The problem that the guess is for.
        guess: Controls, shape (nu, N), finite.

    Raises:
        InvalidProblemError: If the shape is wrong, or a value is not finite.
    """
    controls = np.array(guess, dtype=np.float64)
    shape = (problem.model.nu, problem.intervals)
    if controls.shape != shape:
        raise InvalidProblemError(
            f"a guess must have shape {shape}, got {controls.shape}"
        )
    if not np.isfinite(controls).all():
        raise InvalidProblemError(f"a guess must be finite, got {controls}")
    return controls


def bounded_controls(problem: OptimalControlProblem, guess: ArrayLike) -> Array:
    """Return a guess that keeps bounds, blocks and whole numbers; a copy.

    Controls that must be equal, such as those of a block of intervals, get their mean.
    The result is clipped to the bounds, and controls that take whole numbers only are
    rounded.

    Args:
        problem: The problem that the guess is for.
        guess: Controls, shape (nu, N), finite.

    Raises:
        InvalidProblemError: If the shape is wrong, or a value is not finite.
    """
    lower, upper = problem.control_limits
    within = problem.averaged(given_controls(problem, guess))
    within = np.clip(within, lower[:, None], upper[:, None])
    return whole(within, problem.integer, problem.control_limits)


@checked(
    refused,
    problem=_PROBLEM,
    controls=reals(array=True, axes=2),
    append=choice(get_args(Appended)),
)
def shifted_controls(
    problem: OptimalControlProblem, controls: Array, append: Appended = "zero"
) -> Array:
    """Return a plan one interval later: the first interval dropped, one appended.

    Args:
        problem: The problem that the plan was made for.
        controls: The last plan, shape (nu, N); not changed.
        append: The appended controls: "zero" or the plan's "last" ones.

    Returns:
        Controls, shape (nu, N).
    """
    end = controls[:, -1:] if append == "last" else zero_controls(problem)[:, :1]
    return np.hstack([controls[:, 1:], end])
