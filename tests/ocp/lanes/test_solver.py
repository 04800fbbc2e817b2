"""Local solves in lanes, against closed forms and IPOPT from the same starts."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.benchmarks.problems import reactor, van_der_pol
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
from swarmstart.ocp.compiled import scan
from swarmstart.ocp.compiled.engine import NoCompilerError
from swarmstart.ocp.lanes import ddp
from swarmstart.ocp.lanes import solver as module
from swarmstart.ocp.lanes.answers import FEASIBLE, LaneAnswers, distinct_optima
from swarmstart.ocp.lanes.solver import LaneSolver, NoLanesError, random_starts
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
    rng = np.random.default_rng(0)
    controls, starts = random_starts(solver.problem, n, rng)
    state = planner.lowered.start(x0)
    return planner, solver(state, controls, starts, rng=rng)


def too_long(*_: object, **__: object) -> None:
    """Stand in for a compiler that refuses a kernel."""
    raise NoCompilerError("too long")


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


def test_quadratic_problem_takes_the_steps_of_riccati() -> None:
    """Without limits the first whole step is Newton's: the second gains nothing."""
    x = ca.SX.sym("x", 2)
    u = ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], -x[0] + u)),
        horizon=2.0, intervals=20, stage_cost=ca.sumsqr(x) + u**2,
        terminal_cost=3 * ca.sumsqr(x), bounds=Bounds(controls=(-50, 50)),
    )  # fmt: skip
    _, answers = solved(problem, [1.0, 0.5], n=8)
    assert answers.iterations.max() <= 5
    polished = Planner(problem, search=None, polish=IpoptOptions()).plan(
        [1.0, 0.5], rng=np.random.default_rng(0)
    )
    np.testing.assert_allclose(answers.cost, polished.cost, rtol=1e-9)


def test_box_of_controls_is_kept_exactly() -> None:
    instance = van_der_pol()
    planner, answers = solved(instance.problem, instance.x0.tolist(), n=16)
    lower, upper = instance.problem.control_limits
    assert answers.controls.min() >= lower[0]
    assert answers.controls.max() <= upper[0]
    assert (answers.controls == upper[0]).any()
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
    weights = 10.0 ** np.linspace(-1, 3, 6)

    def costs(order: list[int]) -> Array:
        given = controls[:, :, order], starts[:, order]
        firsts = np.ones(len(order)), weights[order]
        return solver.solved(solver.posed([0.0, 0.0]), *given, firsts).cost

    together = costs([0, 1, 2, 3, 4, 5])
    np.testing.assert_array_equal(
        costs([4, 0, 2, 5, 3, 1]), together[[4, 0, 2, 5, 3, 1]]
    )
    np.testing.assert_array_equal(costs([5, 1, 3]), together[[5, 1, 3]])


def test_answers_have_the_same_bits_on_two_threads(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And with other lanes side by side; a free end time makes long and short lanes."""
    shooting = Fitness(four_discs()).shooting
    controls, starts = random_starts(shooting.problem, 41, np.random.default_rng(0))
    x0 = [0.0, 0.0, 0.0, 10.0]

    def answers(threads: int, side_by_side: int) -> LaneAnswers:
        monkeypatch.setattr(ddp, "SIDE_BY_SIDE", side_by_side)
        solver = LaneSolver(shooting, threads=threads)
        return solver(x0, controls, starts, rng=np.random.default_rng(1))

    one = answers(1, 32)
    for threads, side_by_side in ((2, 32), (1, 64), (1, 5), (3, 8), (64, 32)):
        other = answers(threads, side_by_side)
        for name in one.__slots__:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_slopes_give_the_same_bits_on_two_threads(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "compile_sweeps", too_long)
    one, two = (
        solved(bryson_denham(), [0.0, 1.0], n=520, threads=t)[1] for t in (1, 2)
    )
    for name in one.__slots__:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


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


def test_lane_comes_back_where_light_weights_have_no_least() -> None:
    """With r below 2, -x^2 + r/2 (x - 2)^2 falls without end; x may be exp(50)."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u * x), horizon=1.0, intervals=20,
        stage_cost=1e-3 * u**2, terminal_cost=-(x**2), terminal=[x - 2],
        bounds=Bounds(controls=(-50, 50)),
    )  # fmt: skip
    solver = LaneSolver(problem)
    controls, starts = random_starts(solver.problem, 32, np.random.default_rng(0))
    weights = np.ones(32), np.full(32, 0.1)
    found = solver.solved(solver.posed([1.0]), controls / 20, starts, weights)
    assert (found.violation <= FEASIBLE).mean() >= 0.95
    least = 1e-3 * np.log(2) ** 2 - 4  # A constant control is the cheapest.
    assert np.median(found.cost) == pytest.approx(least, rel=1e-4)


def test_lane_that_is_given_up_begins_once_more() -> None:
    """Bring an unstable system to rest in a time of one's own choice.

    Where a lane makes the time short before it is near the end, the nearest way there
    is farther from it; a third of the lanes ended well as long as they began but once.
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
    assert (answers.violation <= FEASIBLE).mean() >= 0.65


def test_reason_is_given_where_lanes_do_not_serve() -> None:
    with pytest.raises(NoLanesError, match="blocks of intervals"):
        LaneSolver(cart(blocks=[25, 25]))
    with pytest.raises(NoLanesError, match="collocates"):
        LaneSolver(cart(transcription="radau"))


def test_long_stages_are_solved_by_slopes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Luus' reactor: both of its optima on this grid, and no other."""
    instance = reactor()
    monkeypatch.setattr(scan, "MOST_INSTRUCTIONS", 10_000)
    assert LaneSolver(instance.problem).method == "slopes"
    planner, answers = solved(instance.problem, instance.x0.tolist(), n=64)
    found = distinct_optima(answers)
    assert [round(one.cost, 4) for one in found] == [0.1356, 0.2446]
    polished = planner.polisher
    assert polished is not None
    for one in found:
        better = polished(answers.controls[:, :, one.lane], instance.x0, near=True)
        assert better.cost == pytest.approx(one.cost, rel=1e-6)


def test_slopes_find_what_sweeps_find(monkeypatch: pytest.MonkeyPatch) -> None:
    """End conditions, path constraints and a free end time by gradients alone."""
    x0 = [0.0, 0.0, 0.0]
    _, sweeps = solved(four_discs(), x0, n=32)

    monkeypatch.setattr(module, "compile_sweeps", too_long)
    _, slopes = solved(four_discs(), x0, n=32)
    best = [distinct_optima(answers)[0].cost for answers in (sweeps, slopes)]
    assert best[1] == pytest.approx(best[0], rel=1e-4)


def test_starts_of_another_shape_are_refused() -> None:
    solver = LaneSolver(cart())
    rng = np.random.default_rng(0)
    with pytest.raises(InvalidProblemError, match=r"shape \(1, 50, n\)"):
        solver([0.0, 1.0], np.zeros((1, 49, 3)), rng=rng)
    with pytest.raises(InvalidProblemError, match="must be finite"):
        solver([0.0, 1.0], np.full((1, 50, 3), np.nan), rng=rng)


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
    again = solver([0.0, 0.0], start.controls[:, :, None], rng=np.random.default_rng(3))
    assert again.cost[0] == pytest.approx(answers.cost[best], rel=1e-5)
