"""The closed loop: the plant against scipy, stopping and going on."""

from collections.abc import Iterator

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from swarmstart.heuristics import Budget, ChaoticPSO
from swarmstart.ocp import (
    Bounds,
    Decision,
    InvalidProblemError,
    Model,
    OptimalControlProblem,
    Planner,
    Plant,
    RecedingHorizon,
    SearchSettings,
    Step,
    collected,
    fly,
    simulate,
)

Array = NDArray[np.float64]


class Clockwork:
    """A controller whose control is the time, plus what it remembers."""

    dt = 0.2

    def decide(
        self,
        time: float,
        state: Array,
        previous: Decision | None,
        *,
        rng: np.random.Generator,
    ) -> Decision:
        memory = previous.control if previous else np.zeros(1)
        return Decision(control=memory + time, plans=())


@pytest.fixture(scope="module")
def controller(pendulum: Model) -> RecedingHorizon:
    x, u = pendulum.states, pendulum.controls
    problem = OptimalControlProblem(
        pendulum,
        horizon=0.6,
        intervals=3,
        stage_cost=ca.sumsqr(x) + 0.1 * u**2,
        bounds=Bounds(controls=(-8, 8)),
    )
    search = SearchSettings(algorithm=ChaoticPSO(size=6), budget=Budget(evaluations=60))
    return RecedingHorizon(planner=Planner(problem, search=search))


@pytest.fixture(scope="module")
def plant(pendulum: Model) -> Plant:
    return Plant(pendulum, dt=0.2, substeps=10)


def test_plant_is_what_scipy_integrates(plant: Plant) -> None:
    states = plant(np.array([1.0, -0.5]), np.array([2.0]))
    exact = solve_ivp(
        lambda _, y: [y[1], 2 - 9.81 * np.sin(y[0])],
        (0, 0.2),
        [1.0, -0.5],
        t_eval=0.02 * np.arange(1, 11),
        rtol=1e-12,
        atol=1e-12,
    )
    # Ten RK4 steps of 20 ms.
    np.testing.assert_allclose(states, exact.y, atol=1e-7)


def test_flight_that_is_stopped_goes_on_with_the_same_bits(
    plant: Plant, controller: RecedingHorizon
) -> None:
    x0 = np.array([1.0, 0.0])
    whole = simulate(plant, controller, x0, steps=6, rng=np.random.default_rng(5))
    rng = np.random.default_rng(5)
    stopped = list(fly(plant, controller, x0, steps=3, rng=rng))
    memory = rng.bit_generator.state
    fresh = np.random.default_rng(99)
    fresh.bit_generator.state = memory
    rest = fly(
        plant,
        controller,
        stopped[-1].dense_states[:, -1],
        steps=6,
        rng=fresh,
        done=3,
        previous=stopped[-1].decision,
    )
    joined = collected(plant, [*stopped, *rest])
    np.testing.assert_array_equal(joined.dense_states, whole.dense_states)
    np.testing.assert_array_equal(joined.controls, whole.controls)
    np.testing.assert_array_equal(joined.times, whole.times)


def test_time_and_memory_go_on_where_the_flight_was_stopped(plant: Plant) -> None:
    rng, clock = np.random.default_rng(0), Clockwork()
    first = list(fly(plant, clock, [0, 0], steps=2, rng=rng))
    last = first[-1]
    x0, memory = last.dense_states[:, -1], last.decision
    rest = list(fly(plant, clock, x0, steps=4, rng=rng, done=2, previous=memory))
    assert [step.number for step in rest] == [2, 3]
    flown = collected(plant, first + rest)
    # 0, 0.2, 0.4, 0.6 s, summed up.
    np.testing.assert_allclose(flown.controls, [[0, 0.2, 0.6, 1.2]])


def test_seed_decides_every_bit(plant: Plant, controller: RecedingHorizon) -> None:
    first, again, other = (
        simulate(plant, controller, [1, 0], steps=2, rng=np.random.default_rng(seed))
        for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first.dense_states, again.dense_states)
    assert not np.array_equal(first.dense_states, other.dense_states)


def test_trajectory_fits_together(plant: Plant, controller: RecedingHorizon) -> None:
    flown = simulate(plant, controller, [1, 0], steps=4, rng=np.random.default_rng(0))
    np.testing.assert_allclose(flown.times, 0.2 * np.arange(5))
    np.testing.assert_allclose(flown.dense_times, 0.02 * np.arange(41))
    np.testing.assert_array_equal(flown.states, flown.dense_states[:, ::10])
    np.testing.assert_array_equal(flown.states[:, 0], [1, 0])
    assert flown.controls.shape == (1, 4)
    assert flown.step_seconds.shape == (4,)
    for k, decision in enumerate(flown.decisions):
        np.testing.assert_array_equal(flown.controls[:, k], decision.control)
        held = plant(flown.states[:, k], decision.control)
        np.testing.assert_array_equal(held[:, -1], flown.states[:, k + 1])


def test_finished_steps_are_handed_out_one_by_one(
    plant: Plant, controller: RecedingHorizon
) -> None:
    flight: Iterator[Step] = fly(
        plant, controller, [1, 0], steps=10**9, rng=np.random.default_rng(0)
    )
    assert [next(flight).number for _ in range(3)] == [0, 1, 2]


def test_no_steps_left_is_an_empty_flight(
    plant: Plant, controller: RecedingHorizon
) -> None:
    rng = np.random.default_rng(0)
    assert not list(fly(plant, controller, [1, 0], steps=3, rng=rng, done=3))


def test_refuses_what_does_not_fit_the_plant(
    plant: Plant, controller: RecedingHorizon, pendulum: Model
) -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InvalidProblemError, match=r"x0 must have shape \(2,\)"):
        simulate(plant, controller, [1, 0, 0], steps=1, rng=rng)
    slow = Plant(pendulum, dt=0.3, substeps=1)
    with pytest.raises(InvalidProblemError, match=r"got 0.3 s and 0.19.* s|and 0.2 s"):
        simulate(slow, controller, [1, 0], steps=1, rng=rng)


@pytest.mark.parametrize(
    ("dt", "substeps", "message"),
    [
        (0.2, 0, "substeps must be an integer of at least 1, got 0"),
        (-0.2, 4, "dt must be positive, got -0.2"),
    ],
)
def test_refuses_what_is_no_plant(
    pendulum: Model, dt: float, substeps: int, message: str
) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        Plant(pendulum, dt=dt, substeps=substeps)


def test_a_plants_parameters_are_held_over_each_of_its_steps() -> None:
    """x' = p: the integral of a staircase."""
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    model = Model(states=x, controls=ca.SX.sym("u"), parameters=p, ode=p)
    plant = Plant(model, dt=0.5, substeps=5, parameters=lambda t: 10 * t[None])
    dense = plant(np.array([1.0]), np.zeros(1), 2.0)
    steps = 10 * (2.0 + 0.1 * np.arange(5)) * 0.1
    np.testing.assert_allclose(dense[0], 1 + np.cumsum(steps), rtol=1e-14)


def test_refuses_a_plant_whose_parameters_nobody_gives() -> None:
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    model = Model(states=x, controls=ca.SX.sym("u"), parameters=p, ode=p * x)
    with pytest.raises(InvalidProblemError, match="has 1 parameters: expected a func"):
        Plant(model, dt=0.1, substeps=1)


def test_refuses_to_collect_nothing_or_with_a_gap(
    plant: Plant, controller: RecedingHorizon
) -> None:
    with pytest.raises(InvalidProblemError, match="at least one finished step"):
        collected(plant, [])
    rng = np.random.default_rng(0)
    steps = list(fly(plant, controller, [1, 0], steps=3, rng=rng))
    with pytest.raises(InvalidProblemError, match=r"without a gap, got \[0, 2\]"):
        collected(plant, [steps[0], steps[2]])


def test_a_plant_that_diverges_is_named_with_its_step() -> None:
    """x' = -1000 x by steps of 0.1 s: Runge-Kutta multiplies by four million."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    plant = Plant(Model(states=x, controls=u, ode=-1e3 * x + u), dt=0.2, substeps=2)
    with pytest.raises(InvalidProblemError, match=r"the finite numbers in step \d+"):
        list(fly(plant, Clockwork(), [1.0], steps=100, rng=np.random.default_rng(0)))
