"""Held signals against closed forms, states by hand, and a linear programme.

Values, paths and optima with each other feature are those of the peer of the feature
pairs (Opti and SciPy), whose signals are constant within each interval.
"""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import linprog

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    HeldSignals,
    InvalidProblemError,
    IpoptOptions,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Planner,
    Plant,
    RecedingHorizon,
    Start,
    ensemble,
    phases,
    simulate,
    solve,
    solve_many,
)
from swarmstart.ocp.common.expressions import symbol_names
from swarmstart.ocp.loop.plant import at_both_ends
from swarmstart.ocp.rollout.fitness import core_known, stated_known
from swarmstart.ocp.statement import held_signals, lowered
from swarmstart.tests.ocp.feature_pairs.comparison import compared
from swarmstart.tests.ocp.feature_pairs.features import FEATURES, drawn, go_together

X, U = ca.SX.sym("x"), ca.SX.sym("u")
PRICE, LOW = ca.SX.sym("price"), ca.SX.sym("low")
POINT = Model(states=X, controls=U, ode=U)
OTHERS = [
    name for name in FEATURES if all(go_together(name, s) for s in
    ("signal in rates", "signal in cost"))
]  # fmt: skip
SIGNALS = ("signal in rates", "signal in cost")


def bought(**changes: Any) -> OptimalControlProblem:
    """Return a way of length 1, in two seconds, with a price of the control."""
    stated = OptimalControlProblem(
        POINT, horizon=2.0, intervals=2, stage_cost=PRICE * U + U**2, signals=PRICE,
        terminal=[(X, 1.0)], bounds=Bounds(controls=(-2, 2)),
        features=[HeldSignals(["price"])],
    )  # fmt: skip
    return replace(stated, **changes)


def limited(expression: ca.SX, **changes: Any) -> OptimalControlProblem:
    """Return four seconds in which an expression is not below a signal."""
    stated = OptimalControlProblem(
        POINT, horizon=4.0, intervals=4, stage_cost=U**2, signals=LOW,
        constraints=[PathConstraint(expression=expression - LOW, lower=0.0)],
        bounds=Bounds(controls=(-2, 2)), features=[HeldSignals(["low"])],
    )  # fmt: skip
    return replace(stated, **changes)


@pytest.mark.parametrize("lanes", [0, 8])
@pytest.mark.parametrize("first", [0.0, 0.4])
def test_price_counts_for_its_own_interval(first: float, lanes: int) -> None:
    # min sum(p_k u_k + u_k^2) with u_0 + u_1 = 1: u_0 - u_1 = (p_1 - p_0) / 2.
    known = Known(signals=[[first, 1.0, 7.0]])
    found = solve(bought(), [0.0], known=known, search=None, lanes=lanes, seed=0)
    u = np.array([2 + 1 - first, 2 - 1 + first]) / 4
    assert found.controls[0] == pytest.approx(u, abs=1e-7)
    assert found.cost == pytest.approx(first * u[0] + u[1] + (u**2).sum(), abs=1e-8)
    assert found.status.is_confirmed


def test_limit_of_a_state_holds_before_and_after_it_jumps() -> None:
    known = Known(signals=[[0.0, 0.0, 1.0, 0.5, 0.0]])
    found = solve(limited(X), [0.0], known=known, seed=0)
    assert found.states[0] == pytest.approx([0, 0.5, 1, 1, 1], abs=1e-4)
    assert found.cost == pytest.approx(0.5, abs=1e-6)
    # The way back to 0 begins when the limit has fallen, not before.
    back = limited(X, stage_cost=X**2 + U**2, intervals=8, horizon=8.0)
    values = [[0.0, 0.0, 1.0, 1.0, 0.5, -9.0, -9.0, -9.0, -9.0]]
    plan = solve(back, [0.0], known=Known(signals=values), seed=0)
    assert plan.states[0, 2:6] == pytest.approx([1, 1, 1, 0.5], abs=1e-4)
    assert plan.status.is_confirmed


def test_limit_of_a_control_is_that_of_its_own_interval() -> None:
    known = Known(signals=[[0.0, 0.0, 1.0, 0.5, 9.0]])
    found = solve(limited(U), [0.0], known=known, seed=0)
    assert found.controls[0] == pytest.approx([0, 0, 1, 0.5], abs=1e-5)
    assert found.status.is_confirmed


def heated() -> tuple[OptimalControlProblem, Array]:
    """Return a day of a room in hours, and its price and lowest temperature."""
    model = Model(states=X, controls=U, ode=U - 0.1 * (X - 5))
    stated = OptimalControlProblem(
        model, horizon=24.0, intervals=24, stage_cost=PRICE * U,
        signals=ca.vertcat(PRICE, LOW), features=[HeldSignals(["price", "low"])],
        bounds=Bounds(controls=(0, 4), states=([LOW], [24.0])), substeps=4,
    )  # fmt: skip
    hours = np.arange(25)
    price = np.where((hours >= 7) & (hours < 19), 0.4, 0.2)
    low = np.where((hours >= 6) & (hours < 21), 20.0, 17.0)
    return stated, np.array([price, low])


def cheapest(signals: Array) -> float:
    """Return the least cost of a day, by a linear programme with exact steps."""
    a, (price, low) = float(np.exp(-0.1)), signals
    rows, limits = [], []
    for k in range(1, 25):
        # x_k = 5 + a^k 13 + (1 - a) / 0.1 sum of a^(k-1-j) u_j.
        gain = np.where(
            np.arange(24) < k, a ** np.maximum(k - 1.0 - np.arange(24), 0), 0
        )
        free, gain = 5 + a**k * 13, gain * (1 - a) / 0.1
        rows += [-gain, gain]
        limits += [free - max(low[k - 1], low[k]), 24 - free]
    found = linprog(price[:24], rows, limits, bounds=(0, 4))
    assert found.success
    return float(found.fun)


def test_day_of_a_heated_room_is_that_of_a_linear_programme() -> None:
    stated, signals = heated()
    found = solve(stated, [18.0], known=Known(signals=signals), seed=0)
    assert found.status.is_confirmed
    assert found.cost == pytest.approx(cheapest(signals), rel=1e-6)
    ramps = replace(stated, features=())
    other = solve(ramps, [18.0], known=Known(signals=signals), seed=0)
    assert abs(other.cost - found.cost) > 0.01


def test_many_instances_have_the_costs_of_one_after_another() -> None:
    stated, signals = heated()
    both = np.stack([signals, signals + np.array([[0.1], [-0.5]])], axis=-1)
    found = solve_many(
        stated, np.full((1, 2), 18.0), known=Known(signals=both), seed=0, threads=1
    )
    expected = [cheapest(both[:, :, k]) for k in range(2)]
    np.testing.assert_allclose(found.cost, expected, rtol=1e-6)


def test_closed_loop_flies_the_plan_with_a_plant_that_jumps_alike() -> None:
    stated = bought(terminal=[], terminal_cost=4 * (X - 1) ** 2)
    jumps = lambda t: np.where(t < 1.0 - 1e-9, 0.2, 1.0)[None]  # noqa: E731
    pushed = replace(POINT, ode=U + 0.1 * PRICE, signals=PRICE)
    stated = replace(stated, model=pushed, horizon=2.0)
    planner = Planner(stated, search=None, polish=IpoptOptions())
    loop = RecedingHorizon(planner=planner, reference=jumps)
    plant = Plant(pushed, dt=1.0, substeps=3, signals=jumps)
    flown = simulate(plant, loop, [0.0], steps=2, seed=0)
    u = flown.controls[0]
    expected = [0, u[0] + 0.02, u[0] + 0.02 + u[1] + 0.1]
    assert flown.states[0] == pytest.approx(expected, abs=1e-12)
    first = flown.decisions[0].plans[0]
    assert first.states[0, 1] == pytest.approx(flown.states[0, 1], abs=1e-9)


def test_function_that_jumps_at_the_end_of_a_step_is_its_value_before() -> None:
    begins, ends = np.array([0.0, 0.5, 1.0]), np.array([0.5, 1.0, 1.5])
    rows = lambda t: np.array([np.where(t < 1.0, 1.0, 3.0), np.sin(9 * t)])  # noqa: E731
    first, found = at_both_ends(rows, begins, ends)
    np.testing.assert_array_equal(first, [[1.0, 1.0, 3.0], np.sin(9 * begins)])
    np.testing.assert_array_equal(found[0], [1.0, 1.0, 3.0])
    np.testing.assert_array_equal(found[1], np.sin(9 * ends))  # The same bits.


@pytest.mark.parametrize("name", [*OTHERS, "moving limit"])
def test_values_paths_and_optima_with_each_feature_are_those_of_the_peer(
    name: str,
) -> None:
    rng = np.random.default_rng([23, list(FEATURES).index(name)])
    stated = drawn(tuple(s for s in (name, *SIGNALS) if go_together(name, s)), rng)
    stated.held = True
    found = compared(stated, rng)
    assert not found.differences
    assert found.solved


def test_members_of_an_ensemble_share_the_signal() -> None:
    k = ca.SX.sym("k")
    one = bought(model=Model(states=X, controls=U, ode=k * U, parameters=k))
    every = ensemble(one, {"k": [1.0, 1.0]})
    known = Known(signals=[[0.0, 1.0, 7.0]])
    both = solve(every, [0.0], known=known, search=None, lanes=0, seed=0)
    assert both.controls[0] == pytest.approx([0.75, 0.25], abs=1e-6)
    assert both.cost == pytest.approx(0.875, abs=1e-7)


def test_core_keeps_the_signals_and_is_not_rewritten_again() -> None:
    whole = lowered(bought())
    assert whole.core.features == ()
    assert lowered(whole.core).core is whole.core
    assert whole.core.model.state_names == ("x", "price, held")
    assert held_signals(bought()) == {"price"}
    assert held_signals(bought(features=[HeldSignals([])])) == set()
    assert lowered(bought(features=[HeldSignals([])])).links == ()


def test_core_with_the_time_gives_back_what_is_known_of_the_stated_problem() -> None:
    t, k = ca.SX.sym("t"), ca.SX.sym("k")
    timed = Model(states=X, controls=U, ode=U + k * ca.sin(t), time=t, parameters=k)
    whole = lowered(bought(model=timed))
    assert [*symbol_names(whole.core.signals)] == ["price", "tau"]
    assert whole.time_row == 1
    known = Known(parameters=[0.3], signals=[[0.5, 1.0, 7.0]], time=2.0)
    core = core_known(whole, known)
    again = core_known(whole, known._replace(parameters=core.parameters))
    np.testing.assert_array_equal(again.parameters, [0.3, 0.5, 2.0])  # Unchanged.
    back = stated_known(
        whole, whole.start([0.0]), np.array(core.parameters), np.array(core.signals)
    )
    np.testing.assert_array_equal(back.signals, known.signals)
    np.testing.assert_array_equal(back.parameters, known.parameters)
    assert back.time == 2.0


def test_guess_of_the_states_has_the_values_that_are_held() -> None:
    planner = Planner(bought(checks=2), search=None, polish=IpoptOptions())
    known = Known(signals=[[0.5, 9.0, 1.0, 9.0, 7.0]])
    guess = Start(np.zeros((1, 2)), states=np.zeros((1, 5)))
    _, _, posed = planner.posed([0.0], known, guess)
    assert isinstance(posed, Start) and posed.states is not None
    np.testing.assert_array_equal(posed.states[1], [0.0, 0.0, 0.5, 0.5, 6.5])


def test_discrete_time_takes_the_values_at_the_nodes() -> None:
    moved = Model(states=X, controls=U, next_state=X + U)
    stated = bought(model=moved)
    assert lowered(stated).links == () and held_signals(stated) == set()


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ("price", "names of HeldSignals must be a list of names"),
        ([1.0], "names of HeldSignals must be a list of names"),
        (None, "names of HeldSignals must be a list of names"),
        (["prise"], "some of price, got prise"),
        (["price", "price"], "must be different, got 'price', 'price'"),
    ],
)
def test_names_of_no_signals_are_refused(names: Any, words: str) -> None:
    with pytest.raises(InvalidProblemError, match=words):
        bought(features=[HeldSignals(names)])


def test_wrong_signals_are_refused_with_their_names() -> None:
    for signals in ([[0.0, 1.0]], [0.0, 1.0, 1.0], [[0, np.nan, 1]], ()):
        with pytest.raises(InvalidProblemError, match="signals must"):
            solve(bought(), [0.0], known=Known(signals=signals), seed=0)
    with pytest.raises(InvalidProblemError, match="no signals"):
        phases([bought(), bought()])
