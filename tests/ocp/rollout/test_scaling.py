"""Natural sizes: the same problem in other units, and numbers that count as zero."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Fitness,
    InvalidProblemError,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    SolutionStatus,
    Start,
    disc,
    ensemble,
    phases,
    solve,
)
from swarmstart.ocp.nlp.polish import Polished, Polisher
from swarmstart.ocp.nlp.polish_options import PolishStatus
from swarmstart.ocp.rollout.scaling import Sizes, Sizing

NONE = np.empty(0)


def sizes_of(
    problem: OptimalControlProblem, x0: list[float], guess: Array | None = None
) -> Sizes:
    return Sizing(problem)(
        np.array(x0, dtype=np.float64), NONE, np.empty((0, problem.nodes)), guess
    )


def in_units(states: Array, controls: Array, cost: float) -> OptimalControlProblem:
    """A unicycle with drag, a disc, a bound and a target, in other units.

    Quantities with units enter as a number times the unit; `states` and `controls` are
    the sizes of the old units in the new ones.
    """
    z, v = ca.SX.sym("z", 4), ca.SX.sym("v", 2)
    x, u = z / states, v / controls
    ode = ca.vertcat(u[0] - x[0] ** 2, u[1], x[0] * ca.cos(x[1]), x[0] * ca.sin(x[1]))
    model = Model(states=z, controls=v, ode=ode * states)
    inf = np.inf
    return OptimalControlProblem(
        model,
        horizon=4.0,
        intervals=5,
        stage_cost=cost * (ca.sumsqr(u) + x[3] ** 2),
        terminal_cost=cost * x[0],
        bounds=Bounds(
            controls=(
                np.array([-1.0, -inf]) * controls,
                np.array([3.0, inf]) * controls,
            ),
            states=(np.array([0.5, -inf, -inf, -5]) * states, inf),
        ),
        constraints=[disc(x[2:], centre=[3, 0], radius=1), x[0] * x[3] >= 0],
        terminal=[z[2] - 7 * states[2]],
    )


powers = st.integers(-30, 30).map(lambda k: 2.0**k)
eighths = st.integers(-(2**33), 2**33).map(lambda k: k / 8)
"""Origins that positions with three binary places can be counted from exactly."""


@given(origin=st.tuples(eighths, eighths, eighths))
@settings(max_examples=25, deadline=None)
def test_origin_of_the_states_changes_no_size(origin: tuple[float, ...]) -> None:
    """Position, speed and clock, with rows, bounds and costs of each kind."""
    z, u = ca.SX.sym("z", 3), ca.SX.sym("u")

    def posed(o: np.ndarray) -> OptimalControlProblem:
        x = z - o
        return OptimalControlProblem(
            Model(states=z, controls=u, ode=ca.vertcat(x[1], u - x[0] * x[1], 1)),
            horizon=4.0,
            intervals=4,
            stage_cost=u**2 + 3 * (x[0] - 2) ** 2 + z[2],
            terminal_cost=-z[1],
            bounds=Bounds(
                controls=(-2, 2),
                states=([o[0] - 4, -np.inf, o[2] - 1], [np.inf, o[1] + 5, np.inf]),
            ),
            constraints=[z[0] <= o[0] + 8, z[0] - z[1] <= o[0] - o[1] + 9],
            terminal=[z[0] - (o[0] + 3), (x[1] - 1) ** 2 <= 1],
        )

    none, there = (
        sizes_of(posed(np.array(o)), [*(np.array([0.5, 1.0, 0.0]) + o)])
        for o in ((0.0, 0.0, 0.0), origin)
    )
    np.testing.assert_array_equal(there.states, none.states)
    np.testing.assert_array_equal(there.controls, none.controls)
    np.testing.assert_array_equal(none.states[:1], [2.5])  # From 0.5 to 3.
    assert there.cost == pytest.approx(none.cost, rel=1e-6)
    for found, expected in zip(there.rows, none.rows, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-6)


@given(
    states=st.lists(powers, min_size=4, max_size=4).map(np.array),
    controls=st.lists(powers, min_size=2, max_size=2).map(np.array),
    cost=powers,
    guessed=st.booleans(),
)
@settings(max_examples=25, deadline=None)
def test_larger_units_give_sizes_that_are_smaller_by_exactly_that(
    states: Array, controls: Array, cost: float, guessed: bool
) -> None:
    start = np.array([2.0, 0.3, 0.0, 0.0])
    guess = np.full((2, 5), 0.25) if guessed else None
    plain = sizes_of(in_units(np.ones(4), np.ones(2), 1.0), [*start], guess)
    moved = None if guess is None else guess * controls[:, None]
    other = sizes_of(in_units(states, controls, cost), [*start * states], moved)
    np.testing.assert_array_equal(other.states, plain.states * states)
    np.testing.assert_array_equal(other.controls, plain.controls * controls)
    assert other.cost == plain.cost * cost
    # The disc and the product are stated in the old units.
    by_row = [np.ones(1), np.ones(1), states[[0, 3]], states[[2]]]
    for found, expected, unit in zip(other.rows, plain.rows, by_row, strict=True):
        np.testing.assert_array_equal(found, expected * unit)


@given(time=powers)
@settings(max_examples=10, deadline=None)
def test_unit_of_time_changes_no_size_but_that_of_rates(time: float) -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")

    def posed(unit: float) -> OptimalControlProblem:
        return OptimalControlProblem(
            Model(states=x, controls=u, ode=ca.vertcat(x[1], u)),
            horizon=3.0 * unit,
            intervals=3,
            stage_cost=x[0] ** 2 / unit,
            terminal_cost=x[0] ** 2,
            terminal=[x[0] - 5],
        )

    plain, other = sizes_of(posed(1.0), [0, 0]), sizes_of(posed(time), [0, 0])
    np.testing.assert_array_equal(other.states * [1, time], plain.states)
    np.testing.assert_array_equal(other.controls * time**2, plain.controls)
    assert other.cost == plain.cost


def pushed(model: Model, **changes: object) -> OptimalControlProblem:
    """A double integrator from rest to a place, pushed by at most 2."""
    stated = OptimalControlProblem(
        model,
        horizon=3.0,
        intervals=6,
        stage_cost=model.controls**2,
        bounds=Bounds(controls=(-2, 2)),
    )
    return replace(stated, **changes)  # type: ignore[arg-type]


def test_sizes_come_from_bounds_start_and_target(double_integrator: Model) -> None:
    x = double_integrator.states
    bounds = Bounds(controls=(-1, 3), states=([-8, -np.inf], [2, 7]))
    problem = pushed(double_integrator, bounds=bounds, terminal=[2 * x[1] - 6])
    found = sizes_of(problem, [1, -2])
    np.testing.assert_array_equal(found.states, [10, 5])  # A width; -2 to 3.
    np.testing.assert_array_equal(found.controls, [4])
    assert sizes_of(problem, [1, 5]).states[1] == 2
    # The width of the range, the way to a one-sided limit but not more than the state
    # varies, and twice the way to the target.
    np.testing.assert_array_equal(found.rows[0], [10, 5])
    np.testing.assert_allclose(found.rows[1], 2 * 5)


def test_unknown_sizes_are_what_the_dynamics_make_of_known_ones(
    double_integrator: Model,
) -> None:
    """With at most 2 for 3 s: 6 m/s, and in that time 9 m."""
    found = sizes_of(pushed(double_integrator), [0, 0])
    np.testing.assert_allclose(found.states, [2 * 3**2 / 2, 2 * 3])
    free = pushed(
        double_integrator, bounds=Bounds(), terminal=[double_integrator.states[0] - 9]
    )
    found = sizes_of(free, [0, 0])
    np.testing.assert_allclose(found.states, [9, 9 / 3])
    np.testing.assert_allclose(found.controls, [9 / 3 / 3])


def test_rows_are_as_large_as_the_way_to_their_limits_but_not_nothing(
    double_integrator: Model,
) -> None:
    x = double_integrator.states
    rows = [x[0], x[0], x[0] - 4, x[0], x[0], x[0] ** 2, x[0] ** 2]
    stated = PathConstraint(
        expression=ca.vertcat(*rows),
        upper=[5, 1 + 1e-12, 0, 30, 1e6, 4, 1e-12],
        lower=[-np.inf, -np.inf, -np.inf, 10, -np.inf, -np.inf, -np.inf],
    )
    found = sizes_of(pushed(double_integrator, constraints=[stated]), [1, 0]).rows[0]
    assert found[0] == 4
    assert found[1] == pytest.approx(9)  # A way of 1e-12 is nothing beside 9 m.
    assert found[2] == 3
    assert found[3] == 20
    assert found[4] == pytest.approx(9)  # The limit is out of reach.
    # A square does not move with the origin of its state: its limit counts.
    assert found[5] == 4
    assert 1e-3 <= found[6] < 1e-1
    given = replace(stated, scale=[1, 2, 3, 4, 5, 6, 7])
    found = sizes_of(pushed(double_integrator, constraints=[given]), [1, 0]).rows[0]
    np.testing.assert_array_equal(found, [1, 2, 3, 4, 5, 6, 7])


@pytest.mark.parametrize("tiny", [1e-9, 1e-17, 1e-300, 5e-324])
def test_number_that_is_zero_by_rounding_is_no_size(
    double_integrator: Model, tiny: float
) -> None:
    x = double_integrator.states

    def sizes(rounding: float, push: float, guess: float) -> Sizes:
        problem = pushed(
            double_integrator,
            bounds=Bounds(controls=(-push, push), states=([0, -np.inf], np.inf)),
            terminal=[x[0] - 5, x[1] - rounding],
        )
        return sizes_of(problem, [rounding, rounding], np.full((1, 6), guess))

    for push in (2.0, np.inf):
        exact = sizes(0.0, push, 0.0)
        for found in (sizes(tiny, push, 0.0), sizes(tiny, push, tiny)):
            np.testing.assert_allclose(found.states, exact.states, rtol=1e-6)
            np.testing.assert_allclose(found.controls, exact.controls, rtol=1e-6)
            for one, other in zip(found.rows[:2], exact.rows[:2], strict=True):
                np.testing.assert_allclose(one, other, rtol=1e-6)


def test_half_turn_that_rounds_the_target_is_solved(unicycle: Model) -> None:
    """Sizes of 1e-14 for y once made IPOPT fail."""
    x = unicycle.states
    problem = OptimalControlProblem(
        unicycle,
        horizon=4.0,
        intervals=8,
        stage_cost=ca.sumsqr(unicycle.controls),
        bounds=Bounds(controls=([-2, -1], [2, 1])),
        terminal=[x[2] + 6, x[3] - 1e-14],
    )
    sizes = sizes_of(problem, [1, np.pi, 0, 1e-300])
    assert sizes.states.min() > 0.1
    found = solve(problem, [1, np.pi, 0, 1e-300], search=None, backend="casadi", seed=0)
    assert found.status is SolutionStatus.CONVERGED
    # Straight on, from 1 m/s, 6 m in 4 s: constant pushes by parts of 1/2 s.
    np.testing.assert_allclose(found.controls[1], 0, atol=1e-6)


@pytest.mark.parametrize("start", [[0.0, 0.0], [1e-3, 0.0], [1.0, 1.0]])
@pytest.mark.parametrize("bounded", [True, False])
def test_sizes_are_numbers_for_models_that_are_not(
    start: list[float], bounded: bool
) -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    model = Model(
        states=x, controls=u, ode=ca.vertcat(ca.sqrt(x[1] - 1) + ca.log(x[0]), u / x[0])
    )
    problem = OptimalControlProblem(
        model,
        horizon=1.0,
        intervals=2,
        stage_cost=1 / x[0] + ca.log(-x[1]),
        terminal_cost=ca.sqrt(-x[0]),
        bounds=Bounds(controls=(-1, 1) if bounded else None),
        constraints=[ca.log(x[0]) <= 0, 1 / x[1] >= 0],
        terminal=[ca.sqrt(x[0])],
    )
    found = sizes_of(problem, start)
    every = np.concatenate([found.states, found.controls, [found.cost], *found.rows])
    assert np.isfinite(every).all()
    assert (every > 0).all()


@pytest.mark.parametrize("horizon", [1e-300, 1e200])
def test_sizes_are_numbers_for_horizons_of_any_length(
    double_integrator: Model, horizon: float
) -> None:
    found = sizes_of(pushed(double_integrator, horizon=horizon), [1, 0])
    assert np.isfinite([*found.states, *found.controls, found.cost]).all()


def test_cost_along_a_trajectory_is_the_sum_of_its_parts(
    double_integrator: Model,
) -> None:
    """The signs differ, so a sum of the costs themselves would be smaller."""
    x, u, p = double_integrator.states, double_integrator.controls, ca.SX.sym("p")
    problem = pushed(
        replace(double_integrator, parameters=p),
        stage_cost=p * u,
        terminal_cost=-5 * x[0],
        checks=2,
    )
    controls = np.array([[1, -1, 1, -2, 1, 2.0]])
    states = np.zeros((2, 13))
    states[0, -1] = 3
    nothing = np.empty((0, 13))
    along = Sizing(problem).cost_along(states, controls, np.array([3.0]), nothing)
    assert along == pytest.approx(0.5 * 3 * 8 + 15)


@pytest.mark.parametrize("integrator", ["stiff", "rk4"])
def test_fast_state_is_as_large_as_it_gets(integrator: str) -> None:
    # x' = 0.2 - 100 x rests at 0.002; at its first rate it would reach 10 in 50 s.
    x, y, u = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("u")
    model = Model(states=ca.vertcat(x, y), controls=u, ode=ca.vertcat(u - 100 * x, u))

    problem = OptimalControlProblem(
        model,
        horizon=50.0,
        intervals=5,
        stage_cost=x**2,
        bounds=Bounds(controls=(0.0, 0.2)),
        integrator=integrator,
    )
    sizes = sizes_of(problem, [0.0, 0.0]).states
    np.testing.assert_allclose(sizes, [0.002, 10.0])


def test_given_size_of_a_stiff_state_stays() -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    model = Model(states=x, controls=u, ode=ca.vertcat(u - 100 * x[0], u))
    problem = OptimalControlProblem(
        model, horizon=50.0, intervals=5, stage_cost=x[0] ** 2, integrator="stiff",
        bounds=Bounds(controls=(0.0, 0.2)), scales={model.state_names[0]: 7.0},
    )  # fmt: skip
    fitness = Fitness(problem, backend="casadi")
    controls, x0 = np.full((1, 5), 0.1), [0.0, 0.0]
    states = fitness.states(controls, x0)
    sizes = fitness.arguments.sizes_along(controls, states, x0, Known())
    np.testing.assert_allclose(sizes.states, [7.0, states[1].max()])


def rocket(unit: float = 1.0, **more: object) -> OptimalControlProblem:
    """A rocket brought to rest at 100 km; the bounds do not give the states' sizes.

    Args:
        unit: Number of units of altitude in a metre.
        more: Arguments that replace the default ones.
    """
    x, thrust = ca.vertcat(*map(ca.SX.sym, ("h", "v", "m"))), ca.SX.sym("thrust")
    height, v, m = x[0] / unit, x[1], x[2]
    drag = 1e-5 * v * ca.fabs(v) * ca.exp(-height / 8000)
    pull = 9.81 / (1 + height / 6.371e6) ** 2
    ode = ca.vertcat(v * unit, thrust / m - pull - drag, -thrust / 3000)
    most = np.array([unit, 1.0, 1.0]) * 1e9
    stated: dict[str, object] = {
        "horizon": 200.0,
        "intervals": 20,
        "terminal_cost": -m,
        "terminal": [height - 1e5, v],
        "bounds": Bounds(controls=(0, 4e5), states=([-most[0], -1e9, 1.0], most)),
    }
    model = Model(states=x, controls=thrust, ode=ode)
    return OptimalControlProblem(model, **(stated | more))  # type: ignore[arg-type]


def polished_rocket(unit: float, scales: dict[str, float]) -> Polished:
    polisher = Polisher(Fitness(rocket(unit, scales=scales), backend="casadi"))
    return polisher(np.full((1, 20), 1.2e5), [0, 0, 1e4])


def test_sizes_that_are_given_serve_where_bounds_say_nothing() -> None:
    """In any unit, with fewer iterations than with the width of the bounds."""
    given = {"v": 1e3, "m": 1e4, "thrust": 2e5}
    one, other = (
        polished_rocket(unit, {**given, "h": 1e5 * unit}) for unit in (1.0, 1e-3)
    )
    natural = polished_rocket(1.0, {})
    for answer in (one, other, natural):
        assert answer.status is PolishStatus.CONVERGED
    assert one.cost == pytest.approx(other.cost, rel=1e-9)
    assert one.iterations == other.iterations <= natural.iterations
    np.testing.assert_allclose(one.controls, other.controls, rtol=1e-6, atol=1)
    assert one.cost <= natural.cost
    assert one.cost == pytest.approx(natural.cost, rel=1e-4)


def test_given_sizes_are_taken_as_they_are_and_others_follow() -> None:
    sizes = sizes_of(rocket(scales={"h": 3.0, "thrust": 5.0}), [0, 0, 1e4])
    assert sizes.states[0] == 3.0
    assert sizes.controls[0] == 5.0
    plain = sizes_of(rocket(), [0, 0, 1e4])
    np.testing.assert_array_equal(sizes.states[1:], plain.states[1:])
    assert sizes.weights.size == plain.weights.size


def test_the_way_of_another_state_says_that_a_small_start_is_no_size() -> None:
    """A pendulum turns by 2 rad in 3 s, also if it begins with a speed of nearly 0."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 9.81 * ca.sin(x[0]))),
        horizon=3.0,
        intervals=50,
        stage_cost=u**2,
        terminal=[(x[0], np.pi), (x[1], 0)],
        bounds=Bounds(controls=(-8, 8)),
    )
    rest, slow, fast = (sizes_of(problem, [1.0, v]) for v in (0.0, 0.03, 2.0))
    assert slow.states[1] == pytest.approx(rest.states[1], rel=1e-2)
    assert slow.weights == pytest.approx(rest.weights, rel=1e-2)
    assert fast.states[1] == 2.0  # The way from its start, as before.


def test_sizes_of_many_starts_at_once_are_those_of_each_to_the_last_bit() -> None:
    """They differ in where their ways come from: a target, a rate, a guess."""
    problem = rocket(bounds=Bounds(controls=(0, np.inf)))
    rng = np.random.default_rng(0)
    x0 = rng.uniform([-1e4, -9, 1e3], [1e4, 9, 2e4], (40, 3)).T
    x0[:, ::5] = [[0.0], [0.0], [1e4]]
    guess = rng.uniform(0, 4e5, (1, problem.intervals, 40)) * (np.arange(40) % 3)
    none = np.empty((0, problem.nodes, 40))
    sizing = Sizing(problem)
    many = sizing.of_all(x0, np.empty((0, 40)), none, guess)
    for k in (0, 5, 17, 39):
        one = Sizing(problem)(x0[:, k], NONE, none[..., k], guess[..., k])
        for name in ("states", "controls", "cost", "weights"):
            np.testing.assert_array_equal(getattr(many[k], name), getattr(one, name))
        np.testing.assert_array_equal(many[k].rows, one.rows)
    few = sizing.of_all(x0[:, :3], np.empty((0, 3)), none[..., :3], guess[..., :3])
    np.testing.assert_array_equal(few[2].states, many[2].states)


def test_guess_of_states_says_how_large_unbounded_ones_get() -> None:
    problem = rocket(
        bounds=Bounds(controls=(0, 4e5), states=([-9, -np.inf, 1], np.inf))
    )
    along = np.outer([2e5, -700.0, 3e4], np.linspace(0, 1, problem.nodes))
    none = np.empty((0, problem.nodes))
    plain, guessed = (
        Sizing(problem)(np.array([0, 0, 1e4]), NONE, none, None, states)
        for states in (None, along)
    )
    # The way from the start, and the fuel's from 1e4 to 3e4.
    np.testing.assert_array_equal(guessed.states, [2e5, 700.0, 2e4])
    assert plain.states[0] == 1e5
    # Bounds and given sizes take precedence over a guess.
    bounds = Bounds(controls=(0, 4e5), states=([-np.inf, -50, 1], [np.inf, 50, np.inf]))
    bounded = replace(problem, scales={"h": 4.0}, bounds=bounds)
    found = Sizing(bounded)(np.array([0, 0, 1e4]), NONE, none, None, along)
    np.testing.assert_array_equal(found.states, [4.0, 100.0, 2e4])


def test_start_with_states_is_a_guess_of_their_sizes(double_integrator: Model) -> None:
    problem = replace(pushed(double_integrator), terminal=[double_integrator.states])
    along = np.array([[300.0], [-40.0]]) * np.linspace(0, 1, problem.nodes)
    start = Start(np.ones((1, 6)), along)
    answer, guessed = (
        solve(problem, [1.0, 0.0], guess=guess, search=None, lanes=0, seed=0)
        for guess in (start, start.controls)
    )
    assert answer.cost == pytest.approx(guessed.cost, rel=1e-7)
    assert answer.plan.point is not None
    program, q = answer.plan.point.program, answer.plan.point.q
    at = np.cumsum(program.parts.argument_sizes(program.problem))[0]
    np.testing.assert_array_equal(q[at : at + 2], [299.0, 40.0])


@pytest.mark.parametrize(
    ("scales", "message"),
    [
        ({"height": 1.0}, "scales must name states and controls, some of h, v, m"),
        ({"h": 0.0}, "scale of h must be a positive finite number, got 0.0"),
        ({"h": -1.0}, "scale of h must be a positive finite number"),
        ({"h": np.nan}, "scale of h must be a positive finite number"),
        ({"thrust": np.inf}, "scale of thrust must be a positive finite number"),
        ({"h": "1e5"}, "scale of h must be a number"),
        ([1.0, 2.0], "scales must be a mapping"),
    ],
)
def test_sizes_that_are_none_are_refused(scales: object, message: str) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        rocket(scales=scales)


def test_members_and_phases_have_the_sizes_of_their_problems() -> None:
    x, u, k = (ca.SX.sym(n) for n in "xuk")
    one = OptimalControlProblem(
        Model(states=x, controls=u, ode=k * u, parameters=k), horizon=1, intervals=2,
        scales={"x": 3.0, "u": 4.0}, bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    together = ensemble(one, {"k": [1, 2]})
    assert together.scales == {"x_0": 3.0, "x_1": 3.0, "u": 4.0}
    apart = ensemble(one, {"k": [1, 2]}, robust_horizon=1)
    assert apart.scales == {"x_0": 3.0, "x_1": 3.0, "u_0": 4.0, "u_1": 4.0}
    both = phases([one, replace(one, scales={"x": 5.0})]).problem
    assert both.scales == {"x": 5.0, "u": 4.0}


def test_start_outside_a_limit_is_not_the_size_of_its_row(
    double_integrator: Model,
) -> None:
    """A way of 0.5 back inside says nothing of a path of 9 m."""
    x = double_integrator.states
    problem = pushed(double_integrator, constraints=[x[0] <= 1])
    assert sizes_of(problem, [1.5, 0]).rows[0] == pytest.approx(9)
    assert sizes_of(problem, [0.5, 0]).rows[0] == pytest.approx(0.5)


def test_points_around_the_start_keep_the_bounds_of_the_states() -> None:
    """Below the ground the air of this model would be as dense as e^200."""
    h, u = ca.SX.sym("h"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=h, controls=u, ode=u), horizon=1.0, intervals=2,
        stage_cost=ca.exp(-500 * h),
        bounds=Bounds(controls=(-1, 1), states=(0, np.inf)),
    )  # fmt: skip
    assert sizes_of(problem, [0.0]).cost == 1.0


@pytest.mark.parametrize("factor", [10.0, 1e3])
def test_limit_of_nearly_nothing_is_a_part_of_what_its_row_amounts_to(
    double_integrator: Model, factor: float
) -> None:
    x = double_integrator.states
    problem = pushed(double_integrator, constraints=[x[0] ** 2 <= 1e-12])
    one, other = (sizes_of(problem, [at, 0]).rows[0] for at in (30.0, 30.0 * factor))
    np.testing.assert_allclose(other, factor**2 * one, rtol=1e-9)


def test_ends_that_fix_no_state_alone_are_no_target(double_integrator: Model) -> None:
    """Of 2 x0 = p + s, x0 + x1 = 4, x1^2 = 9 and x1 <= 7 only the first fixes one."""
    x, p, s = double_integrator.states, ca.SX.sym("p"), ca.SX.sym("s")
    problem = OptimalControlProblem(
        replace(double_integrator, parameters=p), horizon=3.0, intervals=2, signals=s,
        terminal=[2 * x[0] - p - s, x[0] + x[1] - 4, x[1] ** 2 - 9, x[1] <= 7],
    )  # fmt: skip
    target = Sizing(problem).target(np.array([5.0]), np.array([3.0]))
    np.testing.assert_array_equal(target, [4.0, np.nan])


def test_signals_count_as_they_are_at_the_start_and_at_the_end() -> None:
    """x' = s u with |u| <= 1: from the first signal; the target from the last."""
    x, u, s = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("s")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, signals=s, ode=ca.vertcat(s * u, u)), horizon=2.0,
        intervals=2, signals=(wanted := ca.SX.sym("wanted")), terminal=[x[1] - wanted],
        bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    signals = np.array([[3.0, 50.0, 700.0], [1.0, 20.0, 9.0]])
    found = Sizing(problem)(np.zeros(2), NONE, signals)
    np.testing.assert_allclose(found.states, [6.0, 9.0])
    # The ways to the least of a cost, which are curved, also of a row at the end.
    curved = replace(
        problem, terminal=[], stage_cost=(x[0] - s) ** 2,
        terminal_cost=(x[1] - wanted) ** 2,
    )  # fmt: skip
    found = Sizing(curved)(np.zeros(2), NONE, signals)
    np.testing.assert_allclose(found.states, [3.0, 9.0])


def test_guess_of_states_counts_only_if_all_of_it_is_a_number() -> None:
    problem = rocket(
        bounds=Bounds(controls=(0, 4e5), states=([-9, -np.inf, 1], np.inf))
    )
    along = np.outer([2e5, -700.0, 3e4], np.linspace(0, 1, problem.nodes))
    along[1, 3] = np.nan
    found = Sizing(problem)(
        np.array([0, 0, 1e4]), NONE, np.empty((0, problem.nodes)), None, along
    )
    np.testing.assert_array_equal(found.states, sizes_of(problem, [0, 0, 1e4]).states)
