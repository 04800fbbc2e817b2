"""The transfer's problem, its answer and its flight."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from swarmstart.cases.kinds.transfer.kind import measure
from swarmstart.cases.kinds.transfer.pose import TransferFlight, assigned_goals
from swarmstart.cases.kinds.transfer.scenario import TransferScenario
from swarmstart.ocp import InvalidProblemError, Source, simulate
from swarmstart.tests.cases.kinds.flights import build

if TYPE_CHECKING:
    from swarmstart.tests.cases.kinds.transfer.conftest import Make

DENSE = ("dense_times", "dense_states")


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_one_uav_with_the_right_speed_flies_straight_for_nothing(make: Make) -> None:
    alone = make("swap_5", "uavs=[{start: {speed_m_s: 5, heading_rad: 0, x_m: 0, "
                 "y_m: 0}, goal: {x_m: 50, y_m: 0}}]")  # fmt: skip
    flight = build(alone)
    plan = flight.loop.planner.plan(flight.x0, rng=rng())
    assert plan.cost == pytest.approx(0.0, abs=1e-9)
    assert plan.feasible


def test_the_cost_is_the_integral_of_the_weighted_squares(
    flight: TransferFlight, scenario: TransferScenario
) -> None:
    """Controls are constant on the intervals, so the integral is a sum."""
    problem = flight.loop.planner.problem
    lower, upper = problem.control_limits
    size = (lower.size, problem.intervals)
    controls = 0.1 * rng().uniform(lower[:, None], upper[:, None], size)
    cost, _ = flight.loop.planner.fitness.value(controls, flight.x0)
    parts = controls.reshape(5, 2, -1)
    normalised = (parts[:, 0] / 2) ** 2 + (parts[:, 1] / np.radians(30)) ** 2
    assert cost == pytest.approx(normalised.sum() * problem.dt, rel=1e-12)


def test_the_swap_of_five_finds_the_best_known_cost(
    flight: TransferFlight, scenario: TransferScenario
) -> None:
    """0.3865 with distances at the checks only; on the whole path it takes more."""
    flown = simulate(flight.plant, flight.controller, flight.x0, steps=20, rng=rng())
    found = measure(scenario, flight, flown)
    assert found["cost"] is not None and found["violation"] is not None
    assert 0.386 <= float(str(found["cost"])) <= 0.396
    assert float(str(found["violation"])) <= 1e-6
    assert (found["confirmed"], found["converged"]) == (1, 1)
    # Flown by a finer integrator.
    assert float(str(found["goal_error_m"])) <= 1e-5
    assert float(str(found["min_distance_checked_m"])) >= 5 - 5e-4
    nearest = float(str(found["min_distance_m"]))
    assert nearest >= 5 - 1e-3  # The path tolerance is 0.0005.
    # The path is the same, however many of the plant's steps are kept.
    few = {name: getattr(flown, name)[..., ::10] for name in DENSE}
    again = measure(scenario, flight, replace(flown, **few))
    assert again["min_distance_m"] == pytest.approx(nearest, abs=1e-6)


def test_the_plan_is_made_once_and_flown_to_its_end(flight: TransferFlight) -> None:
    flown = simulate(flight.plant, flight.controller, flight.x0, steps=20, rng=rng())
    first = flown.decisions[0].plans[0]
    assert all(decision.plans[0] is first for decision in flown.decisions)
    np.testing.assert_array_equal(flown.controls, first.controls)
    with pytest.raises(InvalidProblemError, match="must end with its plan of 20"):
        simulate(flight.plant, flight.controller, flight.x0, steps=21, rng=rng())


def test_goals_can_be_shared_out_by_the_least_squared_distances(make: Make) -> None:
    """Across the circle the nearest goal is a neighbour's start, not the antipode."""
    given = make("swap_5")
    shared = make("swap_5", "assignment=shortest")
    starts = np.array([[u.start.x_m, u.start.y_m] for u in given.uavs])

    def total(scenario: TransferScenario) -> float:
        return float(np.sum((assigned_goals(scenario) - starts) ** 2))

    assert total(given) == pytest.approx(5 * 50**2)
    assert total(shared) < total(given) / 10


def test_without_polish_a_member_counts_as_not_feasible(make: Make) -> None:
    """Its held controls miss the goals by centimetres."""
    flight = build(make("swap_5", "polish=none"))
    plan = flight.loop.planner.plan(flight.x0, rng=rng())
    assert plan.source is Source.SEARCH
    assert not plan.feasible
    assert plan.search.violation == pytest.approx(0.0, abs=1e-9)
