"""Local solves in lanes, against closed forms and IPOPT from the same starts."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.benchmarks.problems import van_der_pol
from swarmstart.ocp import (
    Bounds,
    Free,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Planner,
)
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.lanes import solver as module
from swarmstart.ocp.lanes.answers import FEASIBLE, LaneAnswers, distinct_optima
from swarmstart.ocp.lanes.posed import NoLanesError
from swarmstart.ocp.lanes.solver import LaneSolver, random_starts
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.rollout.fitness import Fitness
from swarmstart.tests.ocp.lanes.problems import (
    bryson_denham,
    cart,
    four_discs,
    pendulum,
)

pytestmark = pytest.mark.usefixtures("compiler")


def solved(
    problem: OptimalControlProblem, x0: list[float], n: int = 64, threads: int = 1
) -> tuple[Planner, LaneAnswers]:
    """Return a planner of the problem and the answers from random starts."""
    planner = Planner(problem, search=None, polish=IpoptOptions())
    solver = LaneSolver(planner.fitness.shooting, threads=threads)
    controls, starts = random_starts(solver.problem, n, np.random.default_rng(0))
    state = planner.lowered.start(x0)
    return planner, solver(state, controls, starts)


@pytest.mark.parametrize(
    ("pose", "x0", "optima"),
    [
        (pendulum, [0.0, 0.0], [36.7126]),
        (bryson_denham, [0.0, 1.0], [4.0034]),
        (four_discs, [0.0, 0.0, 0.0], [10.8186, 10.8435]),
    ],
)
def test_optima_are_those_that_ipopt_confirms_in_few_iterations(
    pose: Callable[[], OptimalControlProblem], x0: list[float], optima: list[float]
) -> None:
    """The values: shared with IPOPT from 40 starts of its own."""
    planner, answers = solved(pose(), x0)
    found = distinct_optima(answers)
    costs = [one.cost for one in found]
    for optimum in optima:
        assert np.abs(np.array(costs) - optimum).min() < 1e-4
    assert (answers.violation <= FEASIBLE).mean() >= 0.95
    best = found[0].lane
    core = planner.problem
    state = planner.lowered.start(x0)
    for row, one in zip(answers.starts, core.free_starts, strict=True):
        state[list(one.states)] = row[best]
    assert planner.polisher is not None
    polished = planner.polisher(answers.controls[:, :, best], state, near=True)
    assert polished.cost == pytest.approx(found[0].cost, rel=1e-6)
    assert polished.iterations <= 8


def test_least_energy_is_that_of_the_closed_form() -> None:
    """From rest to rest over 1 in 1 s it is 6; with N steps 6 / (1 - 1 / N^2)."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], u)),
        horizon=1.0, intervals=50, stage_cost=u**2 / 2,
        bounds=Bounds(controls=(-20, 20)), terminal=[x - ca.vertcat(1, 0)],
    )  # fmt: skip
    _, answers = solved(problem, [0.0, 0.0], n=8)
    least = 6 / (1 - 1 / 50**2)
    # The end may be missed by 1e-7 of the 20 m/s that the controls could reach.
    np.testing.assert_allclose(answers.cost, least, rtol=2e-6)
    assert answers.violation.max() <= 1e-7


def test_box_of_controls_is_kept_and_nearly_reached() -> None:
    instance = van_der_pol()
    planner, answers = solved(instance.problem, instance.x0.tolist(), n=16)
    lower, upper = instance.problem.control_limits
    assert answers.controls.min() >= lower[0]
    assert answers.controls.max() <= upper[0]
    assert answers.controls.max() >= upper[0] - 1e-5
    np.testing.assert_allclose(answers.cost, 2.86937, rtol=1e-5)
    value = planner.fitness.value(answers.controls[:, :, 0], instance.x0)
    assert value[0] == pytest.approx(answers.cost[0], rel=1e-9)
    assert value[1] == 0.0


def test_rows_with_controls_and_two_limits_hold() -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], u)),
        horizon=1.0, intervals=50, stage_cost=u**2 / 2, substeps=2,
        bounds=Bounds(controls=(-30, 30)), terminal=[x - ca.vertcat(1, 0)],
        constraints=[PathConstraint(expression=u * x[1], lower=-2.75, upper=2.75)],
    )  # fmt: skip
    planner, answers = solved(problem, [0.0, 0.0], n=16)
    plan = planner.plan([0.0, 0.0], rng=np.random.default_rng(0))
    good = answers.violation <= FEASIBLE
    assert good.mean() >= 0.9
    assert answers.cost[good].min() == pytest.approx(plan.cost, rel=1e-5)
    np.testing.assert_allclose(answers.cost[good], plan.cost, rtol=1e-3)


def test_soft_constraints_and_free_starts_are_solved_for() -> None:
    """Against IPOPT: excesses are controls, and the start is decided in a box."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u - x),
        horizon=2.0, intervals=20, stage_cost=(x - 1) ** 2 + 0.1 * u**2,
        initial_cost=(x - 0.2) ** 2, start={"x": Free(-1, 1)},
        constraints=[PathConstraint(expression=x, upper=0.6, weight=0.3)],
        bounds=Bounds(controls=(-3, 3)),
    )  # fmt: skip
    planner, answers = solved(problem, [np.nan], n=16)
    plan = planner.plan(planner.lowered.start([np.nan]), rng=np.random.default_rng(0))
    np.testing.assert_allclose(answers.cost, plan.cost, rtol=1e-6)
    np.testing.assert_allclose(answers.starts[0], plan.states[0, 0], rtol=1e-3)


def test_lane_does_not_depend_on_its_neighbours() -> None:
    """In another order, and without half of the others."""
    shooting = Fitness(pendulum()).shooting
    solver = LaneSolver(shooting)
    controls, starts = random_starts(solver.problem, 6, np.random.default_rng(0))

    def costs(order: list[int]) -> Array:
        return solver([0.0, 0.0], controls[:, :, order], starts[:, order]).cost

    together = costs([0, 1, 2, 3, 4, 5])
    np.testing.assert_array_equal(
        costs([4, 0, 2, 5, 3, 1]), together[[4, 0, 2, 5, 3, 1]]
    )
    np.testing.assert_array_equal(costs([5, 1, 3]), together[[5, 1, 3]])


def test_answers_have_the_same_bits_on_two_threads() -> None:
    """A free end time makes long and short lanes."""
    shooting = Fitness(four_discs()).shooting
    controls, starts = random_starts(shooting.problem, 41, np.random.default_rng(0))
    one, *others = (
        LaneSolver(shooting, threads=threads)([0.0, 0.0, 0.0, 10.0], controls, starts)
        for threads in (1, 2, 3, 64)
    )
    for other in others:
        for name in one.__slots__:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_no_starts_have_no_answers() -> None:
    _, answers = solved(cart(), [0.0, 1.0], n=0)
    assert answers.controls.shape == (1, 50, 0)
    assert not distinct_optima(answers)


def test_lane_that_leaves_the_numbers_ends_infinite() -> None:
    """x' = x^2 explodes from 1 at t = 1, whatever small control acts."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.exp(x**2) + 1e-3 * u),
        horizon=5.0, intervals=20, stage_cost=u**2, bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    _, answers = solved(problem, [1.0], n=4)
    assert np.isinf(answers.cost).all()
    assert np.isinf(answers.violation).all()
    assert not distinct_optima(answers)


def test_lane_that_ends_where_limits_cannot_be_met_begins_once_more() -> None:
    """Bring an unstable system to rest in a time of one's own choice.

    A lane whose broken rows are cheap makes the time short before it is near the end,
    and then cannot come nearer: without a second attempt a seventh of them ends well.
    """
    rng = np.random.default_rng(3)
    rng.integers(2, 5), rng.integers(1, 3)
    A, B = ca.SX(0.7 * rng.normal(size=(4, 4))), ca.SX(rng.normal(size=(4, 1)))
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=A @ x + B * u), horizon=Free(0.2, 8),
        intervals=30, stage_cost=1 + 0.1 * u**2, substeps=2, terminal=[x],
        bounds=Bounds(controls=(-3, 3)),
    )  # fmt: skip
    _, answers = solved(problem, rng.normal(size=4).tolist())
    assert (answers.violation <= FEASIBLE).mean() >= 0.9
    assert answers.iterations.max() > 60  # Steps of both attempts count.
    np.testing.assert_allclose(answers.cost, 6.7447, rtol=1e-4)


def test_reason_is_given_where_lanes_do_not_serve() -> None:
    with pytest.raises(NoLanesError, match="blocks of intervals"):
        LaneSolver(cart(blocks=[25, 25]))
    with pytest.raises(NoLanesError, match="collocates"):
        LaneSolver(cart(transcription="radau"))


def test_steps_that_llvm_would_need_minutes_for_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Instructions of an interval are counted first, which takes no derivatives."""
    monkeypatch.setattr(module, "_LONGEST", 400)
    with pytest.raises(NoLanesError, match="too long: expected at most 50 "):
        LaneSolver(pendulum())
    monkeypatch.setattr(module, "_LONGEST", 1300)
    with pytest.raises(NoLanesError, match=r"too long: expected at most 1300 "):
        LaneSolver(four_discs())


def test_starts_of_another_shape_are_refused() -> None:
    solver = LaneSolver(cart())
    with pytest.raises(InvalidProblemError, match=r"shape \(1, 50, n\)"):
        solver([0.0, 1.0], np.zeros((1, 49, 3)))
    with pytest.raises(InvalidProblemError, match="must be finite"):
        solver([0.0, 1.0], np.full((1, 50, 3), np.nan))


def test_random_starts_are_smooth_and_within_the_bounds() -> None:
    controls, starts = random_starts(
        LaneSolver(four_discs()).problem, 200, np.random.default_rng(0)
    )
    assert controls.shape == (1, 40, 200)
    assert np.abs(controls).max() <= 3
    assert starts.min() >= 10
    assert starts.max() <= 20
    assert np.abs(np.diff(controls[0, :, ::2], axis=0)).max() <= 6 * 5 / 39 + 1e-12


def test_start_is_used_as_given() -> None:
    """A lane that starts at an optimum ends there."""
    planner, answers = solved(pendulum(), [0.0, 0.0], n=8)
    best = int(answers.cost.argmin())
    start = Start(answers.controls[:, :, best])
    solver = LaneSolver(planner.fitness.shooting)
    again = solver([0.0, 0.0], start.controls[:, :, None])
    assert again.cost[0] == pytest.approx(answers.cost[best], rel=1e-5)
