"""Interior-point lanes: closed forms, independence of lanes, and hard cases."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Free,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Start,
)
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.lanes import interior
from swarmstart.ocp.lanes.answers import LaneAnswers
from swarmstart.ocp.lanes.interior import Instances
from swarmstart.ocp.lanes.solver import random_starts
from swarmstart.tests.ocp.lanes.interior_problems import Posed, every_kind, posed
from swarmstart.tests.ocp.lanes.problems import bryson_denham

pytestmark = pytest.mark.usefixtures("compiler")

A, B = np.array([[1.1, 0.3], [-0.2, 0.9]]), np.array([[0.1], [0.4]])
Q, R, P = np.diag([1.0, 0.5]), 0.2, np.diag([3.0, 1.0])
N = 12
NAMES = (
    "controls", "starts", "states", "cost", "violation", "iterations", "costates",
)  # fmt: skip


def linear_quadratic(most: float = np.inf) -> OptimalControlProblem:
    """x+ = A x + B u, cost x'Qx + R u^2 and x'Px at the end, |u| <= most."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return OptimalControlProblem(
        Model(states=x, controls=u, next_state=A @ x + B @ u),
        horizon=1.0, intervals=N,
        step_cost=ca.bilin(ca.DM(Q), x, x) + R * u**2,
        terminal_cost=ca.bilin(ca.DM(P), x, x),
        bounds=Bounds(controls=(-most, most)),
    )  # fmt: skip


def sliding(**more: object) -> OptimalControlProblem:
    """A double integrator that costs x'x + u^2 for two seconds, or as said."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    given: dict[str, object] = {
        "horizon": 2.0, "intervals": 10, "stage_cost": ca.sumsqr(x) + u**2,
        "substeps": 1, "bounds": Bounds(controls=(-3, 3)),
    }  # fmt: skip
    for name, value in more.items():
        given[name] = value(x, u) if callable(value) else value
    model = Model(states=x, controls=u, ode=ca.vertcat(x[1], u))
    return OptimalControlProblem(model, **given)  # type: ignore[arg-type]


def between(x: ca.SX, _: ca.SX) -> list[PathConstraint]:
    """A speed within limits, the upper of which is met."""
    return [PathConstraint(expression=x[1], lower=-0.5, upper=0.1)]


def differing(first: LaneAnswers, second: LaneAnswers) -> list[str]:
    """Return the names of what does not have the same bits."""
    pairs = ((name, getattr(first, name), getattr(second, name)) for name in NAMES)
    return [n for n, a, b in pairs if not np.array_equal(a, b, equal_nan=True)]


def chosen(answers: LaneAnswers, lanes: NDArray[np.int64]) -> LaneAnswers:
    """Return the answers of some lanes."""
    return LaneAnswers(**{
        name: getattr(answers, name)[..., lanes] for name in NAMES
    })  # fmt: skip


def test_without_limits_answers_are_those_of_riccati() -> None:
    rng = np.random.default_rng(0)
    x0 = rng.normal(size=(2, 100))
    case = posed(linear_quadratic())
    answers = case.solved(case.instances(x0), rng.normal(size=(1, N, 100)))
    gains, value = list[Array](), P
    for _ in range(N):
        K = np.linalg.solve(R + B.T @ value @ B, B.T @ value @ A)
        gains.insert(0, K)
        value = Q + A.T @ value @ (A - B @ K)
    np.testing.assert_allclose(answers.cost, np.sum(x0 * (value @ x0), 0), rtol=1e-8)
    np.testing.assert_allclose(answers.costates, 2 * value @ x0, rtol=1e-8, atol=1e-8)
    x = x0
    for k, K in enumerate(gains):
        u = -K @ x
        np.testing.assert_allclose(answers.controls[:, k], u, rtol=1e-8, atol=1e-8)
        x = A @ x + B @ u
    assert answers.violation.max() <= 1e-9
    assert answers.iterations.max() <= 3


@pytest.mark.parametrize("limited", [False, True])
def test_costates_are_the_differences_of_optimal_costs(limited: bool) -> None:
    """Of a speed that meets its limit, and of an end that must be reached."""
    more: dict[str, object] = {"terminal": lambda x, u: [x]}
    if limited:
        more = {"constraints": between}
    case = posed(sliding(**more))
    h, x0 = 1e-4, np.array([[-0.3], [0.05]])
    steps = h * np.array([[0, 1, -1, 0, 0], [0, 0, 0, 1, -1.0]])
    answers = case.solved(case.instances(x0 + steps))
    _, right, left, up, down = answers.cost
    expected = np.array([right - left, up - down]) / (2 * h)
    np.testing.assert_allclose(answers.costates[:, 0], expected, rtol=2e-5)


def test_with_limits_answers_are_those_of_an_active_set_method() -> None:
    """Bounded least squares over the controls, by SciPy's BVLS."""
    most, rng = 0.4, np.random.default_rng(1)
    x0 = rng.normal(size=(2, 6))
    case = posed(linear_quadratic(most))
    answers = case.solved(case.instances(x0))
    found = 0
    for lane in range(6):
        free, forced = x0[:, lane], np.zeros((2, N))
        rows, right = [np.sqrt(R) * np.eye(N)], [np.zeros(N)]
        for k in range(N + 1):
            root = np.sqrt(P if k == N else Q)
            rows.append(root @ forced)
            right.append(-root @ free)
            if k < N:
                free = A @ free
                forced = A @ forced
                forced[:, k] += B[:, 0]
        exact = lsq_linear(
            np.vstack(rows), np.concatenate(right), (-most, most), method="bvls",
            tol=1e-14,
        )  # fmt: skip
        found += int(np.sum(np.abs(exact.x) > 0.999 * most))
        assert answers.cost[lane] == pytest.approx(2 * exact.cost, rel=1e-7)
        np.testing.assert_allclose(answers.controls[0, :, lane], exact.x, atol=2e-5)
    assert found >= 6
    assert np.abs(answers.controls).max() <= most


def test_least_time_is_that_of_bang_bang() -> None:
    """From a metre to rest with 1 m/s^2: 2 s; from d metres 2 sqrt(d) seconds."""
    case = posed(sliding(
        horizon=Free(0.5, 8, guess=3), stage_cost=ca.SX(1), intervals=20,
        bounds=Bounds(controls=(-1, 1)), terminal=lambda x, _: [(x[0], 0), (x[1], 0)],
    ))  # fmt: skip
    way = np.array([1.0, 2.0, 4.0])
    answers = case.solved(case.instances(np.vstack([way, 0 * way])))
    np.testing.assert_allclose(answers.cost, 2 * np.sqrt(way), rtol=1e-6)
    np.testing.assert_allclose(answers.controls[0, :10], -1, atol=1e-4)
    np.testing.assert_allclose(answers.controls[0, 10:], 1, atol=1e-4)


def test_state_bound_is_met_from_either_side() -> None:
    """Bryson and Denham: x <= 1/9, cost 4 in the limit; and mirrored, x >= -1/9."""
    case = posed(bryson_denham())
    answers = case.solved(case.instances(np.array([[0.0], [1.0]])))
    assert answers.cost[0] == pytest.approx(4.0034354, rel=1e-6)
    sizes = case.lanes.common(case.instances(np.array([[0.0], [1.0]]))).posed.sizes
    reached = answers.states[0] * sizes.states[0]
    assert reached.max() == pytest.approx(1 / 9, abs=1e-7)
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    mirrored = posed(OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], u)),
        horizon=1.0, intervals=50, stage_cost=u**2 / 2, substeps=2,
        bounds=Bounds(controls=(-20, 20),
                      states=([-1 / 9, -np.inf], [np.inf, np.inf])),
        terminal=[x - ca.vertcat(0, 1)],
    ))  # fmt: skip
    other = mirrored.solved(mirrored.instances(np.array([[0.0], [-1.0]])))
    assert other.cost[0] == pytest.approx(answers.cost[0], rel=1e-7)


class Many:
    """Lanes of all kinds of rows from random starts, one of them bad."""

    def __init__(self) -> None:
        """Draw data and starts."""
        self.M, rng = 21, np.random.default_rng(2)
        self.case = posed(every_kind())
        x0 = np.vstack([rng.uniform(-1, 1, self.M), np.zeros(self.M)])
        parameters = rng.uniform(0.5, 4, (1, self.M))
        self.instances = Instances(x0, parameters, np.zeros((0, self.M)))
        self.controls, self.starts = random_starts(self.case.lanes.problem, self.M, rng)
        self.controls[1, 0, 5] = np.nan
        self.common = self.case.lanes.common(self.instances)
        self.answers = self.of(np.arange(self.M))

    def of(self, lanes: NDArray[np.int64], threads: int = 1) -> LaneAnswers:
        """Return the answers of some lanes, in this order."""
        return self.case.lanes(
            self.instances.at(lanes), self.controls[:, :, lanes],
            self.starts[:, lanes], common=self.common, threads=threads,
        )  # fmt: skip


@pytest.fixture(scope="module")
def many() -> Many:
    """Some answers."""
    return Many()


def test_lanes_take_different_ways(many: Many) -> None:
    """Else the tests of independence below would say little."""
    assert np.unique(many.answers.iterations).size >= 5
    assert 8 <= (many.answers.violation <= 1e-7).sum() <= many.M - 3


def test_where_ipopt_finds_an_answer_lanes_find_the_same(many: Many) -> None:
    """From the same starts, of which IPOPT leads fewer to feasible points."""
    found, planner = 0, many.case.planner
    for lane in range(many.M):
        x0, parameters = (one[:, lane].copy() for one in many.instances[:2])
        x0[1] = many.starts[0, lane]
        plan = planner.plan(
            x0, known=Known(parameters=parameters), rng=np.random.default_rng(0),
            guess=Start(np.nan_to_num(many.controls[:, :, lane]), x0=x0),
        )  # fmt: skip
        if plan.feasible:
            found += 1
            assert many.answers.violation[lane] <= 1e-7
            assert many.answers.cost[lane] == pytest.approx(plan.cost, rel=1e-6)
    assert 4 <= found <= (many.answers.violation <= 1e-7).sum()


def test_answer_is_the_same_beside_any_others(many: Many) -> None:
    order = np.random.default_rng(3).permutation(many.M)
    for lanes in (order, order[::3], np.array([7]), np.array([5])):
        assert not differing(many.of(lanes), chosen(many.answers, lanes))


@pytest.mark.parametrize(("fewest", "most"), [(1, 1), (1, 3), (2, 7)])
def test_answer_is_the_same_in_memories_of_any_width(
    many: Many, monkeypatch: pytest.MonkeyPatch, fewest: int, most: int
) -> None:
    monkeypatch.setattr(interior, "_FEWEST", fewest)
    monkeypatch.setattr(interior, "_MOST_SIDE_BY_SIDE", most)
    assert not differing(many.of(np.arange(many.M)), many.answers)


def test_answer_is_the_same_in_small_chunks(
    many: Many, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(interior, "_CHUNK", 1 << 11)
    assert not differing(many.of(np.arange(many.M)), many.answers)


@pytest.mark.parametrize("threads", [2, 64])
def test_answer_is_the_same_on_any_number_of_threads(many: Many, threads: int) -> None:
    assert not differing(many.of(np.arange(many.M), threads), many.answers)


def test_one_answer_and_none_have_their_shapes(many: Many) -> None:
    one, none = many.of(np.array([3])), many.of(np.zeros(0, dtype=np.int64))
    for answers, count in ((one, 1), (none, 0)):
        assert answers.controls.shape == (2, 4, count)
        assert answers.starts.shape == (1, count)
        assert answers.states.shape == (2, 5, count)
        assert answers.cost.shape == answers.iterations.shape == (count,)


def tracking() -> OptimalControlProblem:
    """Follow a signal; the model has another one."""
    x, u, s = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("s", 2)
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=u + s[0] * x, signals=s[0]),
        horizon=1.0, intervals=6, checks=2, substeps=1, signals=s,
        stage_cost=(x - s[1]) ** 2 + 0.1 * u**2, terminal_cost=(x - s[1]) ** 2,
        bounds=Bounds(controls=(-2, 2)),
        constraints=[PathConstraint(expression=x - s[1], upper=0.4)],
    )  # fmt: skip


def test_shared_signals_are_the_same_as_equal_own_ones() -> None:
    """A lane with other signals beside them makes each lane read its own."""
    case, rng = posed(tracking()), np.random.default_rng(4)
    one, other = rng.uniform(-1, 1, (2, 2, 13))
    x0 = np.array([[0.3, -0.2, 0.1, 0.0]])
    instances = case.instances(x0, [Known(signals=s) for s in (one, one, one, other)])
    three = instances.at(np.arange(3))
    common = case.lanes.common(three)
    controls, none = np.zeros((1, 6, 4)), np.zeros((0, 4))
    shared = case.lanes(three, controls[:, :, :3], none[:, :3], common=common)
    apart = common._replace(own_signals=True)
    own = case.lanes(instances, controls, none, common=apart)
    assert not differing(shared, chosen(own, np.arange(3)))
    assert own.cost[3] != own.cost[2]
    assert own.violation.max() <= 1e-7


def test_newly_begun_lane_is_not_moved_by_the_steps_of_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Every third lane has infinite steps, which a sweep for others would write."""
    x, u, a = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("a")
    after = x[0] + 0.1 * ca.sin(x[0]) + 0.1 * u, a * x[1] * (1 + 0.01 * u)
    case = posed(OptimalControlProblem(
        Model(states=x, controls=u, parameters=a, next_state=ca.vertcat(*after)),
        horizon=1.0, intervals=12, step_cost=ca.sumsqr(x) + u**4,
        terminal_cost=ca.sumsqr(x), bounds=Bounds(controls=(-3, 3)),
    ))  # fmt: skip
    M = 18
    x0 = np.vstack([np.linspace(0.2, 3, M), np.zeros(M)])
    rates = np.where(np.arange(M) % 3 == 2, 1e30, 1.0)[None]
    instances = Instances(x0, rates, np.zeros((0, M)))
    wide = case.solved(instances)
    monkeypatch.setattr(interior, "_FEWEST", 2)
    monkeypatch.setattr(interior, "_MOST_SIDE_BY_SIDE", 5)
    assert not differing(case.solved(instances), wide)
    assert np.isfinite(wide.cost).all()
    assert (wide.iterations[2::3] == 0).all()


BAD = np.nan, np.inf, 1e300


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("place", [0, 2, 4])
def test_initial_state_that_is_no_number_spoils_no_other_answer(
    place: int, bad: float
) -> None:
    case = posed(sliding(constraints=between))
    x0 = np.array([[1.0, 0.9, 0.8, 0.7, 0.6], [0.1, 0, 0, 0, 0]])
    good = case.solved(case.instances(x0))
    instances = case.instances(x0)
    instances.x0[0, place] = bad
    answers = case.solved(instances)
    assert np.isinf(answers.cost[place]) or answers.violation[place] > 1e3
    assert answers.violation[place] > 1e3
    others = np.delete(np.arange(5), place)
    np.testing.assert_allclose(answers.cost[others], good.cost[others], rtol=1e-8)
    assert answers.violation[others].max() <= 1e-7


def test_sizes_are_not_those_of_a_distant_instance() -> None:
    """With the sizes of 1e8 all others would seem to meet their limits."""
    case = posed(bryson_denham())
    x0 = np.array([[1e8, 0.0, -0.05, -0.1], [1.0, 1, 1, 1]])
    answers = case.solved(case.instances(x0))
    alone = case.solved(case.instances(x0[:, 1:]))
    np.testing.assert_allclose(answers.cost[1:], alone.cost, rtol=1e-8)
    assert answers.violation[0] > 1e3


def test_instances_none_of_which_is_finite_are_refused() -> None:
    case = posed(sliding())
    bad = Instances(np.full((2, 3), np.nan), np.zeros((0, 3)), np.zeros((0, 3)))
    with pytest.raises(InvalidProblemError, match="x0 must be finite"):
        case.solved(bad)


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("what", ["controls", "states", "parameters"])
def test_start_that_is_no_number_spoils_no_other_answer(
    many: Many, what: str, bad: float
) -> None:
    lanes = np.array([0, 1, 2, 3])
    case, problem = many.case, many.case.lanes.problem
    some = many.instances.at(lanes)
    controls = many.controls[:, :, lanes].copy()
    states = np.repeat(some.x0[:, None], problem.intervals + 1, axis=1)

    def answers() -> LaneAnswers:
        starts = many.starts[:, lanes]
        return case.lanes(some, controls, starts, states, common=many.common)

    before = answers()
    {"controls": controls[0, 1], "states": states[1, 2],
     "parameters": some.parameters[0]}[what][1] = bad  # fmt: skip
    after = answers()
    others = np.array([0, 2, 3])
    assert not differing(chosen(after, others), chosen(before, others))
    # Both have bounds, into which a lane moves what it is given.
    if what != "parameters":
        assert after.violation[1] <= 1e-7
    else:
        assert np.isinf(after.cost[1]) or after.violation[1] > 1e-3


@pytest.mark.parametrize("limits", ["path", "end", "reach"])
def test_limits_that_contradict_end_with_a_violation(limits: str) -> None:
    contradiction: dict[str, Callable[[ca.SX, ca.SX], object]] = {
        "path": lambda x, _: [
            PathConstraint(expression=x[0], lower=2.5),
            PathConstraint(expression=x[0] + x[1], upper=-1.0),
        ],
        "end": lambda x, _: [(x[0], 1.0), (2 * x[0], 0.0)],
        "reach": lambda x, _: [(x[0], 100.0)],
    }
    name = "constraints" if limits == "path" else "terminal"
    case = posed(sliding(**{name: contradiction[limits]}))
    answers = case.solved(case.instances(np.array([[1.0, 0.5, 2], [0, 0, 0.3]])))
    assert (answers.violation > 1e-3).all()
    assert np.isfinite(answers.cost).all()
    assert answers.iterations.max() < interior.MOST


@pytest.mark.parametrize("unit", [2.0**-30, 2.0**30])
def test_units_change_no_answer(unit: float) -> None:
    """Metres in nanometres or gigametres, nearly."""
    x0 = np.array([[1.0, 0.5], [0, 0]])
    costs, steps = [], []
    for scale in (1.0, unit):
        case = posed(sliding(
            stage_cost=lambda x, u, s=scale: (ca.sumsqr(x) + u**2) / s**2,
            bounds=Bounds(controls=(-3 * scale, 3 * scale)),
            constraints=lambda x, _, s=scale: [
                PathConstraint(expression=x[1], lower=-0.5 * s, upper=0.1 * s)
            ],
            terminal=lambda x, _, s=scale: [(x[0], 0.2 * s)],
        ))  # fmt: skip
        answers = case.solved(case.instances(scale * x0))
        costs.append(answers.cost)
        steps.append(answers.iterations)
        assert answers.violation.max() <= 1e-7
    np.testing.assert_allclose(costs[1], costs[0], rtol=1e-9)
    np.testing.assert_array_equal(steps[1], steps[0])


def test_cost_without_a_least_ends_the_lanes() -> None:
    case = posed(sliding(stage_cost=lambda x, u: -(x[0] ** 2) - u**2, bounds=Bounds()))
    answers = case.solved(case.instances(np.array([[1.0, 0.5], [0, 0]])))
    assert answers.iterations.max() <= interior.MOST
    assert (answers.cost < -1e6).all()


def test_rows_that_repeat_change_no_answer() -> None:
    """No multipliers are unique then."""
    x0 = np.array([[1.0, 0.5], [0, 0]])
    single = posed(sliding(constraints=between, terminal=lambda x, _: [(x[0], 0.2)]))
    repeated = posed(sliding(
        constraints=lambda x, u: [
            *between(x, u), *between(x, u),
            PathConstraint(expression=3 * x[1], upper=0.3),
        ],
        terminal=lambda x, _: [(x[0], 0.2), (x[0], 0.2), (2 * x[0], 0.4)],
    ))  # fmt: skip
    one, other = (case.solved(case.instances(x0)) for case in (single, repeated))
    np.testing.assert_allclose(other.cost, one.cost, rtol=1e-7)
    assert other.violation.max() <= 1e-7


def test_controls_that_are_fixed_stay_where_they_are() -> None:
    case = posed(sliding(bounds=Bounds(controls=(0.3, 0.3))))
    answers = case.solved(case.instances(np.array([[1.0, 0.5], [0, 0]])))
    np.testing.assert_array_equal(answers.controls, 0.3)
    assert answers.violation.max() <= 1e-9
    value = case.planner.fitness.value(answers.controls[:, :, 0], [1.0, 0.0])
    assert answers.cost[0] == pytest.approx(value[0], rel=1e-6)


def test_rollout_that_leaves_the_numbers_begins_at_the_start() -> None:
    """x' = x^2 + u explodes from 3 in a third of a second, unless u holds it."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    case: Posed = posed(OptimalControlProblem(
        Model(states=x, controls=u, ode=x**2 + u), horizon=2.0, intervals=40,
        stage_cost=x**2 + 0.01 * u**2, bounds=Bounds(controls=(-20, 20)),
    ))  # fmt: skip
    x0 = np.array([[3.0, 0.1, 1.0, 9.0]])
    answers = case.solved(case.instances(x0))
    assert (answers.violation[:3] <= 1e-7).all()
    rng = np.random.default_rng(0)
    best = [case.planner.plan([a], rng=rng).cost for a in x0[0, :3]]
    np.testing.assert_allclose(answers.cost[:3], best, rtol=1e-6)
    # From 9 no control is strong enough.
    assert answers.violation[3] > 1e-3


def test_step_that_no_length_makes_good_is_given_up() -> None:
    """The cost jumps up beside the start, and no equation is left: theta is 0."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    case = posed(OptimalControlProblem(
        Model(states=x, controls=u, next_state=x), horizon=1.0, intervals=2,
        step_cost=(u - 1) ** 2 + 1e3 * (u > 0),
    ))  # fmt: skip
    answers = case.solved(case.instances(np.array([[0.5, 0.25]])))
    np.testing.assert_array_equal(answers.controls, 0)
    np.testing.assert_array_equal(answers.iterations, 0)
    assert answers.optimal is not None
    assert not answers.optimal.any()
