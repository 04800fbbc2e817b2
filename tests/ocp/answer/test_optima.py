"""Optima that lanes list are optima: a polish moves none of them."""

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.benchmarks.same_bits import SOLVED
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.ocp.lanes.answers import reached
from swarmstart.ocp.lanes.solver import FINISHED, LaneSolver
from swarmstart.ocp.lanes.stages import LaneOptions
from swarmstart.ocp.nlp.optimality import unmet
from swarmstart.ocp.nlp.transcription import multiple_shooting
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


OTHERS = [*multimodal.cases()[::3], *path_constrained.cases()[::4][:10]]


@pytest.mark.parametrize("case", OTHERS, ids=lambda case: case.name)
def test_optima_of_problems_with_known_ones_stay_where_they_are(case: Case) -> None:
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
    for most in (2, 500):
        solver = LaneSolver(problem, options=LaneOptions(most=most))
        answers = solver([3.0, 0.0], controls, rng=np.random.default_rng(1))
        assert reached(answers).all()
        ended.append(sum(one.count for one in solver.optima(answers, [3.0, 0.0])))
    assert ended == [0, 8]


def test_unmet_conditions_are_the_slope_that_no_limit_explains() -> None:
    """u in (-1, 1), cost (u - 3)^2 / 2: at 1 the bound explains the slope of -2."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=1,
        stage_cost=(u - 3) ** 2 / 2, bounds=ss.Bounds(controls=(-1, 1)),
        scales={"x": 1.0, "u": 1.0},
    )  # fmt: skip
    fitness = ss.Fitness(problem, backend="casadi")

    program = multiple_shooting(fitness.shooting)
    sizes = fitness.arguments.sizes([0.0], ss.Known())
    q = program.arguments(np.zeros(1), np.empty(0), np.empty(0), sizes)
    limits = program.limits(sizes)
    for value, left in ((1.0, 0.0), (0.5, 2.5), (-1.0, 4.0)):
        w = program.variables(np.array([[value]]), np.array([[0.0, value]]), sizes)
        assert unmet(program, w, q, limits) * sizes.cost == pytest.approx(
            left, abs=1e-8
        )
    assert FINISHED < 1
