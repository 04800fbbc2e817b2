"""Closed loops with a decided end time, start or parameters, and plants that jump."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    Free,
    InvalidProblemError,
    IpoptOptions,
    Model,
    OpenLoop,
    OptimalControlProblem,
    Planner,
    Plant,
    RecedingHorizon,
    fly,
    simulate,
    solve,
)


def double_integrator() -> Model:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return Model(states=x, controls=u, ode=ca.vertcat(x[1], u))


def fastest(lower: float = 0.05) -> OptimalControlProblem:
    """From 1 to rest at 0 in the shortest time, |u| <= 1: 2 s."""
    model = double_integrator()
    return OptimalControlProblem(
        model,
        horizon=Free(lower, 5.0, guess=3.0),
        intervals=20,
        stage_cost=ca.SX(1),
        bounds=Bounds(controls=(-1, 1)),
        terminal=[model.states],
    )


def test_flight_with_a_free_end_time_ends_at_its_target_in_the_shortest_time() -> None:
    problem = fastest()
    planner = Planner(problem, search=None, polish=IpoptOptions())
    plant = Plant(problem.model, dt=0.3, substeps=30)
    loop = RecedingHorizon(planner=planner, period=0.3)
    flight = simulate(plant, loop, [1.0, 0.0], steps=50, seed=0)
    assert flight.times[-1] == pytest.approx(2.0, abs=2e-2)
    assert len(flight.decisions) == 7
    assert flight.decisions[-1].is_last
    np.testing.assert_allclose(flight.states[:, -1], 0.0, atol=2e-2)
    np.testing.assert_allclose(np.diff(flight.times)[:-1], 0.3)
    assert flight.dense_times[-1] == flight.times[-1]
    assert flight.dense_times.size == flight.dense_states.shape[1]


def test_open_loop_flies_the_decided_time_exactly() -> None:
    problem = fastest()
    planner = Planner(problem, search=None, polish=IpoptOptions())
    flight = simulate(
        Plant(problem.model, dt=0.15, substeps=4),
        OpenLoop(loop=RecedingHorizon(planner=planner)),
        [1.0, 0.0],
        steps=99,
        seed=0,
    )
    answer = solve(problem, [1.0, 0.0], search=None, seed=0)
    assert flight.times[-1] == pytest.approx(answer.decided["end time"], rel=1e-6)
    assert flight.controls.shape == (1, 20)
    np.testing.assert_allclose(flight.states[:, -1], 0.0, atol=1e-8)


def test_open_loop_starts_where_its_plan_decides() -> None:
    model = double_integrator()
    problem = OptimalControlProblem(
        model,
        horizon=1.0,
        intervals=5,
        stage_cost=model.controls**2,
        terminal=[model.states],
        start={"x_0": Free(0.5, 2.0)},
        bounds=Bounds(controls=(-9, 9)),
    )
    planner = Planner(problem, search=None, polish=IpoptOptions())
    loop = RecedingHorizon(planner=planner)
    plant = Plant(model, dt=0.2, substeps=4)
    flight = simulate(plant, OpenLoop(loop=loop), [1.7, 0.0], steps=5, seed=0)
    assert flight.states[0, 0] == pytest.approx(0.5, abs=1e-6)
    np.testing.assert_allclose(flight.states[:, -1], 0.0, atol=1e-8)
    with pytest.raises(InvalidProblemError, match="starts where the state is measured"):
        simulate(plant, loop, [1.7, 0.0], steps=1, seed=0)


def test_end_time_must_be_able_to_shrink_to_the_period() -> None:
    planner = Planner(fastest(lower=0.5), search=None, polish=IpoptOptions())
    with pytest.raises(InvalidProblemError, match=r"shrink to one period of 0\.3 s"):
        RecedingHorizon(planner=planner, period=0.3)
    fixed = replace(fastest(), horizon=1.0)
    with pytest.raises(InvalidProblemError, match="whose end time is free"):
        RecedingHorizon(planner=Planner(fixed, search=None), period=0.3)
    loop = RecedingHorizon(planner=planner)
    with pytest.raises(InvalidProblemError, match="needs a period"):
        simulate(Plant(double_integrator(), dt=1.0, substeps=1), loop, [1, 0],
                 steps=1, seed=0)  # fmt: skip


def test_signals_of_a_shrinking_horizon_are_read_over_what_is_left_of_it() -> None:
    """From 1 to 0 against a headwind of 0.2 t with u in [-1, 1] takes 0.9161 s.

    x(t) = 1 - t + 0.1 t^2, for any times of the nodes of a plan.
    """
    x, u, wind = (ca.SX.sym(n) for n in ("x", "u", "wind"))
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u + wind, signals=wind),
        horizon=Free(0.05, 5.0, guess=3.0),
        intervals=10,
        stage_cost=ca.SX(1),
        bounds=Bounds(controls=(-1, 1)),
        terminal=[x],
    )
    read: list[np.ndarray] = []

    def headwind(times: np.ndarray) -> np.ndarray:
        read.append(times)
        return 0.2 * times[None, :]

    loop = RecedingHorizon(
        planner=Planner(problem, search=None, polish=IpoptOptions()),
        reference=headwind,
        period=0.2,
    )
    plant = Plant(
        problem.model, dt=0.2, substeps=20, signals=lambda times: 0.2 * times[None, :]
    )  # fmt: skip
    flight = simulate(plant, loop, [1.0], steps=20, seed=0)
    assert flight.decisions[-1].is_last
    plans = [times for times in read if times.size == problem.nodes]
    for times, before in zip(plans[1:], flight.decisions, strict=False):
        lasted = before.plans[0].x0[1]
        assert times[-1] == pytest.approx(times[0] - 0.2 + max(lasted, 0.25))
    # The last plans are short, so their signals are nearly those of the run.
    end = (1 - np.sqrt(0.6)) / 0.2
    assert flight.times[-1] + flight.states[0, -1] == pytest.approx(end, abs=0.02)


def test_control_before_a_plan_is_that_held_at_the_end_of_the_period() -> None:
    x, u, before = (ca.SX.sym(n) for n in ("x", "u", "before"))
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=Free(0.05, 5.0, guess=3.0),
        intervals=20,
        stage_cost=1 + 0 * x,
        constraints=[u - before <= 0.1, u - before >= -0.1],
        previous=before,
        bounds=Bounds(controls=(-1, 1)),
        terminal=[x],
    )
    loop = RecedingHorizon(
        planner=Planner(problem, search=None, polish=IpoptOptions()), period=0.5
    )
    flight = simulate(
        Plant(problem.model, dt=0.5, substeps=50), loop, [1.0], steps=2, seed=0
    )
    first, second = (decision.plans[0] for decision in flight.decisions)
    profile = flight.decisions[0].profile
    assert profile is not None and profile.piece < 0.25  # Several pieces in a period.
    held = first.controls[0, int(0.4999 / profile.piece)]
    assert abs(second.controls[0, 0] - held) <= 0.1 + 1e-6
    assert abs(second.controls[0, 0] - first.controls[0, 0]) > 0.1 + 1e-3


def test_plant_of_a_discrete_time_model_steps_once_an_interval() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    model = Model(states=x, controls=u, next_state=x / 2 + u)
    problem = OptimalControlProblem(
        model, horizon=3, intervals=3, step_cost=u**2, terminal=[x],
        bounds=Bounds(controls=(-5, 5)),
    )  # fmt: skip
    loop = RecedingHorizon(planner=Planner(problem, search=None, polish=IpoptOptions()))
    flight = simulate(Plant(model, dt=1.0, substeps=3), loop, [4.0], steps=2, seed=0)
    expected = [4.0]
    for control in flight.controls[0]:
        expected.append(expected[-1] / 2 + control)
    np.testing.assert_allclose(flight.states[0], expected)


def test_plant_follows_signals_and_time() -> None:
    x, wind, t = (ca.SX.sym(n) for n in ("x", "wind", "t"))
    model = Model(
        states=x, controls=ca.SX(0, 1), ode=wind + t, signals=wind, time=t
    )  # fmt: skip
    plant = Plant(
        model, dt=0.5, substeps=5, signals=lambda times: 2 * times[None, :]
    )  # fmt: skip
    after = plant(np.array([0.0]), np.empty(0), time=1.0)
    # The integral of 3 t from 1 to 1.5.
    assert after[0, -1] == pytest.approx(1.5 * (1.5**2 - 1))
    with pytest.raises(InvalidProblemError, match="1 signals: expected a function"):
        Plant(model, dt=0.5, substeps=5)


def test_last_flown_control_is_the_previous_one_of_the_next_plan() -> None:
    x, u, before = (ca.SX.sym(n) for n in ("x", "u", "before"))
    model = Model(states=x, controls=u, ode=u)
    problem = OptimalControlProblem(
        model,
        horizon=1.0,
        intervals=5,
        stage_cost=(x - 3) ** 2,
        constraints=[u - before <= 0.25],
        previous=before,
        bounds=Bounds(controls=(-2, 2)),
    )
    loop = RecedingHorizon(planner=Planner(problem, search=None, polish=IpoptOptions()))
    flight = simulate(Plant(model, dt=0.2, substeps=2), loop, [0.0], steps=6, seed=0)
    moves = np.diff(flight.controls[0], prepend=0.0)
    np.testing.assert_allclose(moves, 0.25, atol=1e-4)


def test_plant_has_the_parameters_that_a_plan_decides() -> None:
    x, u, gain, drag = (ca.SX.sym(n) for n in ("x", "u", "gain", "drag"))
    model = Model(
        states=x, controls=u, ode=gain * u - drag * x,
        parameters=ca.vertcat(gain, drag),
    )  # fmt: skip
    problem = OptimalControlProblem(
        model,
        horizon=1.0,
        intervals=4,
        stage_cost=u**2 + (gain - 2) ** 2,
        decided={"gain": Free(1.0, 3.0)},
        terminal=[x - 1],
    )
    loop = RecedingHorizon(
        planner=Planner(problem, search=None, polish=IpoptOptions()),
        parameters=lambda time: np.array([0.5]),
    )
    plant = Plant(
        model, dt=0.25, substeps=20, decided={"gain": 9.0},
        parameters=lambda times: np.full((1, times.size), 0.5),
    )  # fmt: skip
    flight = simulate(plant, OpenLoop(loop=loop), [0.0], steps=4, seed=0)
    assert flight.states[0, -1] == pytest.approx(1.0, abs=1e-5)
    assert 2.0 < flight.decisions[0].decided["gain"] < 3.0
    np.testing.assert_array_equal(
        plant.with_decided({"gain": 2.0, "drag": 7.0}).parameters(np.zeros(2)),
        [[2.0, 2.0], [0.5, 0.5]],
    )
    with pytest.raises(InvalidProblemError, match=r"some of gain, drag, got \['u'\]"):
        Plant(model, dt=0.25, substeps=1, decided={"u": 1.0})
    with pytest.raises(InvalidProblemError, match="has 1 parameters: expected a func"):
        Plant(model, dt=0.25, substeps=1, decided={"gain": 1.0})


def test_flight_that_has_ended_does_not_go_on() -> None:
    planner = Planner(fastest(), search=None, polish=IpoptOptions())
    loop = RecedingHorizon(planner=planner, period=0.5)
    plant = Plant(double_integrator(), dt=0.5, substeps=2)
    rng = np.random.default_rng(0)
    flown = list(fly(plant, loop, [1.0, 0.0], steps=9, rng=rng))
    last = flown[-1]
    assert last.decision.is_last and last.number < 8
    more = fly(
        plant, loop, last.dense_states[:, -1], steps=9, rng=rng, done=len(flown),
        previous=last.decision,
    )  # fmt: skip
    assert not list(more)


def test_control_before_a_flight_and_after_a_period_is_the_previous_one() -> None:
    """Moves of at most 0.1 per interval; a period has many intervals."""
    x, u, before = (ca.SX.sym(n) for n in ("x", "u", "before"))
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=Free(0.1, 3.0, guess=2.0),
        intervals=20,
        stage_cost=ca.SX(1),
        terminal=[x - 1],
        constraints=[u - before <= 0.1, before - u <= 0.1],
        previous=before,
        bounds=Bounds(controls=(-9, 9)),
    )
    planner = Planner(problem, search=None, polish=IpoptOptions())
    loop = RecedingHorizon(planner=planner, period=0.4, previous=np.array([0.5]))
    plant = Plant(problem.model, dt=0.4, substeps=40)
    flight = simulate(plant, loop, [0.0], steps=2, seed=0)
    profiles = [decision.profile for decision in flight.decisions]
    assert profiles[0] is not None and profiles[1] is not None
    assert profiles[0].controls[0, 0] == pytest.approx(0.6, abs=1e-6)
    held = int(np.ceil(0.4 / profiles[0].piece)) - 1
    assert held > 2
    expected = profiles[0].controls[0, held] + 0.1
    assert profiles[1].controls[0, 0] == pytest.approx(expected, abs=1e-6)


def test_last_step_is_longer_where_too_little_would_be_left_after_it() -> None:
    """2 s in periods of 0.65 s would leave 0.05 s; an end time is at least 0.2 s."""
    problem = fastest(lower=0.2)
    planner = Planner(problem, search=None, polish=IpoptOptions())
    plant = Plant(problem.model, dt=0.65, substeps=80)
    loop = RecedingHorizon(planner=planner, period=0.65)
    flight = simulate(plant, loop, [1.0, 0.0], steps=9, seed=0)
    assert len(flight.decisions) == 3
    assert flight.times[-1] == pytest.approx(2.0, abs=2e-2)
    np.testing.assert_allclose(flight.states[:, -1], 0.0, atol=2e-2)
