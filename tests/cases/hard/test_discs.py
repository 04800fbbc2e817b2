"""Discs: apart from each other, from start and goal, and all in the problem."""

from itertools import combinations

import numpy as np
import pytest

from swarmstart.cases.hard.discs import CLEARANCE, drawn_discs
from swarmstart.ocp import Separation
from swarmstart.tests.cases.hard.problems import path_values, shipped_problem


@pytest.mark.parametrize("count", [8, 16, 30])
def test_a_point_fits_between_every_two_discs(count: int) -> None:
    field, _ = drawn_discs(discs=count, seed=1)
    assert len(field.discs) == count
    gaps = [
        np.hypot(a.x - b.x, a.y - b.y) - a.radius - b.radius
        for a, b in combinations(field.discs, 2)
    ]
    assert min(gaps) >= CLEARANCE
    for x, y in (field.start, field.goal):
        ways = [np.hypot(x - d.x, y - d.y) - d.radius for d in field.discs]
        assert min(ways) >= CLEARANCE


def test_the_constraints_are_the_distances_from_the_centres() -> None:
    field, _ = drawn_discs(discs=8, seed=1)
    points = np.random.default_rng(0).uniform(-1, 6, (2, 40))
    found = shipped_problem("discs_8").problem.path_constraints[:-1]
    assert [c.distance for c in found if isinstance(c, Separation)] == [
        d.radius for d in field.discs
    ]
    relative = [points - np.array([[d.x], [d.y]]) for d in field.discs]
    values = path_values(shipped_problem("discs_8"), points)
    assert np.allclose(values.reshape(-1, 40), np.concatenate(relative))
