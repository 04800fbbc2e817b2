"""Flat paths: the controls of a path make an aircraft fly that path."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.cases.kinds.planar import GRAVITY_M_S2, Turn
from swarmstart.cases.kinds.transfer.pose import flat_path

DURATION = 10.0
START = np.array([5.0, 0.7, 3.0, -2.0])
GOAL = np.array([40.0, 25.0])
coefficients = st.lists(st.floats(-1, 1), min_size=3, max_size=3).map(np.array)


def along(c: Array, times: Array, turn: Turn = "tan") -> tuple[Array, Array]:
    path = flat_path(DURATION, turn=turn, lateral=0.24, along=0.1)
    found = [path(c, START, GOAL, t) for t in times]
    states = np.hstack([np.array(x) for x, _ in found])
    return states, np.hstack([np.array(u) for _, u in found])


@given(c=coefficients)
def test_a_path_begins_in_the_state_and_ends_in_the_goal(c: Array) -> None:
    states, _ = along(c, np.array([0.0, DURATION]))
    # The smallest speed, 1e-3, is added in the square: 1e-7 of 5 m/s.
    np.testing.assert_allclose(states[:, 0], START, atol=2e-7)
    np.testing.assert_allclose(states[2:, 1], GOAL, atol=1e-12)


@pytest.mark.parametrize("turn", get_args(Turn))
@pytest.mark.parametrize("c", [(0, 0, 0), (0.8, -0.3, 0.5), (-0.6, 0.9, -1)])
def test_the_controls_of_a_path_fly_it(turn: Turn, c: tuple[float, ...]) -> None:
    """An independent integrator under a(t), phi(t) comes to the path's states."""
    path = flat_path(DURATION, turn=turn, lateral=0.24, along=0.1)

    def rates(t: float, x: Array) -> list[float]:
        acceleration, bank = np.array(path(c, START, GOAL, t)[1]).ravel()
        pull = np.sin(bank) if turn == "sin" else np.tan(bank)
        v, psi = x[:2]
        turning = GRAVITY_M_S2 * pull / v
        return [acceleration, turning, v * np.cos(psi), v * np.sin(psi)]

    times = np.linspace(0.0, DURATION, 21)
    flown = solve_ivp(
        rates, (0.0, DURATION), START, t_eval=times, rtol=1e-9, atol=1e-9
    ).y
    states, _ = along(np.array(c, dtype=float), times, turn)
    # The smallest speed bends the controls by 1e-7, for ten seconds.
    np.testing.assert_allclose(flown, states, atol=1e-5)


def test_without_bumps_and_with_the_right_speed_a_path_is_the_straight_line() -> None:
    goal = START[2:] + DURATION * START[0] * np.array(
        [np.cos(START[1]), np.sin(START[1])]
    )
    path = flat_path(DURATION, turn="tan", lateral=0.24, along=0.1)
    for t in (0.0, 3.0, 10.0):
        state, controls = (np.array(part).ravel() for part in path(0, START, goal, t))
        # Left over is the smallest speed in the square, 1e-7.
        np.testing.assert_allclose(state[:2], START[:2], atol=2e-7)
        np.testing.assert_allclose(controls, 0, atol=1e-12)


def test_no_path_to_the_goal_bends_less_in_the_mean_than_the_one_without_bumps() -> (
    None
):
    """h of the module is the least acceleration in the mean square."""

    def effort(c: Array) -> float:
        times = np.linspace(0.0, DURATION, 401)
        positions = along(c, times)[0][2:]
        bent = np.diff(positions, 2, axis=1) / (times[1] - times[0]) ** 2
        return float(np.sum(bent**2))

    least = effort(np.zeros(3))
    rng = np.random.default_rng(0)
    assert all(effort(0.1 * rng.uniform(-1, 1, 3)) > least for _ in range(5))


def test_the_page_says_which_gravity_is_used() -> None:
    page = Path(__file__).parents[4] / "docs" / "transfer.md"
    assert f"with g = {GRAVITY_M_S2} m/s^2" in page.read_text(encoding="utf-8")
