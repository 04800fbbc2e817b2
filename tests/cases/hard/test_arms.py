"""Arms: their points from complex numbers, free at the start, and a goal in reach."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.cases.hard.arms import POINTS
from swarmstart.ocp import Separation
from swarmstart.tests.cases.hard.problems import path_values, shipped_problem


@pytest.mark.parametrize("links", [2, 3, 4])
def test_positions_are_sums_of_links_in_the_complex_plane(links: int) -> None:
    posed = shipped_problem(f"arms_{links}")
    angles = np.random.default_rng(links).uniform(-np.pi, np.pi, (links, 30))
    ways = np.exp(1j * np.cumsum(angles, axis=0)) * 2 / links
    joints = np.cumsum(np.vstack([np.zeros(30), ways]), axis=0)
    points = np.array([
        joints[link] + part / POINTS * ways[link]
        for link in range(links) for part in range(1, POINTS + 1)
    ])  # fmt: skip
    relative = path_values(posed, angles).reshape(3, links * POINTS, 2, 30)
    found = relative[:, :, 0] + 1j * relative[:, :, 1]
    # Each disc shifts all points alike.
    shifts = points[None] - found
    assert np.allclose(shifts, shifts[:, :1, :1], atol=1e-9)


@pytest.mark.parametrize("links", [2, 3, 4])
def test_the_arm_starts_free_and_far_from_a_goal_in_reach(links: int) -> None:
    posed = shipped_problem(f"arms_{links}")
    relative = path_values(posed, posed.x0[:, None]).reshape(-1, 2)
    radii = [
        c.distance for c in posed.problem.path_constraints if isinstance(c, Separation)
    ]
    assert (np.linalg.norm(relative, axis=1) > radii).all()
    ends = posed.problem.terminal_constraints
    tip = ca.Function(
        "tip", [posed.problem.model.states], [ca.vertcat(*[e.expression for e in ends])]
    )
    goal = np.array([float(np.ravel(e.lower)[0]) for e in ends])
    assert np.linalg.norm(goal) < 2
    assert np.linalg.norm(np.ravel(np.array(tip(posed.x0))) - goal) > 1.4
