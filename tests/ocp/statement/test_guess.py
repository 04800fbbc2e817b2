"""Initial guesses."""

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.ocp import Bounds, InvalidProblemError, Model, OptimalControlProblem
from swarmstart.ocp.statement.guesses import (
    bounded_controls,
    shifted_controls,
    zero_controls,
)

X, U = ca.SX.sym("x", 2), ca.SX.sym("u", 2)
PROBLEM = OptimalControlProblem(
    Model(states=X, controls=U, ode=U),
    horizon=3.0,
    intervals=3,
    bounds=Bounds(controls=([-1, 2], [1, 5])),
)


def test_zero_controls_go_to_the_nearest_bound() -> None:
    np.testing.assert_array_equal(zero_controls(PROBLEM), [[0, 0, 0], [2, 2, 2]])


def test_shifting_drops_the_first_interval_and_appends_zero_controls() -> None:
    plan = np.array([[0.1, 0.2, 0.3], [3, 4, 5]])
    shifted = shifted_controls(PROBLEM, plan)
    np.testing.assert_array_equal(shifted, [[0.2, 0.3, 0], [4, 5, 2]])
    assert plan[0, 0] == 0.1


def test_shifting_may_repeat_the_last_controls() -> None:
    plan = np.array([[0.1, 0.2, 0.3], [3, 4, 5]])
    shifted = shifted_controls(PROBLEM, plan, "last")
    np.testing.assert_array_equal(shifted, [[0.2, 0.3, 0.3], [4, 5, 5]])


def test_guess_is_clipped_into_a_copy() -> None:
    guess = np.array([[-9.0, 0, 9], [0, 3, 9]])
    inside = bounded_controls(PROBLEM, guess)
    np.testing.assert_array_equal(inside, [[-1, 0, 1], [2, 3, 5]])
    assert guess[0, 0] == -9


@pytest.mark.parametrize(
    ("guess", "message"),
    [
        (np.zeros((3, 2)), r"a guess must have shape \(2, 3\), got \(3, 2\)"),
        (np.full((2, 3), np.nan), "a guess must be finite"),
    ],
)
def test_refuses_what_is_no_guess(guess: NDArray[np.float64], message: str) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        bounded_controls(PROBLEM, guess)
