from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from swarmstart.cases.kinds.close_formation.pose import CloseFormationFlight, commanded
from swarmstart.cases.kinds.close_formation.scenario import CloseFormationScenario
from swarmstart.ocp import Trajectory, simulate
from swarmstart.tests.cases.kinds.flights import build

if TYPE_CHECKING:
    from swarmstart.tests.cases.kinds.close_formation.conftest import Make

AT_SLOT = np.array([60, 23.6, 0, 200, 0, 0.0])
TURNED = np.radians(20)


def cost(flight: CloseFormationFlight, *controls: float, time: float = 5.0) -> float:
    plan = np.array(controls)[:, None]
    value, violation = flight.loop.planner.fitness.value(
        plan, AT_SLOT, flight.loop.known(time)
    )
    assert violation == 0.0
    return value


def flown(scenario: CloseFormationScenario) -> Trajectory:
    flight = build(scenario)
    return simulate(
        flight.plant, flight.controller, flight.x0, steps=scenario.steps,
        rng=np.random.default_rng(0),
    )  # fmt: skip


def test_costs_are_those_of_the_fact_sheet(flight: CloseFormationFlight) -> None:
    for command, value in (
        ((250, TURNED, 0), 7497.199668),
        ((350, np.pi / 4, 0), 6080.402889),
        ((200, 0, 0), 11045.625936),
    ):
        assert cost(flight, *command) == pytest.approx(value, rel=1e-6)


def test_the_manoeuvre_is_not_known_before_it_happens(
    flight: CloseFormationFlight,
) -> None:
    assert cost(flight, 200, 0, 0, time=4.9) < 1.0
    assert cost(flight, 200, 0, 0, time=5.0) > 1e4


def test_the_plant_has_the_sampling_time_and_its_own_steps(make: Make) -> None:
    flight = build(make("plant.substep_s=0.02"))
    assert flight.plant.dt == 0.1 and flight.plant.substeps == 5
    assert flight.agents == 1
    assert np.array_equal(flight.x0, AT_SLOT)


def test_a_longer_horizon_sums_its_steps(make: Make) -> None:
    problem = build(
        make("prediction.horizon_s=0.7", "prediction.intervals=7")
    ).loop.planner.problem
    assert problem.intervals == 7
    assert problem.horizon == pytest.approx(0.7)


def test_the_leaders_state_as_a_command(make: Make) -> None:
    leader = np.array([250.0, 0.3, 1.0])
    assert commanded(make(), leader) == pytest.approx([250, 0.3, 1])
    relative = make("commands.heading_from=leader")
    assert commanded(relative, leader) == pytest.approx([250, 0, 1])


def test_gusts_blow_on_the_plant_and_not_on_the_prediction(make: Make) -> None:
    flight = build(make("plant.gusts.sigma_ft_s=6", "steps=5"))
    assert flight.plant.model.parameters.shape[0] == 6
    assert flight.loop.planner.problem.model.parameters.shape[0] == 3
    calm = build(make("steps=5"))
    assert cost(flight, 250, TURNED, 0) == cost(calm, 250, TURNED, 0)


def test_gusts_follow_their_seed(make: Make) -> None:
    def end(seed: int) -> np.ndarray:
        gusts = ("plant.gusts.sigma_ft_s=6", f"plant.gusts.seed={seed}")
        return flown(make(*gusts, "steps=5")).states[:, -1]

    assert np.array_equal(end(1), end(1))
    assert not np.array_equal(end(1), end(2))


def test_a_turn_rate_limit_is_kept(make: Make) -> None:
    limited = make("autopilot.turn_rate_rad_s=radians(15)", "steps=80")
    turned = np.abs(np.diff(flown(limited).states[2])).max() / 0.1
    # The wake turns it a little besides: qS/(m V) C_Yy dy, under 0.5 deg/s.
    assert np.radians(10) < turned < np.radians(15.5)
