"""Legs of held accelerations: least squares as the oracle, and its simulation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.ocp.swarm.legs import (
    LONGEST,
    PointMass,
    State,
    is_feasible,
    least_steps,
    rest,
    write_leg,
)
from swarmstart.ocp.swarm.plans import no_plans

STEP_S = 0.1
BODY = PointMass(np.array([1.0, 1.0, 0.5]), np.array([2.0, 2.0, 1.0]), STEP_S)
NOWHERE = np.zeros(3)


def states(most: float) -> st.SearchStrategy[State]:
    """Return states whose positions and velocities have at most a size."""
    triple = st.tuples(*[st.floats(-most, most)] * 3).map(np.array)
    return st.builds(State, triple, triple)


def pushes(start: State, end: State, steps: int) -> Array:
    """Return the accelerations b + c k of least squares, shape (steps, 3)."""
    k, h = np.arange(steps), STEP_S
    of_velocity = np.array([np.full(steps, h).sum(), h * k.sum()])
    weights = h**2 * (steps - k - 0.5)
    of_position = np.array([weights.sum(), (weights * k).sum()])
    wanted = np.stack(
        [
            end.velocity - start.velocity,
            end.position - start.position - steps * h * start.velocity,
        ]
    )
    found, *_ = np.linalg.lstsq(np.stack([of_velocity, of_position]), wanted)
    return np.asarray(found[0] + k[:, None] * found[1])


def simulated(start: State, held: Array, fine: int) -> tuple[Array, Array]:
    """Return positions and velocities, at so many points of each step."""
    h, position, velocity = STEP_S / fine, start.position, start.velocity
    places, speeds = [position], [velocity]
    for push in np.repeat(held, fine, axis=0):
        position = position + h * velocity + h**2 / 2 * push
        velocity = velocity + h * push
        places.append(position)
        speeds.append(velocity)
    return np.array(places), np.array(speeds)


def excess(start: State, end: State, steps: int) -> tuple[float, float]:
    """Return the largest ratios of accelerations and of speeds to their bounds."""
    held = pushes(start, end, steps)
    _, speeds = simulated(start, held, 1)
    return (
        float((np.abs(held) / BODY.acceleration).max()),
        float((np.abs(speeds) / BODY.speed).max()),
    )


@settings(deadline=None)
@given(states(1.5), states(1.5), st.integers(2, 80))
def test_a_leg_is_feasible_if_its_bounds_hold_in_every_step(
    start: State, end: State, steps: int
) -> None:
    push, speed = excess(start, end, steps)
    feasible = is_feasible(start, end, steps, BODY)
    if feasible:
        assert max(push, speed) <= 1 + 1e-8
    # The parabola through the speeds of the samples is a little higher between them.
    assert feasible or push > 1 - 1e-9 or speed > 1 - STEP_S * 2.0 / 8 / 1.0


@settings(deadline=None)
@given(states(1.0), states(1.0), st.integers(2, 40))
def test_held_accelerations_lead_there_and_the_path_keeps_to_its_chords(
    start: State, end: State, steps: int
) -> None:
    plans = no_plans(1, 60)
    plans.samples[0, 3] = start.position
    length = write_leg(0, 3, (start, end), steps, BODY, plans)
    fine = 8
    path, speeds = simulated(start, pushes(start, end, steps), fine)
    samples: Array = plans.samples[0, 3 : 4 + steps]
    assert samples == pytest.approx(path[::fine], abs=1e-7)
    assert path[-1] == pytest.approx(end.position, abs=1e-7)
    assert speeds[-1] == pytest.approx(end.velocity, abs=1e-7)
    assert (samples[-1] == end.position).all()
    assert length == pytest.approx(
        np.linalg.norm(np.diff(samples, axis=0), axis=1).sum(), abs=1e-7
    )
    bulges = plans.bulges[0, 3 : 3 + steps]
    for part in range(fine + 1):
        share = part / fine
        chord = (1 - share) * samples[:-1] + share * samples[1:]
        places = path[part : part + fine * (steps - 1) + 1 : fine]
        off = np.linalg.norm(places - chord, axis=1)
        assert (off <= bulges + 1e-7).all()
        if part == fine // 2:  # It is just as wide as it must be.
            assert off == pytest.approx(bulges, abs=1e-6)


def test_one_step_leads_only_where_its_acceleration_does() -> None:
    moving = State(np.array([0.005, 0, 0]), np.array([0.1, 0, 0]))
    assert is_feasible(State(NOWHERE, NOWHERE), moving, 1, BODY)
    assert not is_feasible(
        State(NOWHERE, NOWHERE), State(np.array([0.006, 0, 0]), NOWHERE), 1, BODY
    )


@settings(deadline=None)
@given(states(1.0), states(1.0))
def test_no_shorter_leg_is_feasible_than_the_least(start: State, end: State) -> None:
    steps = least_steps(start, end, 300, BODY)
    shorter = range(1, min(steps, 300))
    assert not any(is_feasible(start, end, each, BODY) for each in shorter)
    if steps < LONGEST:
        assert is_feasible(start, end, steps, BODY)


def test_from_rest_to_rest_the_least_time_is_that_of_the_first_acceleration() -> None:
    # b = 6 d / (N (N + 1) h^2) <= a along x; in the limit T = sqrt(6) s for a metre.
    start, end = State(NOWHERE, NOWHERE), State(np.array([1.0, 0, 0]), NOWHERE)
    steps = next(n for n in range(2, 99) if 6 / (n * (n + 1)) <= STEP_S**2)
    assert least_steps(start, end, 300, BODY) == steps == 24
    assert least_steps(start, end, steps - 1, BODY) == LONGEST


def test_what_is_no_number_is_not_feasible() -> None:
    end = State(np.array([np.nan, 0, 0]), NOWHERE)
    assert not is_feasible(State(NOWHERE, NOWHERE), end, 50, BODY)
    assert least_steps(State(NOWHERE, NOWHERE), end, 50, BODY) == LONGEST


def test_a_leg_ends_with_the_plan_and_a_rest_is_without_bulge() -> None:
    plans = no_plans(1, 10)
    plans.samples[0, 4] = 0.0
    start, end = State(NOWHERE, NOWHERE), State(np.ones(3), NOWHERE)
    write_leg(0, 4, (start, end), 50, BODY, plans)
    assert np.isfinite(plans.samples[0, 4:]).all()
    rest(0, 7, plans)
    assert (plans.samples[0, 7:] == plans.samples[0, 7]).all()
    assert (plans.bulges[0, 7:] == 0).all()
    assert (plans.bulges[0, 4:7] > 0).all()
