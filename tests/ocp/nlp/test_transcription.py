"""The NLP is the rollout with its states as variables, scaled to about one."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Fitness,
    Known,
    OptimalControlProblem,
    TerminalConstraint,
)
from swarmstart.ocp.nlp.transcription import NonlinearProgram, multiple_shooting
from swarmstart.ocp.rollout.fitness import NOTHING, shared_arguments
from swarmstart.ocp.rollout.scaling import Sizes

Posed = tuple[OptimalControlProblem, Array, Known]


@pytest.fixture(scope="module")
def demanding(crossing: Posed) -> Posed:
    """`crossing` with a terminal constraint and every constraint at points."""
    problem, x0, known = crossing
    constraints = [replace(c, along="points") for c in problem.constraints]  # type: ignore[type-var]
    end = TerminalConstraint(expression=problem.model.states[2:], lower=-40, upper=40)
    return replace(problem, constraints=constraints, terminal=[end]), x0, known


def at_rollout(
    program: NonlinearProgram, fitness: Fitness, controls: Array, posed: Posed
) -> tuple[Array, Array, Array, Sizes]:
    """Return w and q of a rollout, its states and the sizes."""
    problem, x0, known = posed
    states = fitness.states(controls, x0, known)
    sizes = fitness.arguments.sizes_along(controls, states, x0, known)
    checks = problem.checks
    w = program.variables(controls, states[:, ::checks], sizes)
    q = program.arguments(*shared_arguments(problem, x0, known), sizes)
    return w, q, states, sizes


def test_rolled_out_point_has_the_rollouts_cost_and_no_defects(
    demanding: Posed,
) -> None:
    problem, _, known = demanding
    program, fitness = multiple_shooting(problem), Fitness(problem)
    values = ca.Function(
        "nlp",
        [program.nlp["x"], program.nlp["p"]],
        [program.nlp["f"], program.nlp["g"]],
    )
    rng, (lower, upper) = np.random.default_rng(0), problem.control_limits
    for _ in range(20):
        controls = rng.uniform(lower, upper, (3, 2)).T
        w, q, states, sizes = at_rollout(program, fitness, controls, demanding)
        f, g = values(w, q)
        cost = fitness.value(controls, demanding[1], known)[0]
        assert float(f) * sizes.cost == pytest.approx(cost, rel=1e-13)
        rows, ends = np.array(g).ravel()[:-2].reshape(3, -1), np.array(g).ravel()[-2:]
        np.testing.assert_allclose(rows[:, :4], 0, atol=1e-12)
        # Per check: disc and separations, relative to their distances; only the search
        # uses the disc's margin. The speed is a row between the intervals' ends.
        other = states[2:] - np.asarray(known.signals)[4:]
        centre = states[2:] - np.array([[15.0], [1.0]])
        gaps = np.array(
            [
                ((relative**2).sum(axis=0) - limit**2) / (2 * limit) / limit
                for relative, limit in ((centre, 4.0), (other, 3.0), (other, 6.0))
            ]
        )
        np.testing.assert_allclose(rows[:, 4:7], gaps[:, 1::2].T, 1e-9)
        np.testing.assert_allclose(rows[:, 7], states[0, 1::2] / 12, 1e-12)
        np.testing.assert_allclose(rows[:, 8:], gaps[:, 2::2].T, 1e-9)
        np.testing.assert_allclose(ends, states[2:, -1] / 80, 1e-12)


def test_limits_stand_beside_their_rows(demanding: Posed) -> None:
    program, fitness = multiple_shooting(demanding[0]), Fitness(demanding[0])
    sizes = fitness.arguments.sizes(demanding[1], demanding[2])
    limits, inf = program.limits(sizes), np.inf
    width = np.array([10.0, 2.0])
    np.testing.assert_array_equal(sizes.controls, width)
    first = [*([-5, -1] / width), 0 / sizes.states[0], *[-inf] * 3]
    assert limits.lbx.tolist() == first * 3
    assert limits.ubx.tolist()[:3] == [0.5, 0.5, 12 / sizes.states[0]]
    rows = [0] * 4 + [0] * 3 + [0] + [0] * 3
    assert limits.lbg.tolist() == rows * 3 + [-0.5] * 2
    most = [0] * 4 + [inf] * 3 + [1] + [inf] * 3
    assert limits.ubg.tolist() == most * 3 + [0.5] * 2
    assert program.nlp["x"].numel() == limits.lbx.size
    assert program.nlp["g"].numel() == limits.lbg.size


def test_problem_without_constraints_has_defects_only(
    lq: OptimalControlProblem,
) -> None:
    program = multiple_shooting(lq)
    assert program.nlp["g"].numel() == 20
    sizes = Fitness(lq).arguments.sizes([1, 1], NOTHING)
    assert np.isinf(program.limits(sizes).lbx).all()
    bounded = replace(lq, bounds=Bounds(states=(-1, 1)), checks=1)
    assert multiple_shooting(bounded).nlp["g"].numel() == 20


def test_defects_couple_neighbouring_intervals_only(lq: OptimalControlProblem) -> None:
    pattern = multiple_shooting(lq).derivatives["jac_g"].sparsity_out(1)
    rows, columns = np.array(pattern.get_triplet())
    # w is (u_0, x_1, u_1, x_2, ...), with two states and one control.
    interval, is_state = columns // 3, columns % 3 > 0
    distance = rows // 2 - interval
    assert set(distance[~is_state]) == {0}
    assert set(distance[is_state]) == {0, 1}


def test_derivatives_are_those_that_casadi_finds(demanding: Posed) -> None:
    program = multiple_shooting(demanding[0])
    whole = ca.Function(
        "whole",
        [program.nlp["x"], program.nlp["p"]],
        [program.nlp["f"], program.nlp["g"]],
    )
    w, q = (ca.MX.sym(name, whole.numel_in(i)) for i, name in enumerate("wq"))
    f, g = whole(w, q)
    lam_f, lam_g = ca.MX.sym("lf"), ca.MX.sym("lg", g.numel())
    lagrangian = lam_f * f + ca.dot(lam_g, g)
    hessian = ca.triu(ca.hessian(lagrangian, w)[0])
    expected = ca.Function(
        "expected",
        [w, q, lam_f, lam_g],
        [ca.gradient(f, w), ca.jacobian(g, w), hessian],
    )
    rng, fitness = np.random.default_rng(1), Fitness(demanding[0])
    lower, upper = demanding[0].control_limits
    controls = rng.uniform(lower, upper, (3, 2)).T
    point, arguments, _, _ = at_rollout(program, fitness, controls, demanding)
    point = point + 0.01 * rng.normal(size=point.size)
    lam = rng.normal(size=lam_g.numel())
    found = [
        program.derivatives["grad_f"](point, arguments)[1],
        program.derivatives["jac_g"](point, arguments)[1],
        program.derivatives["hess_lag"](point, arguments, 0.7, lam),
    ]
    for one, other in zip(found, expected(point, arguments, 0.7, lam), strict=True):
        np.testing.assert_allclose(
            np.array(ca.densify(one)),
            np.array(ca.densify(other)),
            rtol=1e-9,
            atol=1e-12,
        )
