"""Step size control against closed forms, SciPy, and itself."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Free,
    InvalidProblemError,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    TerminalConstraint,
    ensemble,
    solve,
)
from swarmstart.ocp.integration.rodas import (
    MOST_TICKS,
    Rate,
    column_at_begin,
    followed,
    rodas4_with_error,
    ticked,
    values_of,
)
from swarmstart.ocp.rollout.fitness import Fitness, replay
from swarmstart.ocp.rollout.shooting import Shooting
from swarmstart.ocp.statement.problem import Quadrature
from swarmstart.tests.ocp import catalyst

BACKENDS = ("llvm", "casadi")


def robertson(x: Any) -> list[Any]:
    """Return the rates of three reactions, of 0.04, 1e4 and 3e7 per second."""
    made, lost = 0.04 * x[0], 1e4 * x[1] * x[2]
    return [lost - made, made - lost - 3e7 * x[1] ** 2, 3e7 * x[1] ** 2]


def van_der_pol(x: Any) -> list[Any]:
    return [x[1], 100 * (1 - x[0] ** 2) * x[1] - x[0]]


def left_alone(
    rates: Callable[[Any], list[Any]], size: int, horizon: float, **more: Any
) -> OptimalControlProblem:
    """Return a problem over 10 intervals whose control has no effect but a cost."""
    x, u = ca.SX.sym("x", size), ca.SX.sym("u")
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(*rates(x))),
        horizon=horizon,
        intervals=10,
        stage_cost=u**2 + x[0] ** 2,
        bounds=Bounds(controls=(-1, 1)),
        integrator="stiff",
        **more,
    )


def radau(
    rates: Callable[[Any], list[Any]], x0: list[float], horizon: float, nodes: int = 11
) -> Array:
    """Return states and the integral of the first one's square, at the nodes."""
    y = ca.SX.sym("y", len(x0) + 1)
    f = ca.vertcat(*rates(y), y[0] ** 2)
    slopes = ca.Function("slopes", [y], [ca.jacobian(f, y)])
    found = solve_ivp(
        lambda _, y: [*rates(y), y[0] ** 2], (0, horizon), [*x0, 0.0], method="Radau",
        rtol=1e-11, atol=1e-15, t_eval=np.linspace(0, horizon, nodes),
        jac=lambda _, y: np.array(slopes(y)),
    )  # fmt: skip
    return np.asarray(found.y)


def ticks(rate: Rate, x: list[float], *, duration: float, tolerance: float) -> int:
    """Return the number of ticks in a check."""
    z, n = ca.SX.sym("z", 2 * len(x) + 2), len(x)
    after = ticked(rate, z, ca.SX.ones(n), duration=duration, tolerance=tolerance)
    tick, count = ca.Function("tick", [z], [after]), 0
    at = np.array(column_at_begin(ca.DM(x), integrals=0, steps=4)).ravel()
    while at[-2] > 0 and count < MOST_TICKS:
        at, count = np.array(tick(at)).ravel(), count + 1
    return count


@pytest.mark.parametrize(
    ("rates", "x0", "horizon", "allowed"),
    [
        (robertson, [1.0, 0.0, 0.0], 40.0, 2e-7),
        (van_der_pol, [2.0, 0.0], 200.0, 2e-5),  # Over two jumps.
    ],
)
def test_nonlinear_stiff_models_are_those_of_an_independent_integrator(
    rates: Callable[[Any], list[Any]], x0: list[float], horizon: float, allowed: float
) -> None:
    problem = left_alone(rates, len(x0), horizon)
    truth = radau(rates, x0, horizon)
    states, cost, violation = replay(problem, np.zeros((1, 10)), x0)
    reach = np.abs(truth[:-1]).max(axis=1, keepdims=True)
    assert (np.abs(states - truth[:-1]) / reach).max() < allowed
    assert cost == pytest.approx(truth[-1, -1], rel=10 * allowed)
    assert violation == 0
    # No number of equal steps achieves this in the same time.
    equal = replace(problem, integrator_tolerance=None, substeps=16)
    off = np.abs(replay(equal, np.zeros((1, 10)), x0)[0] - truth[:-1]) / reach
    assert not off.max() < allowed


@pytest.mark.parametrize("backend", BACKENDS)
def test_fast_model_of_time_follows_the_cosine(backend: str) -> None:
    """Prothero and Robinson: x is the cosine of time."""
    x, u, t = (ca.SX.sym(name) for name in "xut")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, time=t, ode=-1e4 * (x - ca.cos(t)) - ca.sin(t)),
        horizon=3.0,
        intervals=6,
        checks=2,
        stage_cost=(u - x) ** 2,
        bounds=Bounds(controls=(-2, 2)),
        integrator="stiff",
    )
    fitness = Fitness(problem, backend=backend)
    known = Known(np.zeros(1), np.linspace(0, 1, 13)[None, :])
    states = fitness.states(np.zeros((1, 6)), [1.0], known)
    np.testing.assert_allclose(states[0], np.cos(problem.times), rtol=0, atol=1e-6)
    exact = 1.5 + np.sin(6.0) / 4  # The integral of the squared cosine.
    assert fitness.value(np.zeros((1, 6)), [1.0], known)[0] == pytest.approx(
        exact, rel=1e-6
    )


def test_catalyst_is_that_of_matrix_exponentials() -> None:
    population = np.random.default_rng(1).uniform(0.6, 0.9, (10, 5))
    shooting = Shooting(catalyst.problem(integrator="stiff", substeps=4))
    exact = [1000 * catalyst.exact_end(u[None])[6] for u in population.T]
    for backend in BACKENDS:
        cost, _ = Fitness(shooting, backend=backend).objective(catalyst.X0)(population)
        np.testing.assert_allclose(-cost, exact, rtol=1e-7)


def test_error_falls_with_the_tolerance() -> None:
    truth = radau(robertson, [1.0, 0.0, 0.0], 40.0)[:-1]
    errors = []
    for tolerance in (1e-3, 1e-5, 1e-7):
        problem = left_alone(robertson, 3, 40.0, integrator_tolerance=tolerance)
        states, _, _ = replay(problem, np.zeros((1, 10)), [1.0, 0.0, 0.0])
        off = np.abs(states - truth) / np.abs(truth).max(axis=1, keepdims=True)
        errors.append(off.max())
    assert errors[0] < 1e-3
    assert errors[1] < errors[0] / 10 and errors[2] < errors[1] / 10


def test_steps_go_where_the_solution_moves() -> None:
    """At 1e-6 Robertson needs at most 40 steps an interval, except in the layer."""

    def rate(_: float, x: ca.SX) -> ca.SX:
        return ca.SX(ca.vertcat(*robertson(x)))

    states = radau(robertson, [1.0, 0.0, 0.0], 40.0)[:-1]
    counts = [
        ticks(rate, list(x), duration=4.0, tolerance=1e-6) for x in states[:, :-1].T
    ]
    assert max(counts[1:]) <= 12 and np.mean(counts) < 25
    assert 40 < counts[0] < 150


def test_units_of_states_change_no_bit() -> None:
    unit = np.array([2.0**40, 2.0**-30, 2.0**10])  # Powers of two: nothing is rounded.
    own = left_alone(robertson, 3, 40.0)
    scaled = left_alone(
        lambda x: list(
            unit * np.array(robertson([x[i] / unit[i] for i in range(3)]), dtype=object)
        ),
        3, 40.0, quadrature="left",
    )  # fmt: skip
    own = replace(own, quadrature="left")
    none = np.zeros((1, 10))
    states, _, _ = replay(own, none, [1.0, 0.0, 0.0])
    other, _, _ = replay(scaled, none, unit * [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(other / unit[:, None], states)


def test_state_at_rest_changes_no_step() -> None:
    none = np.zeros((1, 10))
    alone = left_alone(robertson, 3, 40.0)
    beside = left_alone(lambda x: [*robertson(x), 0], 4, 40.0)
    states, cost, _ = replay(alone, none, [1.0, 0.0, 0.0])
    more, same, _ = replay(beside, none, [1.0, 0.0, 0.0, 7.0])
    np.testing.assert_array_equal(more[:3], states)
    assert same == cost


def test_layer_after_a_jump_of_controls_is_not_stepped_over() -> None:
    """The square of a fast state, which a long step would damp without seeing it."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(-1e5 * (x[0] - u), -x[1])),
        horizon=2.0,
        intervals=2,
        stage_cost=1e6 * (x[0] - u) ** 2,
        bounds=Bounds(controls=(-1, 1)),
        integrator="stiff",
    )
    _, cost, _ = replay(problem, np.array([[1.0, -1.0]]), [0.0, 1.0])
    # Each jump a costs 1e6 a^2 / (2 1e5).
    assert cost == pytest.approx(5 * (1.0**2 + 2.0**2), rel=1e-5)


@pytest.mark.parametrize("backend", BACKENDS)
def test_explosion_is_infinitely_violated_and_ends(backend: str) -> None:
    """x' = x^2 + u explodes at t = 1 / x unless it is pushed down."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=x**2 + u), horizon=10.0, intervals=5,
        stage_cost=x**2, bounds=Bounds(controls=(-2, 2)), integrator="stiff",
    )  # fmt: skip
    population = np.random.default_rng(0).uniform(-2, 2, (5, 64))
    population[:, 0], population[:, 1] = 1.0, -1.0
    fitness = Fitness(problem, backend=backend)
    cost, violation = fitness.objective([1.0])(population)
    assert np.isinf(violation[0]) and violation[1] == 0  # It rests at 1.
    assert cost[1] == pytest.approx(10.0, rel=1e-12)
    assert 10 < np.isinf(violation).sum() < 64
    assert np.isnan(fitness.states(population[:, :1].T, [1.0])[0, -1])
    assert ticks(lambda _, y: y**2, [1.0], duration=2.0, tolerance=1e-6) < MOST_TICKS


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_rates_that_are_no_numbers_end_at_once(wrong: float) -> None:
    def rate(_: float, x: ca.SX) -> ca.SX:
        return ca.SX(ca.if_else(x < 0.5, wrong, -x))

    assert ticks(rate, [0.1], duration=1.0, tolerance=1e-6) < 30
    z = ca.SX.sym("z", 4)
    after = ticked(rate, z, ca.SX(1), duration=5.0, tolerance=1e-6)
    follow = followed(ca.Function("tick", [z], [after]))
    begun = column_at_begin(ca.DM(1.0), integrals=0, steps=1)
    assert np.isnan(float(values_of(follow(begun))))  # Decays below 0.5 at ln 2.


def test_too_many_ticks_are_no_solution() -> None:
    def swinging(_: float, x: ca.SX) -> ca.SX:
        return ca.vertcat(x[1], -x[0])

    z = ca.SX.sym("z", 6)
    after = ticked(swinging, z, ca.SX.ones(2), duration=1e5, tolerance=1e-6)
    follow = followed(ca.Function("tick", [z], [after]))
    end = follow(column_at_begin(ca.DM([1, 0]), integrals=0, steps=4))
    assert np.isnan(np.array(values_of(end))).all()
    assert float(end[-1]) < 1e-3  # A short rest, which ends soon.


def test_tick_changes_nothing_that_is_done() -> None:
    z = ca.SX.sym("z", 4)
    after = ticked(lambda _, x: -x, z, ca.SX(1), duration=1.0, tolerance=1e-6)
    tick = ca.Function("tick", [z], [after])
    for left in (0.0, -1.0):
        done = [0.3, 1.0, left, 0.07]
        np.testing.assert_array_equal(np.array(tick(done)).ravel(), done)


def demanding() -> tuple[OptimalControlProblem, Array, Known]:
    """Return a problem with all features of an interval, its start and known data."""
    x, u, v, w = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("v"), ca.SX.sym("w")
    rate = ca.SX.sym("rate")
    model = Model(
        states=x,
        controls=ca.vertcat(u, v),
        parameters=rate,
        signals=w,
        ode=ca.vertcat(x[1] + w, -rate * (x[1] - u * ca.cos(x[0])) + v),
        next_state=ca.vertcat(x[0], 0.9 * x[1]),
    )
    problem = OptimalControlProblem(
        model,
        horizon=2.0,
        intervals=5,
        checks=3,
        stage_cost=x[0] ** 2 + 0.1 * u**2,
        step_cost=v**2,
        initial_cost=x[0] ** 2,
        terminal_cost=ca.sumsqr(x),
        bounds=Bounds(controls=([-1, 0], [1, 3]), integer=[1]),
        constraints=[
            PathConstraint(expression=x[0], upper=0.7, scale=0.7),
            PathConstraint(expression=x[1], upper=0.5, weight=2.0),
        ],
        terminal=[TerminalConstraint(expression=x[0] - 0.2, scale=0.2)],
        start={"x_0": Free(-1, 1)},
        integrator="stiff",
    )
    nodes = np.linspace(0, 1, problem.nodes)[None, :]
    return problem, np.array([0.5, 0.0]), Known(np.array([2e4]), 0.2 * nodes)


@pytest.mark.parametrize("quadrature", ["integral", "left", "right"])
def test_machine_code_casadi_and_replay_take_the_same_steps(
    quadrature: Quadrature,
) -> None:
    problem, x0, known = demanding()
    problem = replace(problem, quadrature=quadrature)
    population = np.random.default_rng(3).uniform(-1, 1, (11, 37))
    shooting = Shooting(problem)
    found = [
        Fitness(shooting, backend=backend).objective(x0, known)(population)
        for backend in BACKENDS
    ]
    np.testing.assert_allclose(found[0][0], found[1][0], rtol=1e-9)
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=1e-9, atol=1e-12)
    for number in (0, 9):
        one = population[:, number]
        begun = np.array([one[-1], x0[1]])
        controls = one[:-1].reshape((2, 5), order="F")
        states, cost, violation = replay(shooting, controls, begun, known)
        assert violation == pytest.approx(found[0][1][number], rel=1e-9)
        assert cost == pytest.approx(found[0][0][number], rel=1e-9)
        fitness = Fitness(shooting, backend="casadi")
        np.testing.assert_array_equal(
            fitness.states(controls, begun, known)[:, 1:], states[:, 1:]
        )


def test_integrals_and_states_of_a_demanding_problem_are_those_of_scipy() -> None:
    problem, x0, known = demanding()
    u = np.array([[0.3, -0.2, 0.9, 0.0, -0.7], [1.0, 0.0, 2.0, 3.0, 1.0]])
    states, _, _ = replay(problem, u, x0, known)
    y, rate = np.append(x0, 0.0), 2e4
    for k in range(5):

        def rates(t: float, y: Array, k: int = k) -> list[float]:
            pulled = u[0, k] * np.cos(y[0])
            return [y[1] + 0.1 * t, -rate * (y[1] - pulled) + u[1, k],
                    y[0] ** 2 + 0.1 * u[0, k] ** 2]  # fmt: skip

        y = solve_ivp(
            rates, (0.4 * k, 0.4 * (k + 1)), y, method="Radau", rtol=1e-11, atol=1e-14
        ).y[:, -1]
        y[1] *= 0.9
        np.testing.assert_allclose(states[:, 3 * (k + 1)], y[:2], rtol=1e-6)


def test_individuals_do_not_see_one_another() -> None:
    problem = catalyst.problem(integrator="stiff", substeps=4)
    population = np.random.default_rng(2).uniform(0.6, 0.9, (10, 40))
    objective = Fitness(problem, backend="llvm").objective(catalyst.X0)
    whole = objective(population)[0]
    for number in (0, 7, 39):
        alone = objective(population[:, number : number + 1])[0]
        assert alone[0] == whole[number]
    np.testing.assert_array_equal(objective(population[:, ::-1].copy())[0], whole[::-1])


def test_single_precision_is_good_for_a_first_look() -> None:
    problem = catalyst.problem(integrator="stiff", substeps=4)
    population = np.random.default_rng(2).uniform(0.6, 0.9, (10, 9))
    double, single = (
        Fitness(problem, backend="llvm", precision=precision).objective(catalyst.X0)
        for precision in ("double", "single")
    )
    np.testing.assert_allclose(single(population)[0], double(population)[0], rtol=2e-3)


def test_members_of_an_ensemble_cost_what_they_cost_alone() -> None:
    x, u, rate = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("rate")
    ode = ca.vertcat(x[1], -rate * (x[1] - u * ca.cos(x[0])))
    problem = OptimalControlProblem(
        Model(states=x, controls=u, parameters=rate, ode=ode), horizon=2.0,
        intervals=4, checks=2, stage_cost=(x[0] - 1) ** 2,
        bounds=Bounds(controls=(-1, 1)), integrator="stiff",
    )  # fmt: skip
    several = ensemble(problem, {"rate": [1e2, 1e5]}, risk="worst")
    answer = solve(several, [0.0, 0.0], search=None, seed=0)
    assert answer.status.is_confirmed, answer
    alone = [
        Fitness(problem, backend="casadi").value(
            answer.controls, [0, 0], Known([value])
        )[0]
        for value in (1e2, 1e5)
    ]
    np.testing.assert_allclose(answer.member_costs, alone, rtol=1e-6)
    assert answer.cost == pytest.approx(max(alone), rel=1e-6)


def test_robertson_is_controlled_polished_and_confirmed() -> None:
    """No number of equal steps resolves it; the polish uses graded steps."""
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    rates = robertson(ca.vertsplit(x))
    slower = 0.04 * (1 - u) * x[0]
    problem = OptimalControlProblem(
        Model(states=x, controls=u,
              ode=ca.vertcat(rates[0] + slower, rates[1] - slower, rates[2])),
        horizon=40.0,
        intervals=10,
        stage_cost=0.01 * (u - 1) ** 2,
        terminal_cost=(x[2] - 0.4) ** 2,
        bounds=Bounds(controls=(0.5, 4)),
        integrator="stiff",
    )  # fmt: skip
    answer = solve(problem, [1.0, 0.0, 0.0], budget=1000, seed=0)
    assert "local optimum, confirmed" in answer.status.value, answer

    def cost(controls: Array) -> float:
        y = np.array([1.0, 0.0, 0.0])
        for value in controls[0]:

            def controlled(_: float, y: Array, value: float = value) -> list[float]:
                rates, less = robertson(y), 0.04 * (1 - value) * y[0]
                return [rates[0] + less, rates[1] - less, rates[2]]

            y = solve_ivp(
                controlled, (0, 4), y, method="Radau", rtol=1e-10, atol=1e-14
            ).y[:, -1]
        return float((y[2] - 0.4) ** 2 + 0.04 * ((controls - 1) ** 2).sum())

    best = cost(answer.controls)
    assert answer.cost == pytest.approx(best, rel=1e-6)
    assert answer.verified_cost == pytest.approx(best, rel=1e-7)
    for k in (0, 4, 9):
        for change in (-1e-2, 1e-2):
            moved = answer.controls.copy()
            moved[0, k] += change
            assert cost(moved) > best


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (0.0, "integrator_tolerance must be a number from 1e-12 to 0.1, got 0.0"),
        (np.nan, "integrator_tolerance must be a number from 1e-12 to 0.1, got nan"),
        (1.0, "integrator_tolerance must be a number from 1e-12 to 0.1, got 1.0"),
        ("1e-6", "integrator_tolerance must be a number, got '1e-6'"),
    ],
)
def test_tolerance_that_is_none_is_refused(value: Any, message: str) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        left_alone(robertson, 3, 40.0, integrator_tolerance=value)


def test_problem_says_how_it_steps() -> None:
    problem = left_alone(robertson, 3, 40.0)
    assert "stiff to 1e-06 a check" in repr(problem)
    equal = replace(problem, integrator_tolerance=None)
    assert "stiff in 4 step(s) a check" in repr(equal)
    assert problem.automatic == 4 and equal.automatic == 0
    assert replace(problem, integrator="rk4").automatic == 0


def test_step_is_taken_up_to_the_allowed_error_and_no_further() -> None:
    def rate(_: float, x: ca.SX) -> ca.SX:
        return -(x**2)

    begun, h = 1.0, 0.5
    after, error = (
        abs(float(ca.DM(value)))
        for value in rodas4_with_error(rate, ca.SX(begun), 0.0, h)
    )
    for part, taken in ((0.999, False), (1.001, True)):
        z = ca.SX.sym("z", 4)
        tolerance = part * error / begun  # Larger at the start.
        tick = ca.Function(
            "tick",
            [z],
            [ticked(rate, z, ca.SX(1), duration=1.0, tolerance=tolerance)],
        )
        x, most, left, following = np.array(tick([begun, begun, 1.0, h])).ravel()
        assert most == begun
        assert x == pytest.approx(after if taken else begun, rel=1e-15)
        assert left == (1 - h if taken else 1.0)
        assert following == pytest.approx(0.9 * h, rel=1e-3)  # Since e is 1.


def test_what_has_decayed_is_not_followed_any_more() -> None:
    """Fifty time constants: relative to its own size it would take 230 steps."""

    def decay(_: float, x: ca.SX) -> ca.SX:
        return -50 * x

    assert ticks(decay, [1.0], duration=1.0, tolerance=1e-6) < 50
