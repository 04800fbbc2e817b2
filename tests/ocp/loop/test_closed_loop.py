"""Closed loop: interruption and continuation, and any object that makes a step."""

from collections.abc import Iterator
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.heuristics import Budget, ChaoticPSO
from swarmstart.ocp import (
    Bounds,
    Decision,
    DivergedError,
    InvalidProblemError,
    IpoptOptions,
    Mode,
    Model,
    OptimalControlProblem,
    Plan,
    Planner,
    Plant,
    RecedingHorizon,
    SearchSettings,
    Source,
    Step,
    collected,
    fly,
    simulate,
)


class Clockwork:
    """A controller whose control is the time plus the control that it remembers."""

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
def braking() -> OptimalControlProblem:
    """x' = v, v' = u, |v| <= 1, |u| <= 2; from v = 1.5 no plan keeps the bound."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], u)), horizon=1.0, intervals=5,
        stage_cost=ca.sumsqr(x) + u**2,
        bounds=Bounds(states=([-9, -1], [9, 1]), controls=(-2, 2)),
    )  # fmt: skip


def test_a_run_counts_its_steps_without_a_feasible_plan(
    braking: OptimalControlProblem,
) -> None:
    loop = RecedingHorizon(planner=Planner(braking, search=None, polish=IpoptOptions()))
    plant = Plant(braking.model, dt=loop.dt, substeps=2)
    slow = simulate(plant, loop, [0.0, 0.9], steps=4, seed=0)
    assert slow.infeasible_steps == 0 and "without" not in repr(slow)
    fast = simulate(plant, loop, [0.0, 1.5], steps=4, seed=0)
    assert 0 < fast.infeasible_steps < 4
    words = f"; without one: {fast.infeasible_steps} of 4 steps, the first at 0 s"
    assert f"{words} (more: docs/messages.md#some-steps)" in repr(fast)
    lost = simulate(plant, loop, [0.0, 1.5], steps=1, seed=0)
    assert "docs/messages.md#no-step" in repr(lost)
    linear = [replace(one, mode=Mode.LINEAR) for one in fast.decisions]
    assert replace(fast, decisions=tuple(linear)).infeasible_steps == 0


def test_plans_are_found_if_all_are_feasible_and_none_is_the_last_one_shifted(
    braking: OptimalControlProblem,
) -> None:
    planner = Planner(braking, search=None, backend="casadi")

    def plan(speed: float, source: Source = Source.SEARCH) -> Plan:
        return planner.evaluated(np.zeros((1, 5)), [0.0, speed], source=source)

    good, bad, shifted = plan(0.5), plan(1.5), plan(0.5, Source.SHIFTED)
    for plans, found in (
        ((good, good), True), ((good, bad), False), ((shifted, good), False),
        ((plan(1.5, Source.SHIFTED),), False),
    ):  # fmt: skip
        decision = Decision(control=np.zeros(1), plans=plans)
        assert decision.has_feasible_plans is found


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
    # The sum of 0, 0.2, 0.4, 0.6 s.
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
    """x' = -1000 x with steps of 0.1 s: Runge-Kutta multiplies by four million."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    plant = Plant(Model(states=x, controls=u, ode=-1e3 * x + u), dt=0.2, substeps=2)
    with pytest.raises(DivergedError, match=r"the finite numbers in step \d+"):
        list(fly(plant, Clockwork(), [1.0], steps=100, rng=np.random.default_rng(0)))


class Falling:
    """A falling hammer: x'' = u - 9.81, solved by hand."""

    state_names = ("height", "speed")

    def step(self, x: Array, u: Array, dt: float) -> list[float]:
        a = u[0] - 9.81
        after = [x[0] + x[1] * dt + a * dt**2 / 2, x[1] + a * dt]
        x[:] = np.nan  # It may change its arguments.
        return after


def test_an_object_with_a_step_is_flown_as_the_model_it_solves() -> None:
    """Constant acceleration: one Runge-Kutta step is exact."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    model = Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 9.81))
    plant = Plant(model, dt=0.2, substeps=1)
    expected = simulate(plant, Clockwork(), [10, 0], steps=5, seed=0)
    found = simulate(Falling(), Clockwork(), [10, 0], steps=5, seed=0)
    np.testing.assert_allclose(found.dense_states, expected.dense_states, rtol=1e-13)
    np.testing.assert_array_equal(found.controls, expected.controls)
    np.testing.assert_allclose(found.dense_times, expected.times)
    assert found.state_names == ("height", "speed")
    assert found.control_names == ("control_0",)


def test_a_step_that_returns_another_number_of_states_is_refused() -> None:
    class Torn:
        def step(self, x: Array, u: Array, dt: float) -> list[float]:
            return [*x, *u]

    with pytest.raises(InvalidProblemError, match=r"of shape \(2,\), got \(3,\)"):
        simulate(Torn(), Clockwork(), [1, 0], steps=1, seed=0)


def test_refuses_what_makes_no_step() -> None:
    with pytest.raises(InvalidProblemError, match="have step"):
        simulate(Model, Clockwork(), [1, 0], steps=1, seed=0)  # type: ignore[arg-type]


def test_a_seed_is_a_generator_from_it(
    plant: Plant, controller: RecedingHorizon
) -> None:
    seeded = simulate(plant, controller, [1, 0], steps=2, seed=4)
    rng = np.random.default_rng(4)
    given = simulate(plant, controller, [1, 0], steps=2, rng=rng)
    np.testing.assert_array_equal(seeded.dense_states, given.dense_states)


def test_progress_is_told_after_each_step(plant: Plant) -> None:
    told: list[tuple[int, int, str]] = []
    simulate(
        plant, Clockwork(), [0, 0], steps=2, seed=0, progress=lambda *n: told.append(n)
    )
    assert told == [(1, 2, "simulating"), (2, 2, "simulating")]


def test_a_flight_has_the_names_of_its_model(plant: Plant) -> None:
    flown = simulate(plant, Clockwork(), [0, 0], steps=1, seed=0)
    assert flown.state_names == ("x_0", "x_1") and flown.control_names == ("u",)
