"""Instances of problems with one feature each, against `solve`, and read again."""

from pathlib import Path

import numpy as np
import pytest

from swarmstart.ocp import Solutions, SolutionStatus, solve, solve_many
from swarmstart.tests.ocp.feature_pairs.features import drawn

NAMES = (
    "tied controls",
    "free end time",
    "decided parameter",
    "known parameter",
    "tied start",
    "periodic state",
    "rate limit",
    "delay",
    "time in rates",
    "moving limit",
    "soft constraint",
    "maximise",
    "jump",
    "discrete time",
)


@pytest.mark.parametrize("name", NAMES)
def test_instances_have_the_bits_of_solve(name: str, tmp_path: Path) -> None:
    stated = drawn((name,), np.random.default_rng(5))
    problem, known = stated.problem(), stated.known
    x0 = np.asarray(stated.x0, dtype=np.float64)
    x0s = np.stack([0.9 * x0, x0], axis=-1)
    found = solve_many(problem, x0s, known=known, lanes=False, seed=0, threads=1)
    one = solve(problem, x0, known=known, search=None, lanes=0, seed=0, threads=1)
    assert found.status[1] is one.status is SolutionStatus.CONVERGED
    assert found.cost[1] == one.cost and found.verified_cost[1] == one.verified_cost
    np.testing.assert_array_equal(found.controls[:, :, 1], one.controls)
    nx = problem.model.nx
    np.testing.assert_array_equal(found.states[:, :, 1], one.plan.states[:nx])
    assert {key: row[1] for key, row in found.decided.items()} == one.decided
    again = Solutions.load(found.save(tmp_path / "answers.npz"), problem)
    assert again[1].cost == pytest.approx(one.cost, rel=1e-7)
