"""Optima that lanes list are optima: a polish moves none of them."""

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.benchmarks.same_bits import SOLVED
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.ocp.lanes.solver import LaneSolver
from swarmstart.tests.adversary.case import Case, problem_of
from swarmstart.tests.adversary.problems import multimodal, path_constrained


def moved_by_a_polish(found: ss.Solution) -> list[float]:
    """Return the change of each optimum's cost, relative to its natural size."""
    size = max(found.path.magnitude, 1e-300)
    changes = []
    for one in found.optima:
        polished = one.solution()
        # The finer grid may contradict it, as two of lynx_and_hares.
        assert polished.plan.feasible
        changes.append(abs(one.cost - polished.cost) / size)
    return changes


@pytest.mark.parametrize("name", SOLVED)
def test_optima_of_shipped_problems_stay_where_they_are(name: str) -> None:
    posed = first_problem(resolve(read_document(name)).posed())
    found = ss.solve(
        posed.problem, posed.x0, known=posed.known, search=None, repair=False, seed=0
    )
    if name != "bifunctional_catalyst":  # It is stiff, and has no lanes.
        assert found.optima
    assert max(moved_by_a_polish(found), default=0.0) < 1e-3


@pytest.fixture(scope="module")
def others() -> list[Case]:
    """Problems whose optima are known."""
    return [*multimodal.cases()[::3], *path_constrained.cases()[::4][:10]]


@pytest.mark.parametrize("number", range(20))
def test_optima_of_problems_with_known_ones_stay_where_they_are(
    others: list[Case], number: int
) -> None:
    case = others[number]
    found = ss.solve(problem_of(case), case.start, search=None, repair=False, seed=0)
    assert max(moved_by_a_polish(found), default=0.0) < 1e-3


def test_lane_that_was_stopped_early_is_unfinished_and_no_optimum() -> None:
    """On a long swing-up no lane is done after three steps."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    model = ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u - ca.sin(x[0])))
    problem = ss.OptimalControlProblem(
        model, horizon=6.0, intervals=30, stage_cost=ca.sumsqr(x) + u**2,
        bounds=ss.Bounds(controls=(-1, 1)),
    )  # fmt: skip

    rng = np.random.default_rng(0)
    controls = rng.uniform(-1, 1, (1, 30, 8))
    ended = []
    for most in (2, 300):
        solver = LaneSolver(problem, most=most)
        answers = solver([3.0, 0.0], controls)
        ended.append(sum(one.count for one in solver.optima(answers, [3.0, 0.0])))
    assert ended == [0, 8]
