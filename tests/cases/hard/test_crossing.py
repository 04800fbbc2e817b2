"""Crossing vehicles: each ends opposite to its start, and they start apart."""

from itertools import combinations

import casadi as ca
import numpy as np
import pytest

from swarmstart.cases.hard.crossing import APART, CIRCLE
from swarmstart.tests.cases.hard.problems import shipped_problem


@pytest.mark.parametrize("count", [2, 4, 6, 8])
def test_goals_are_opposite_to_starts(count: int) -> None:
    posed = shipped_problem(f"crossing_{count}")
    places = posed.x0.reshape(count, 2)
    assert np.allclose(np.linalg.norm(places, axis=1), CIRCLE, atol=1e-3)
    gaps = [np.linalg.norm(a - b) for a, b in combinations(places, 2)]
    assert min(gaps) > APART
    assert len(posed.problem.path_constraints) == count * (count - 1) // 2
    ends = [c.expression for c in posed.problem.terminal_constraints]
    missed = ca.Function("missed", [posed.problem.model.states], [ca.vertcat(*ends)])
    assert np.allclose(np.array(missed(-posed.x0)), 0)
