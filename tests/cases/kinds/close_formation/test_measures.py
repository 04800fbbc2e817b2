from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from swarmstart.cases.kinds.close_formation.measures import best_saving, measure
from swarmstart.cases.kinds.close_formation.names import MEASURES
from swarmstart.cases.kinds.close_formation.pose import CloseFormationFlight
from swarmstart.cases.kinds.close_formation.scenario import CloseFormationScenario
from swarmstart.ocp import Plant
from swarmstart.tests.cases.kinds.close_formation.conftest import fly_by_hand
from swarmstart.tests.cases.kinds.flights import build

if TYPE_CHECKING:
    from swarmstart.arrays import Array
    from swarmstart.tests.cases.kinds.close_formation.conftest import Fly, Make

X, Y, PSI, V, Z = 0, 1, 2, 3, 4
STEPS = 300


def still() -> Array:
    return np.zeros((6, STEPS + 1))


@pytest.fixture
def measured(
    scenario: CloseFormationScenario, flight: CloseFormationFlight, by_hand: Fly
) -> Any:
    return lambda offsets, **how: measure(scenario, flight, by_hand(offsets, **how))


def test_a_wingman_that_never_leaves_its_slot(measured: Any) -> None:
    found = measured(still())
    assert found.keys() == MEASURES.keys()
    assert found["x_settle_s"] == found["y_settle_s"] == 0.0
    assert found["x_max_dev_ft"] == found["z_max_ft"] == 0.0
    assert found["position_error_late_ft"] == 0.0
    assert found["evaluations"] == 7 * STEPS
    assert found["step_seconds_max"] == STEPS
    assert found["gap_relative_median"] is found["gap_min"] is None


def test_the_smallest_range_is_of_the_path_between_the_plants_steps(make: Make) -> None:
    """The wingman overtakes its leader in gusts that change at every long step."""
    scenario = make("plant.substep_s=0.1", "plant.gusts.sigma_ft_s=5", "steps=60")
    flight = build(scenario)
    plant, fast = flight.plant, np.tile([[350.0], [0.0], [0.0]], 60)
    states, looks = flight.x0[:, None], []
    for number in range(60):
        begin = number * plant.dt
        known = plant.parameters(np.array([begin]))

        def held(times: Array, known: Array = known) -> Array:
            return np.repeat(known, times.size, axis=1)

        finer = Plant(plant.model, dt=plant.dt, substeps=500, parameters=held)
        looks.append(finer(states[:, -1], fast[:, number]))
        after = plant(states[:, -1], fast[:, number], begin)
        states = np.hstack([states, after])
    ranges = [np.linalg.norm(part[[X, Y, Z]], axis=0).min() for part in looks]
    trajectory = replace(
        fly_by_hand(np.zeros((6, 61)), controls=fast),
        states=states,
        dense_states=states,
    )
    found = measure(scenario, flight, trajectory)["min_range_ft"]
    assert found == pytest.approx(min(ranges), abs=1e-5)
    assert np.linalg.norm(states[[X, Y, Z]], axis=0).min() > min(ranges) + 0.01


def test_settling_counts_from_the_manoeuvre_to_the_sample_after_the_last_excursion(
    measured: Any,
) -> None:
    offsets = still()
    offsets[X, 60:130] = -3.0
    offsets[X, 131] = 1.0  # the limit itself is inside
    offsets[Y, 20:40] = 5.0  # over before the leader does anything
    found = measured(offsets)
    assert found["x_settle_s"] == pytest.approx(8.0)  # 13.0 s less 5 s
    assert found["y_settle_s"] == 0.0


def test_never_settled_is_null(measured: Any) -> None:
    offsets = still()
    offsets[X, -1] = 1.01
    assert measured(offsets)["x_settle_s"] is None


def test_extremes_have_their_signs(measured: Any) -> None:
    offsets = still()
    offsets[X, 60], offsets[X, 70] = 50.0, -20.0
    offsets[Y, 61], offsets[Y, 71] = 4.0, -7.0
    offsets[Z, 62] = -2.0
    found = measured(offsets)
    assert found["x_max_dev_ft"] == pytest.approx(50)
    assert found["x_min_dev_ft"] == pytest.approx(-20)
    assert found["y_max_dev_ft"] == pytest.approx(7)
    assert found["y_min_dev_ft"] == pytest.approx(-7)
    assert found["z_max_ft"] == 2.0


def test_the_last_five_seconds_are_the_samples_after_25_s(measured: Any) -> None:
    offsets = still()
    offsets[X, 250] = 100.0  # at 25 s: before
    offsets[Y, 251:] = 0.5
    offsets[Z, 300] = 5.0
    controls = np.zeros((3, STEPS))
    controls[2, :251], controls[2, 251:] = 9.0, -2.0
    found = measured(offsets, controls=controls)
    assert found["x_rms_last_5s_ft"] == 0.0
    assert found["y_rms_last_5s_ft"] == pytest.approx(0.5)
    assert found["z_rms_last_5s_ft"] == pytest.approx(5 / math.sqrt(50))
    assert found["position_error_late_ft"] == pytest.approx(math.hypot(0.5, 5.0))
    assert found["steady_altitude_command_ft"] == pytest.approx(-2.0)


def test_rises_of_the_cost_are_counted_from_the_manoeuvre_on(measured: Any) -> None:
    costs = np.zeros(STEPS)
    costs[10] = 1.0  # before the manoeuvre
    costs[60], costs[61], costs[62] = 3.0, 2.0, 2.0 + 5e-7
    costs[80] = 1.0
    found = measured(still(), costs=costs)
    assert found["cost_rises"] == 2
    assert found["cost_max"] == 3.0


def test_rises_are_those_of_the_first_ten_seconds_and_those_after(
    measured: Any,
) -> None:
    """The manoeuvre begins at 5 s, step 50: early is before step 150."""
    costs = np.zeros(STEPS)
    costs[50] = 1.0  # against a step before the manoeuvre
    costs[51] = 2.0
    costs[149], costs[150] = 1.0, 2.0
    found = measured(still(), costs=costs)
    names = ("cost_rises", "cost_rises_early", "cost_rises_late")
    assert [found[name] for name in names] == [3, 2, 1]


def test_a_plan_worse_than_the_last_command_is_a_loss(
    measured: Any, by_hand: Fly, flight: CloseFormationFlight
) -> None:
    held = np.zeros((3, STEPS))
    held[0] = 200.0
    states = by_hand(still()).states
    value, _ = flight.loop.planner.fitness.value(
        held[:, [0]], states[:, 1], flight.loop.known(0.1)
    )
    costs = np.full(STEPS, -1.0)
    assert measured(still(), costs=costs, controls=held)["candidate_losses"] == 0
    costs[1] = value + 1e-3
    assert measured(still(), costs=costs, controls=held)["candidate_losses"] == 1


def test_turns_and_speeds(measured: Any) -> None:
    offsets = still()
    offsets[V, 40] = 30.0
    offsets[PSI, 100:] = 0.05  # within one sample of 0.1 s
    found = measured(offsets)
    assert found["speed_max_ft_s"] == 230.0
    assert found["heading_max_deg"] == pytest.approx(math.degrees(0.05))
    assert found["turn_rate_max_deg_s"] == pytest.approx(math.degrees(0.5))


def test_drag_saved_is_that_of_the_fact_sheet(
    measured: Any, flight: CloseFormationFlight
) -> None:
    found = measured(still())
    assert found["drag_saving_ideal_percent"] == pytest.approx(33.518, abs=1e-3)
    assert found["drag_saving_best_percent"] == pytest.approx(33.939, abs=1e-3)
    assert found["drag_saving_percent"] == pytest.approx(33.574, abs=1e-3)
    assert 100 * best_saving(flight) == found["drag_saving_best_percent"]
    offsets = still()
    offsets[Y, 100:120] = 30.0  # far out: 2 s with little saved
    found = measured(offsets)
    assert found["drag_saving_low_s"] == pytest.approx(2.0)
    assert found["drag_saving_min_percent"] < 30
