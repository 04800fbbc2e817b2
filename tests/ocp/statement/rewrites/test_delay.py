"""Delayed controls against SciPy, python-control, and a plant with its own delay.

Values, paths and optima with each other feature are compared with Opti and SciPy in
tests/ocp/test_feature_pairs.py, one by one in tests/ocp/test_feature_table.py.
"""

import re
from dataclasses import replace
from typing import Any

import casadi as ca
import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from swarmstart.arrays import Array
from swarmstart.ocp import (
    AlgebraicEquations,
    Bounds,
    Free,
    InvalidProblemError,
    IpoptOptions,
    Known,
    Model,
    OpenLoop,
    OptimalControlProblem,
    PathConstraint,
    Planner,
    Plant,
    RecedingHorizon,
    SteppedPlant,
    Team,
    TransportDelay,
    ensemble,
    interpolate,
    phases,
    simulate,
    solve,
)
from swarmstart.ocp.loop.team import Agent
from swarmstart.ocp.lower_bound.bounding import lower_bound
from swarmstart.ocp.statement.rewrites.chain import lowered
from swarmstart.ocp.statement.rewrites.rewrite import Rewrite

X, U = ca.SX.sym("x", 2), ca.SX.sym("u")
DT, FORCE = 0.2, Bounds(controls=(-2, 2))
CART = Model(
    states=X,
    controls=U,
    ode=ca.vertcat(X[1], U - 0.5 * X[1]),
    outputs={"push": U - 0.5 * X[1]},
)


def cart(delay: float, **changes: Any) -> OptimalControlProblem:
    """Return a cart whose force is late."""
    stated = OptimalControlProblem(
        CART,
        horizon=10 * DT,
        intervals=10,
        stage_cost=ca.sumsqr(X) + 0.1 * U**2,
        bounds=FORCE,
        features=[TransportDelay({"u": delay})],
    )
    return replace(stated, **changes)


def controller(problem: OptimalControlProblem, **changes: Any) -> RecedingHorizon:
    planner = Planner(problem, search=None, polish=IpoptOptions())
    return RecedingHorizon(planner=planner, append="last", **changes)


@pytest.mark.parametrize("intervals", [1, 3])
def test_path_is_that_of_the_delay_differential_equation(intervals: int) -> None:
    before = np.array([[0.7, -0.4, 1.1]])
    answer = solve(
        cart(intervals * DT), [1.0, 0.0], search=None, seed=0,
        known=Known(previous=before),
    )  # fmt: skip
    sent = np.concatenate([before[0], answer.controls[0]])

    def rate(t: float, x: Array) -> list[float]:
        late = sent[int((t - intervals * DT) // DT) + 3]
        return [x[1], late - 0.5 * x[1]]

    x = np.array([1.0, 0.0])
    for k in range(10):  # The control jumps at the ends of intervals.
        begin, end = k * DT + 1e-12, (k + 1) * DT - 1e-12
        x = solve_ivp(rate, (begin, end), x, rtol=1e-11, atol=1e-13).y[:, -1]
        np.testing.assert_allclose(answer.states[:, k + 1], x, atol=1e-7)
    assert answer.status.is_confirmed
    # Outputs are of the model, which receives the late control.
    late = sent[3 - intervals]
    assert answer.outputs[0, 0] == pytest.approx(late - 0.5 * 0.0)


def test_first_control_is_that_of_the_discrete_regulator_with_the_delay_line() -> None:
    # Without bounds, and with the regulator's cost to go at the end, a plan is the
    # regulator of the sampled system (x, u one and two intervals ago).
    A = np.array([[0.0, 1.0], [0.0, -0.5]])
    both = expm(np.block([[A, np.array([[0.0], [1.0]])], [np.zeros((1, 3))]]) * DT)
    Ad = np.block(
        [
            [both[:2, :2], np.zeros((2, 1)), both[:2, 2:]],
            [np.zeros((1, 4))],
            [0.0, 0.0, 1.0, 0.0],
        ]
    )
    Bd = np.array([[0.0], [0.0], [1.0], [0.0]])
    Q = np.diag([1.0, 1.0, 0.0, 0.0])
    K, _, _ = control.dlqr(Ad, Bd, Q, [[0.1]])
    sampled = cart(
        2 * DT, horizon=60 * DT, intervals=60, quadrature="left",
        stage_cost=(ca.sumsqr(X) + 0.1 * U**2) / DT, bounds=Bounds(), substeps=8,
    )  # fmt: skip
    known = Known(previous=[[0.3, -0.6]])
    answer = solve(sampled, [1.0, -0.2], search=None, lanes=0, known=known, seed=0)
    expected = -float((K @ [1.0, -0.2, -0.6, 0.3])[0])
    assert answer.controls[0, 0] == pytest.approx(expected, rel=1e-6)


def test_states_by_hand_give_the_same_answer() -> None:
    line = ca.SX.sym("line", 2)
    by_hand = Model(
        states=ca.vertcat(X, line),
        controls=U,
        ode=ca.vertcat(X[1], line[1] - 0.5 * X[1], 0, 0),
        next_state=ca.vertcat(X, U, line[0]),
    )
    stated = cart(2 * DT, model=by_hand, features=(), bounds=FORCE)
    mine = solve(cart(2 * DT), [1.0, 0.0], known=Known(previous=[0.5]), seed=0)
    other = solve(stated, [1.0, 0.0, 0.5, 0.5], seed=0)
    assert mine.cost == pytest.approx(other.cost, rel=1e-12)
    np.testing.assert_allclose(mine.controls, other.controls, atol=1e-9)
    assert mine.state_names == ("x_0", "x_1")


def test_closed_loop_continues_the_delay_line_of_the_last_plan() -> None:
    problem = cart(3 * DT)
    loop = controller(problem, previous=np.array([0.4]))
    plant = Plant(CART, dt=DT, substeps=8)
    flight = simulate(plant, loop, [1.0, 0.0], steps=8, seed=0)
    sent = np.concatenate([[0.4, 0.4, 0.4], flight.controls[0]])
    for k, decision in enumerate(flight.decisions):
        np.testing.assert_array_equal(decision.plans[0].x0[2:], sent[k : k + 3][::-1])
        assert decision.acting is not None
        assert decision.acting[0] == sent[k]


def test_a_plant_that_delays_by_itself_flies_the_same() -> None:
    class Late:
        def __init__(self) -> None:
            self.line = [0.0, 0.0]
            self.inner = Plant(CART, dt=DT, substeps=8)

        def step(self, x: Array, u: Array, dt: float) -> Array:
            self.line.append(float(u[0]))
            return self.inner(x, np.array([self.line.pop(0)]))[:, -1]

    loop = controller(cart(2 * DT))
    own = simulate(SteppedPlant(Late(), dt=DT), loop, [1.0, 0.0], steps=6, seed=0)
    ours = simulate(Plant(CART, dt=DT, substeps=8), loop, [1.0, 0.0], steps=6, seed=0)
    np.testing.assert_allclose(own.states, ours.states, atol=1e-12)
    np.testing.assert_array_equal(own.controls, ours.controls)
    np.testing.assert_allclose(
        ours.outputs[0, ::8][:3],
        [0.0, 0.0, ours.controls[0, 0] - 0.5 * 0.0],
        atol=1e-12,
    )


def test_what_is_computed_of_a_run_takes_the_late_controls() -> None:
    # The slope by x of x' = x u is u, as the model receives it.
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    model = Model(states=x, controls=u, ode=x * u)
    problem = OptimalControlProblem(
        model, horizon=4 * DT, intervals=4, stage_cost=(x - 2) ** 2 + u**2,
        bounds=FORCE, features=[TransportDelay({"u": DT})],
    )  # fmt: skip
    answer = solve(problem, [1.0], known=Known(previous=[0.3]), search=None, seed=0)
    sent = [0.3, *answer.controls[0]]
    for k in range(4):
        system = answer.linearised((k + 0.5) * DT)
        assert float(system.A[0, 0]) == pytest.approx(sent[k], abs=1e-12)
    loop = controller(problem, previous=np.array([0.3]))
    plant = Plant(model, dt=DT, substeps=2)
    run = simulate(plant, loop, [1.0], steps=3, seed=0)
    np.testing.assert_array_equal(run.received[0], [0.3, *run.controls[0, :2]])
    assert run.at(1.5 * DT)[1] == run.controls[0, 0]
    # Between the steps of the plant, the path is that of finer ones.
    fine = simulate(Plant(model, dt=DT, substeps=8), loop, [1.0], steps=3, seed=0)
    path = interpolate(plant, run)(fine.dense_times)
    np.testing.assert_allclose(path, fine.dense_states, atol=1e-5)


def test_open_loop_flies_the_plan() -> None:
    problem = cart(2 * DT)
    answer = solve(problem, [1.0, 0.0], search=None, seed=0)
    flown = simulate(
        Plant(CART, dt=DT, substeps=8), OpenLoop(loop=controller(problem)), [1.0, 0.0],
        steps=10, seed=0,
    )  # fmt: skip
    np.testing.assert_allclose(flown.states, answer.states, atol=1e-6)


def test_members_of_an_ensemble_with_controls_of_their_own_are_late_alike() -> None:
    k = ca.SX.sym("k")
    damped = Model(
        states=X, controls=U, ode=ca.vertcat(X[1], U - k * X[1]), parameters=k
    )
    one = cart(2 * DT, model=damped)
    every = ensemble(one, {"k": [0.5, 0.5]}, robust_horizon=2)
    assert lowered(every).core.model.nx == 2 * (2 + 2)
    both = solve(every, [1.0, 0.0], search=None, seed=0)
    alone = solve(cart(2 * DT), [1.0, 0.0], search=None, seed=0)
    assert both.cost == pytest.approx(alone.cost, rel=1e-7)
    plant = Plant(
        damped, dt=DT, substeps=8, parameters=lambda t: np.full((1, t.size), 0.5)
    )
    flown = simulate(plant, controller(every), [1.0, 0.0], steps=4, seed=0)
    single = simulate(
        Plant(CART, dt=DT, substeps=8), controller(cart(2 * DT)), [1.0, 0.0], steps=4,
        seed=0,
    )  # fmt: skip
    np.testing.assert_allclose(flown.states, single.states, atol=1e-6)


class Braked(Rewrite):
    """A feature that appends a path constraint: the control is at least -1."""

    role = "braked"

    def accepts(self, problem: OptimalControlProblem) -> bool:
        return True

    def apply(self, problem: OptimalControlProblem) -> OptimalControlProblem:
        limit = PathConstraint(
            expression=problem.model.controls, lower=-1.0, name="braked"
        )
        return replace(problem, constraints=[*problem.constraints, limit])


def test_constraint_of_a_feature_has_a_multiplier_by_its_name() -> None:
    soft = PathConstraint(expression=X[0], upper=0.9, weight=0.1, name="near")
    answer = solve(
        cart(0.0, features=[Braked()], constraints=[soft]), [1.0, 0.0], search=None,
        lanes=0, seed=0,
    )  # fmt: skip
    assert answer.controls.min() == pytest.approx(-1.0, abs=1e-6)
    assert answer.multipliers is not None
    assert set(answer.multipliers.path) == {"near", "braked"}
    assert np.abs(answer.multipliers.path["braked"]).max() > 0.01
    loop = simulate(
        Plant(CART, dt=DT, substeps=4), controller(cart(0.0, features=[Braked()])),
        [1.0, 0.0], steps=2, seed=0,
    )  # fmt: skip
    assert [decision.acting for decision in loop.decisions] == [None, None]


def test_no_delay_changes_nothing() -> None:
    stated = cart(0.0)
    assert lowered(stated).links == ()
    found = solve(stated, [1.0, 0.0], seed=0)
    assert found.cost == solve(cart(0.0, features=()), [1.0, 0.0], seed=0).cost


def test_no_delay_is_accepted_where_delays_are_refused() -> None:
    stated = cart(0.0)
    assert Team([Agent(controller=controller(stated))]).dt == DT
    assert phases([stated, stated]).problem.features == ()
    assert "delayed" not in lower_bound(stated, [1.0, 0.0], seconds=1.0).reason


def test_core_is_not_delayed_again() -> None:
    core = lowered(cart(2 * DT)).core
    assert core.features == ()
    assert lowered(core).core is core
    assert core.model.state_names[2:] == ("u 1 interval ago", "u 2 intervals ago")


def test_guess_of_the_states_has_the_line_that_its_controls_give() -> None:
    controls = np.arange(10.0)[None, :]
    pair = lowered(cart(2 * DT))
    start = pair.start([1.0, 0.0], [[7.0, 8.0]])
    rows = pair.states(np.zeros((2, 11)), controls, start)
    np.testing.assert_array_equal(rows[2], [8, *range(10)])
    np.testing.assert_array_equal(rows[3], [7, 8, *range(9)])


@pytest.mark.parametrize(
    ("delay", "words"),
    [
        (
            0.5,
            "number of intervals of 0.2 s, got 0.5 s: the nearest are 0.4 s and 0.6 s$",
        ),
        (0.40000001, "got 0.40000001 s: the nearest are 0.4 s and 0.6 s$"),
        (0.39999999, "got 0.39999999 s: the nearest are 0.2 s and 0.4 s$"),
        (1.9999, "got 1.9999 s: the nearest is 1.8 s$"),
        (2.0, "than the horizon of 2 s, got 2 s: the longest is 1.8 s$"),
        (1e308, r"than the horizon of 2 s, got 1e\+308 s: the longest is 1.8 s$"),
        (2.3, "than the horizon of 2 s, got 2.3 s: the longest is 1.8 s$"),
        (-0.2, "must be finite and at least 0 s, got -0.2"),
        (np.nan, "must be finite and at least 0 s, got nan"),
        (np.inf, "must be finite and at least 0 s, got inf"),
        ("late", "delay of 'u' must be a number"),
    ],
)
def test_delays_that_are_impossible_are_refused(delay: Any, words: str) -> None:
    with pytest.raises(InvalidProblemError, match=words):
        cart(delay)


def test_nearest_delays_that_a_message_names_are_accepted() -> None:
    with pytest.raises(InvalidProblemError, match="the nearest are") as caught:
        cart(0.0, horizon=10 / 3, features=[TransportDelay({"u": 0.9})])
    lower, upper = re.findall(r"([\d.]+) s", str(caught.value))[-2:]
    for named, count in ((lower, 2), (upper, 3)):
        late = cart(0.0, horizon=10 / 3, features=[TransportDelay({"u": float(named)})])
        assert lowered(late).core.model.nx == 2 + count


def test_features_that_do_not_go_together_are_refused() -> None:
    z = ca.SX.sym("z")
    algebraic = Model(
        states=X, controls=U, ode=ca.vertcat(X[1], z),
        algebraic=AlgebraicEquations(symbols=z, residual=z - U),
    )  # fmt: skip
    for changes, words in (
        ({"features": [TransportDelay({"w": DT})]}, "some of u, got w"),
        ({"features": "late"}, "features must be a list of features"),
        ({"features": [None]}, "features must be a list of features"),
        ({"horizon": Free(1.0, 3.0)}, "the horizon must be a number, got a free end"),
        ({"control_shape": "linear"}, "control_shape must be constant, got 'linear'"),
        ({"model": algebraic}, "must not be part of algebraic equations"),
    ):
        with pytest.raises(InvalidProblemError, match=words):
            cart(2 * DT, **changes)
    with pytest.raises(InvalidProblemError, match="mapping of controls to delays"):
        TransportDelay([0.2])  # type: ignore[arg-type]


def test_others_refuse_delays() -> None:
    stated = cart(2 * DT)
    with pytest.raises(InvalidProblemError, match="no delays or other features"):
        phases([stated, stated])
    with pytest.raises(InvalidProblemError, match="take no delays"):
        Team([Agent(controller=controller(stated))])
    bound = lower_bound(stated, [1.0, 0.0])
    assert "a control is delayed" in bound.reason


@pytest.mark.parametrize(
    ("given", "shape"),
    [
        ([1.0, 2.0], (2,)),
        ([[1.0], [2.0]], (2, 1)),
        ([np.nan], (1,)),
        ([[]], (1, 0)),
        ([[[1.0]]], (1, 1, 1)),
    ],
)
def test_controls_before_have_a_row_for_each_control(
    given: Any, shape: tuple[int, ...]
) -> None:
    with pytest.raises(InvalidProblemError) as caught:
        lowered(cart(2 * DT)).start([1.0, 0.0], given)
    assert "(1, k), those of the last k intervals, the last one" in str(caught.value)
    assert str(caught.value).endswith(f", shape {shape}")


@pytest.mark.parametrize(
    ("given", "line"),
    [
        (0.1, [0.1, 0.1]),
        ([0.1], [0.1, 0.1]),
        ([[0.1]], [0.1, 0.1]),
        ([[0.1, 0.2]], [0.2, 0.1]),
        ([[9.0, 0.1, 0.2]], [0.2, 0.1]),
    ],
)
def test_last_controls_before_are_on_their_way(given: Any, line: list[float]) -> None:
    start = lowered(cart(2 * DT)).start([1.0, 0.0], given)
    np.testing.assert_array_equal(start[2:], line)
