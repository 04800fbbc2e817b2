"""Guesses of states: their start and end."""

from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp import Bounds, Model, OptimalControlProblem, Planner
from swarmstart.ocp.rollout.fitness import NOTHING
from swarmstart.ocp.search.state_guesses import state_guesses, straight_states

X, U = ca.SX.sym("x", 3), ca.SX.sym("u")
PROBLEM = OptimalControlProblem(
    Model(states=X, controls=U, ode=ca.vertcat(X[1], U, X[0])),
    horizon=2.0,
    intervals=8,
    stage_cost=U**2,
    bounds=Bounds(
        controls=(-9, 9), states=([-3, -np.inf, -np.inf], [1.2, np.inf, np.inf])
    ),
    terminal=[X[:2] - ca.vertcat(1.0, 0.0)],
)
X0 = [0.0, 0.0, 5.0]


def guesses(problem: OptimalControlProblem, n: int = 8) -> list[NDArray[np.float64]]:
    """Return the states of guesses."""
    rng = np.random.default_rng(0)
    planner = Planner(problem, search="lshade", backend="casadi")
    found = state_guesses(planner.fitness, X0, NOTHING, n, rng)
    assert all(not one.controls.any() for one in found)
    return [one.states for one in found if one.states is not None]


def test_guesses_begin_at_the_start_and_end_where_the_end_fixes_states() -> None:
    found = guesses(PROBLEM)
    assert len(found) == 8
    for states in found:
        assert states.shape == (3, 9)
        np.testing.assert_array_equal(states[:, 0], X0)
        np.testing.assert_allclose(states[:2, -1], [1.0, 0.0], atol=1e-12)
        # Free states stay constant.
        np.testing.assert_array_equal(states[2], 5.0)
        assert states[0].max() <= 1.2
    np.testing.assert_allclose(found[0][0], np.linspace(0, 1, 9))


def test_guesses_differ_also_where_a_state_ends_as_it_began() -> None:
    """The second state starts and ends at 0: its natural size gives its amplitude."""
    rows = np.array([states[:2, 4] for states in guesses(PROBLEM)])
    assert len(np.unique(rows[:, 0])) == len(np.unique(rows[:, 1])) == 8
    assert np.abs(rows[1:, 1]).max() > 0.1


def test_no_guesses_where_the_end_fixes_nothing() -> None:
    assert guesses(replace(PROBLEM, terminal=[], terminal_cost=X[0] ** 2)) == []
    assert guesses(PROBLEM, 0) == []
    free = Planner(replace(PROBLEM, terminal=[]), search="lshade", backend="casadi")
    assert straight_states(free.fitness, X0, NOTHING) is None
