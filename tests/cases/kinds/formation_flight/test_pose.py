from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import solve_discrete_are

from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.kinds.formation_flight.pose import (
    FormationFlight,
    NoTerminalSetError,
    flaws,
    leader_positions,
)
from swarmstart.cases.kinds.formation_flight.problem import slot_states
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.planar import unicycle
from swarmstart.ocp import DualMode, Team, right_hand_side
from swarmstart.tests.cases.kinds.flights import build

Make = Callable[..., FormationScenario]


@pytest.fixture(scope="module")
def literal(make: Make) -> FormationFlight:
    return build(make("formation_v", variant="literal"))


@pytest.fixture(scope="module")
def corrected(make: Make) -> FormationFlight:
    return build(make("formation_v"))


def team_of(flight: FormationFlight) -> Team:
    controller = flight.controller
    team = controller.team if isinstance(controller, DualMode) else controller
    assert isinstance(team, Team)
    return team


def test_slots_move_with_the_leader_and_do_not_turn_with_it(
    scenario: FormationScenario, flight: FormationFlight
) -> None:
    times = np.array([0.0, 2.5, 30.0])
    for number, uav in enumerate(scenario.uavs):
        states = slot_states(scenario, number, times)
        for k, time in enumerate(times):
            way = 15.0 * time * np.sqrt(0.5)  # 15 m/s on a heading of pi/4
            where = [20.0 + uav.slot.x_m + way, 40.0 + uav.slot.y_m + way]
            assert states[:, k] == pytest.approx([15.0, np.pi / 4, *where])
        assert np.array_equal(flight.posed.slots(times)[number], states)


def test_the_leader_obeys_the_model_of_the_uavs(scenario: FormationScenario) -> None:
    def rate(_: float, state: np.ndarray) -> np.ndarray:
        return np.array(right_hand_side(unicycle())(state, [0.0, 0.0], [])).ravel()

    flown = solve_ivp(rate, (0.0, 7.0), scenario.leader.vector(), rtol=1e-10)
    assert leader_positions(scenario, np.array([7.0]))[:, 0] == pytest.approx(
        flown.y[2:, -1]
    )


def test_the_flight_starts_where_the_scenario_says(
    scenario: FormationScenario, flight: FormationFlight
) -> None:
    assert flight.x0.shape == (20,)
    assert np.array_equal(flight.x0[4:8], scenario.uavs[1].start.vector())
    assert flight.plant.dt == 1.0 and flight.plant.substeps == 4


@pytest.mark.parametrize(
    ("order", "watches"),
    [
        ("highest_first", [{1, 2, 3, 4}, {2, 3, 4}, {3, 4}, {4}, set()]),
        ("lowest_first", [set(), {0}, {0, 1}, {0, 1, 2}, {0, 1, 2, 3}]),
        ("[3, 1, 2, 5, 4]", [{2}, {0, 2}, set(), {0, 1, 2, 4}, {0, 1, 2}]),
    ],
)
def test_an_agent_watches_all_that_plan_before_it(
    order: str, watches: list[set[int]], make: Make
) -> None:
    team = team_of(build(make("formation_v", f"planning_order={order}")))
    assert [set(agent.watches) for agent in team.agents] == watches
    # Each of them adds its position to the signals, below the four of the slot.
    signals = [a.controller.planner.problem.signals.shape[0] for a in team.agents]
    assert signals == [4 + 2 * len(seen) for seen in watches]


def test_plans_start_at_the_last_one_as_printed_and_one_second_on_as_corrected(
    literal: FormationFlight, corrected: FormationFlight
) -> None:
    shifts = [
        {agent.controller.shift for agent in team_of(flight).agents}
        for flight in (literal, corrected)
    ]
    assert shifts == [{False}, {True}]


def test_the_corrected_terminal_set_is_the_published_one(
    corrected: FormationFlight, flight: FormationFlight
) -> None:
    assert corrected.posed.terminal_set.alpha == pytest.approx(4.322, abs=5e-4)
    # A heading turns the set and leaves its level.
    assert flight.posed.terminal_set.alpha == pytest.approx(4.322, abs=5e-4)
    assert np.linalg.eigvalsh(flight.posed.terminal_set.P) == pytest.approx(
        np.linalg.eigvalsh(corrected.posed.terminal_set.P)
    )


def test_the_literal_terminal_set_is_as_printed(make: Make) -> None:
    on = make("formation_v", "dual_mode.enabled=true", variant="literal")
    terminal_set = build(on).posed.terminal_set
    assert terminal_set.alpha == pytest.approx(0.0170, abs=5e-5)
    assert terminal_set.P[2, 2] == 0.0129
    assert terminal_set.P[0, 2] == terminal_set.P[1, 3] == -0.0063


def test_a_flight_without_dual_mode_designs_no_set(make: Make) -> None:
    off = build(make("formation_v", "dual_mode.enabled=false"))
    assert off.posed.designed_set is None and not off.documents
    assert isinstance(off.controller, Team)
    with pytest.raises(NoTerminalSetError, match="the dual mode is off"):
        _ = off.posed.terminal_set


def test_only_a_set_that_takes_over_must_exist(make: Make) -> None:
    P = "terminal_cost.P=[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"
    short = ("prediction.horizon_s=8e-9", "terminal_cost.design=given", P)
    make("formation_v", *short, "dual_mode.enabled=false")
    with pytest.raises(InvalidScenarioError, match="law that can be designed"):
        make("formation_v", *short, "dual_mode.enabled=true")


def test_dual_mode_is_on_as_corrected_and_off_as_printed(
    literal: FormationFlight, corrected: FormationFlight
) -> None:
    assert isinstance(corrected.controller, DualMode)
    assert isinstance(literal.controller, Team)


def terminal_cost(flight: FormationFlight, error: np.ndarray) -> float:
    """Return the plans' cost of an error at the horizon's end."""
    problem = team_of(flight).agents[4].controller.planner.problem
    parts = ca.Function(
        "end", [problem.model.states, problem.signals], [problem.terminal_cost]
    )
    slot = np.array([15.0, 0.0, 100.0, 60.0])
    return float(parts(slot + error, slot))


def test_the_corrected_terminal_cost_solves_the_sampled_riccati_equation(
    corrected: FormationFlight,
) -> None:
    A = np.eye(4)
    A[2, 0] = 1.0  # x' = v, held for 1 s
    A[3, 1] = 15.0  # y' = 15 psi
    B = np.array([[1.0, 0.0], [0.0, 1.0], [0.5, 0.0], [0.0, 7.5]])
    P = solve_discrete_are(A, B, np.eye(4), np.eye(2))
    assert P[0, 0] == pytest.approx(2.58748, abs=5e-6)
    assert P[1, 1] == pytest.approx(11.15311, abs=5e-6)
    for error in np.random.default_rng(0).normal(size=(5, 4)):
        found = terminal_cost(corrected, error)
        assert found == pytest.approx(error @ P @ error, rel=1e-8)


def test_the_literal_terminal_cost_is_the_printed_one(literal: FormationFlight) -> None:
    error = np.array([1.0, 2.0, 3.0, 4.0])
    printed = 0.0596 * (1 + 4) + 0.0129 * (9 + 16) - 2 * 0.0063 * (1 * 3 + 2 * 4)
    assert terminal_cost(literal, error) == pytest.approx(printed)


def test_a_design_that_is_impossible_is_a_problem_with_its_place(
    make: Make, scenario: FormationScenario
) -> None:
    assert list(flaws(scenario)) == []
    standing = scenario.model_copy(
        update={
            "leader": scenario.leader.model_copy(update={"speed_m_s": 0.0}),
            "vehicle": scenario.vehicle.model_copy(update={"speed_m_s": None}),
        }
    )
    ((path, what),) = flaws(standing)
    assert path == ("weights",)
    assert "cannot be stabilised" in str(what)
