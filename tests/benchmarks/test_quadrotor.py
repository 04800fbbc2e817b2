"""The quadrotor of the benchmark of many instances."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.benchmarks import instances, quadrotor
from swarmstart.benchmarks.quadrotor import HOVER, INTERVALS, STEP, cylinders, tracking
from swarmstart.ocp import Planner


def test_it_hovers_at_the_speed_of_hovering() -> None:
    """Four rotors carry the weight: 4 k w^2 = m g."""
    level = np.zeros(13)
    level[3] = 1.0
    x, u = ca.SX.sym("x", 13), ca.SX.sym("u", 4)
    rates = ca.Function("rates", [x, u], [quadrotor.rates(x, u)])
    np.testing.assert_allclose(rates(level, HOVER), np.zeros((13, 1)), atol=1e-9)
    faster = np.array(rates(level, HOVER + np.array([1.0, 0.0, 0.0, -1.0]))).ravel()
    # The rotors 0 and 1 pitch it up, 0 and 3 roll it; z points down.
    assert faster[11] > 0 and faster[10] == pytest.approx(0.0, abs=0.02)


def test_references_move_as_fast_as_they_say() -> None:
    task = tracking(1.5, count=3)
    for axis in range(3):
        place, speed = (task.known[f"reference_{i}"] for i in (axis, axis + 3))
        middle = (place[2:] - place[:-2]) / (2 * STEP)
        np.testing.assert_allclose(middle, speed[1:-1], atol=0.1)


def test_starts_keep_away_from_the_cylinders() -> None:
    for task, count in ((tracking(2.0, count=20), 20), (cylinders(180), 80)):
        planner = Planner(task.problem, search=None, polish=None)
        assert task.x0.shape == (13, count)
        assert task.states.shape == (13, INTERVALS + 1, count)
        np.testing.assert_array_equal(task.states[:, 0], task.x0)
        given = instances.posed(planner, task)
        for number in range(0, count, 7):
            known = given.known(planner.problem, number)
            assert not planner.outside(given.x0[:, number], known)


def test_lanes_and_the_peer_solve_the_same_problem() -> None:
    """The costs of one optimum that both reach are the same."""
    found = instances.compared("arc", cylinders(180, count=4), solves=2)
    assert found.feasible == (4, 4) and found.as_cheap == 1.0
