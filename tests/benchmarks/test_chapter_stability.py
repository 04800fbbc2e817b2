from __future__ import annotations

import math
import re
import shlex
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

import swarmstart
from swarmstart.arrays import Array
from swarmstart.benchmarks.chapter_stability import (
    lateral_eigenvalues,
    longitudinal_eigenvalues,
)
from swarmstart.cases.campaign.running.finished_run import Run
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.commands.front.cli import parser
from swarmstart.cases.format.scenario import Resolved, read_document, resolve
from swarmstart.cases.kinds.planar import by_uav
from swarmstart.cases.kinds.reconfiguration.pose import ReconfigurationFlight
from swarmstart.cases.kinds.reconfiguration.scenario import ReconfigurationScenario
from swarmstart.cases.record.trajectory_arrays import plan_costs
from swarmstart.ocp import InvalidProblemError, Plan, Source, fly
from swarmstart.tests.cases.kinds.flights import build

PAGE = Path(swarmstart.__file__).parent / "docs" / "chapter" / "stability.md"

ONE = [1.0, 1.0, 1.0, 1.0]
POSITION_ONLY = [0.0, 0.0, 1.0, 1.0]
LEADER, FOLLOWER = 2, 0
LONGITUDINAL, LATERAL = (0, 2), (1, 3)

IPOPT = "--variant literal --search none --polish ipopt"
BANK = "--set 'vehicle.bank_rad=[-radians(3), radians(3)]'"
FIRST = f"swarmstart run reconfiguration {IPOPT} --set steps=12"
LIMITED_BANK = f"swarmstart run reconfiguration {IPOPT} {BANK} --set steps=16"
LONG_HORIZON = (
    f"swarmstart run reconfiguration {IPOPT} {BANK} "
    "--set prediction.horizon_s=5 --set prediction.intervals=5 --set steps=12"
)
LEADER_STRAIGHT = (
    f"swarmstart run reconfiguration_reverse {IPOPT} "
    "--set leader=straight --set steps=16"
)
POSITIONS = (
    "swarmstart run reconfiguration --search lshade --polish ipopt --seed 1 "
    "--set weights=[0,0,1,1] --set steps=6"
)


def at_speed(speed: int, *, steps: int) -> str:
    speeds = " ".join(f"--set uavs.{i}.speed_m_s={speed}" for i in range(5))
    straight = f"--set leader=straight --set steps={steps} {speeds}"
    return f"swarmstart run reconfiguration {IPOPT} {straight}"


def resolved(command: str) -> tuple[Resolved, int]:
    options = parser().parse_args(shlex.split(command)[1:])
    scenario = resolve(
        read_document(options.scenario),
        variant=options.variant,
        search=options.search,
        polish=options.polish,
        assignments=options.assignments,
    )
    return scenario, options.seed


def flown(command: str) -> Run:
    return _flown(shlex.join(shlex.split(command)))


@lru_cache
def _flown(command: str) -> Run:
    scenario, seed = resolved(command)
    return run(scenario, seed=seed)


def costs(command: str) -> list[float]:
    return [float(cost) for cost in plan_costs(flown(command).trajectory)]


@lru_cache
def exact_flight(leader: str, weights: str = "[1,1,1,1]") -> ReconfigurationFlight:
    """Return the literal flight with IPOPT alone, to nearly all digits."""
    more = f"--set leader={leader} --set weights={weights} --set ipopt.tolerance=1e-12"
    scenario = resolved(f"swarmstart run reconfiguration {IPOPT} {more}")[0].scenario
    assert isinstance(scenario, ReconfigurationScenario)
    return build(scenario)


def in_the_v(flight: ReconfigurationFlight, speed: float) -> Array:
    """Return all states in the V, with one speed and the heading 0, shape (20,)."""
    return np.concatenate([[speed, 0.0, *slot] for slot in flight.posed.slots])


def planned(flight: ReconfigurationFlight, state: Array) -> Plan:
    """Return the plan from a state, started at straight flight."""
    guess = np.tile(flight.posed.trim, len(flight.posed.steered))[:, None]
    return flight.loop.planner.plan(state, guess=guess, rng=np.random.default_rng(0))


def closed_loop(weights: list[float], *, speed: float, dt: float) -> Array:
    """Return A - B K of the sampled system, K the minimiser of one step's cost."""
    held = np.zeros((6, 6))
    held[2, 0], held[3, 1] = 1.0, speed  # dx' = dv, dy' = v dpsi
    held[0, 4] = held[1, 5] = 1.0  # dv' = a, dpsi' = w
    sampled, Q = expm(held * dt), np.diag(weights)
    A, B = sampled[:4, :4], sampled[:4, 4:]
    K = np.linalg.solve(B.T @ Q @ B, B.T @ Q @ A)
    return np.asarray(A - B @ K)


def planners_loop(flight: ReconfigurationFlight, speed: float, by: float) -> Array:
    """Return the derivative of a follower's next error by its error, shape (4, 4)."""
    columns = []
    for row in np.eye(4):
        ends = []
        for sign in (1.0, -1.0):
            state = in_the_v(flight, speed)
            state[:4] += sign * by * row
            end = by_uav(planned(flight, state).states, 5)[:, :, -1]
            ends.append(end[FOLLOWER] - end[LEADER])
        columns.append((ends[0] - ends[1]) / (2 * by))
    return np.stack(columns, axis=1)


def assert_eigenvalues(
    matrix: Array, weights: list[float], *, speed: float, dt: float, tolerance: float
) -> None:
    """Compare sums and products: a double eigenvalue is not found to all digits."""
    pairs = [
        (LONGITUDINAL, longitudinal_eigenvalues(weights, dt=dt)),
        (LATERAL, lateral_eigenvalues(weights, speed=speed, dt=dt)),
    ]
    for rows, eigenvalues in pairs:
        block = matrix[np.ix_(rows, rows)]
        assert np.trace(block) == pytest.approx(eigenvalues.sum(), abs=tolerance)
        assert np.linalg.det(block) == pytest.approx(0.0, abs=tolerance)
        assert eigenvalues[0] == 0.0
    for rows, columns in ((LONGITUDINAL, LATERAL), (LATERAL, LONGITUDINAL)):
        assert np.abs(matrix[np.ix_(rows, columns)]).max() <= tolerance


# The formulas.


def test_eigenvalues_are_those_of_the_sampled_system_under_the_least_cost() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        weights = rng.uniform(0.1, 10.0, size=4).tolist()
        speed, dt = rng.uniform(0.5, 30.0), rng.uniform(0.1, 2.0)
        loop = closed_loop(weights, speed=speed, dt=dt)
        assert_eigenvalues(loop, weights, speed=speed, dt=dt, tolerance=1e-10)


def test_with_unit_weights_and_a_step_of_a_second() -> None:
    assert longitudinal_eigenvalues(ONE, dt=1.0) == pytest.approx([0.0, 0.6])
    known = {2: 0.0, 4: -0.6, 8: -0.8824, 20: -0.9802, 30: -0.9912}
    for speed, second in known.items():
        found = lateral_eigenvalues(ONE, speed=speed, dt=1.0)
        assert found == pytest.approx([0.0, second], abs=5e-5)  # Four digits are given.


def test_inside_the_unit_circle_if_and_only_if_both_weights_are_positive() -> None:
    for dt in (0.01, 1.0, 100.0):
        for weights, second in (([0, 0, 1, 1], -1.0), ([1, 1, 0, 0], 1.0)):
            found = longitudinal_eigenvalues(weights, dt=dt)
            assert found.tolist() == [0.0, second]
            found = lateral_eigenvalues(weights, speed=4.0, dt=dt)
            assert found.tolist() == [0.0, second]
        assert abs(longitudinal_eigenvalues(ONE, dt=dt)[1]) < 1
        assert abs(lateral_eigenvalues(ONE, speed=4.0, dt=dt)[1]) < 1


def test_a_follower_rings_where_speed_times_step_is_large() -> None:
    for speed in (50.0, 500.0):
        second = lateral_eigenvalues(ONE, speed=speed, dt=1.0)[1]
        # 8 q / (p c^2), and a square of it that is left out.
        assert 1 + second == pytest.approx(8 / speed**2, rel=10 / speed**2)


@pytest.mark.parametrize(
    ("weights", "speed", "dt", "message"),
    [
        ([1, 1, 1], 2.0, 1.0, r"weights must have shape \(4,\), got \(3,\)"),
        ([1, -1, 1, 1], 2.0, 1.0, "weights must be finite and at least 0, got"),
        ([1, np.inf, 1, 1], 2.0, 1.0, "weights must be finite and at least 0, got"),
        ([1, 0, 1, 0], 2.0, 1.0, "weights must not have both q2 and q4 0, got 0 and 0"),
        (ONE, 0.0, 1.0, "speed must be finite and positive, got 0"),
        (ONE, 2.0, -1.0, "dt must be finite and positive, got -1"),
        (ONE, 2.0, np.nan, "dt must be finite and positive, got nan"),
    ],
)
def test_what_has_no_eigenvalues_is_refused(
    weights: list[float], speed: float, dt: float, message: str
) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        lateral_eigenvalues(weights, speed=speed, dt=dt)


def test_no_weight_for_the_longitudinal_motion_is_refused() -> None:
    with pytest.raises(InvalidProblemError, match="both q1 and q3 0, got 0 and 0"):
        longitudinal_eigenvalues([0, 1, 0, 1], dt=1.0)


# The nonlinear closed loop, about the V.


@pytest.mark.parametrize("speed", [2, 4, 8, 20])
def test_the_planner_has_these_eigenvalues_behind_a_straight_leader(speed: int) -> None:
    # Central differences: 0.2 by^2 of truncation (measured), and rounding of 1e-9 times
    # entries of up to v T in the determinant.
    loop = planners_loop(exact_flight("straight"), speed, by=1e-4)
    assert_eigenvalues(loop, ONE, speed=speed, dt=1.0, tolerance=1e-6)
    expected = closed_loop(ONE, speed=speed, dt=1.0)
    np.testing.assert_allclose(loop, expected, atol=1e-6)


def test_weights_on_positions_alone_are_marginal() -> None:
    flight = exact_flight("straight", "[0,0,1,1]")
    loop = planners_loop(flight, 8.0, by=1e-3)
    # As above; 1e-3, since no cost sees speeds and headings.
    assert_eigenvalues(loop, POSITION_ONLY, speed=8.0, dt=1.0, tolerance=1e-5)


def test_near_the_slot_the_cost_falls_by_the_square_of_the_eigenvalue() -> None:
    flight, second = exact_flight("straight"), lateral_eigenvalues(ONE, speed=8, dt=1)
    state = in_the_v(flight, 8.0)
    state[3] += 0.01
    rng = np.random.default_rng(0)
    steps = fly(flight.plant, flight.controller, state, steps=5, rng=rng)
    cost = np.array([step.decision.plans[0].cost for step in steps])
    ratios = cost[1:] / cost[:-1]
    # Relative errors of the linearisation are of the size of the errors themselves.
    np.testing.assert_allclose(ratios, second[1] ** 2, rtol=1e-2)


def test_a_free_leader_manoeuvres_however_small_the_errors_are() -> None:
    free, straight = exact_flight("free"), exact_flight("straight")
    rng = np.random.default_rng(0)
    ratios, banks, thrusts = [], [], []
    for speed in (2, 2, 2, 8, 8, 8, 20, 20, 20):
        draw = rng.normal(size=(5, 4))
        draw[LEADER] = 0.0
        of_size = []
        for size in (1e-2, 1e-3):
            state = in_the_v(free, speed) + size * draw.ravel()
            joint = planned(free, state)
            of_size.append(joint.cost / planned(straight, state).cost)
        assert of_size[0] == pytest.approx(of_size[1], rel=0.02)  # A limit, not 1.
        ratios.append(of_size[1])
        thrust, bank = joint.controls.reshape(5, 2)[LEADER]
        thrusts.append(thrust)
        banks.append(abs(math.degrees(bank)))
    assert [min(ratios), max(ratios)] == pytest.approx([0.53, 0.98], abs=0.005)
    assert [min(banks), max(banks)] == pytest.approx([3.5, 60.0], abs=0.5)
    assert min(thrusts) > 5900


def test_no_error_is_no_equilibrium_with_a_free_leader() -> None:
    flight = exact_flight("free")
    state = in_the_v(flight, 8.0)
    for thrust, bank in ((6000.0, 0.0), (2000.0, 0.5), (0.0, -1.0)):
        common = np.tile([thrust, bank], 5)[:, None]
        plan = flight.loop.planner.evaluated(common, state, source=Source.GUESS)
        assert plan.cost == pytest.approx(0.0, abs=1e-20)  # Squares of rounding errors.
        assert np.abs(plan.states[:, -1] - plan.states[:, 0])[:2].max() > 0.1
    rng = np.random.default_rng(0)
    steps = list(fly(flight.plant, flight.controller, state, steps=5, rng=rng))
    assert max(step.decision.plans[0].cost for step in steps) < 1e-20
    np.testing.assert_allclose([s.state[0] for s in steps], 8 - 0.2 * np.arange(5))


# (5.26) to (5.29).


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_no_plan_of_the_texts_search_is_worse_than_the_last_one(seed: int) -> None:
    command = "swarmstart run reconfiguration --variant literal --set steps=12"
    found = flown(f"{command} --seed {seed}")
    assert found.measures["candidate_losses"] == 0
    assert costlier_again(found) == 9


def test_nor_is_one_in_the_flights_whose_cost_rises() -> None:
    for command in (FIRST, LIMITED_BANK, LEADER_STRAIGHT, POSITIONS):
        assert flown(command).measures["candidate_losses"] == 0


def test_the_last_plan_flown_again_mostly_costs_more_than_before() -> None:
    assert costlier_again(flown(FIRST)) == 9
    assert np.all(np.diff(costs(FIRST)) < 0)


def costlier_again(found: Run) -> int:
    """Return after how many of the steps u*(k), flown again, costs more than J*(k)."""
    joint, flight = found.flight.loop, found.trajectory
    assert joint.planner.problem.intervals == 1
    last = [decision.plans[0] for decision in flight.decisions]
    again = [
        joint.planner.fitness.value(
            last[k].controls, joint.planner.lowered.start(flight.states[:, k + 1])
        )[0]
        for k in range(len(last) - 1)
    ]
    return sum(b > a.cost for a, b in zip(last, again, strict=False))


# Where the cost rises, and where the reference is not reached.


def test_with_little_bank_the_cost_rises() -> None:
    cost = costs(LIMITED_BANK)
    # Seen: 17.94 and 154.8; IPOPT's answers are exact to 1e-7.
    assert min(cost[:9]) == cost[7] == pytest.approx(17.9, abs=0.1)
    assert max(cost[8:]) == cost[11] == pytest.approx(154.8, abs=0.1)
    assert flown(LIMITED_BANK).measures["infeasible_steps"] == 0


def test_behind_a_leader_that_flies_away_the_cost_rises() -> None:
    cost = costs(LEADER_STRAIGHT)
    assert min(cost) == cost[9] == pytest.approx(33.1, abs=0.1)
    assert np.all(np.diff(cost[9:13]) > 0)
    assert cost[15] == pytest.approx(70.0, abs=0.1)


def test_with_weights_on_positions_alone_the_cost_rises() -> None:
    cost = costs(POSITIONS)
    assert cost[1:3] == pytest.approx([21.0, 211.3], abs=0.1)


def test_followers_can_stay_a_turn_off_and_beside_their_slots() -> None:
    found = flown(at_speed(4, steps=60))
    # They end in a cycle of two steps about that point. Seen: 96.1 and 101.3.
    assert costs(at_speed(4, steps=60))[-4:] == pytest.approx(
        [10 * np.pi**2] * 4, abs=3.0
    )
    off = by_uav(found.trajectory.states[:, -1:], 5)[:, :, 0]
    off = np.delete(off - off[LEADER], LEADER, axis=0)
    turns = [0.0, 2 * np.pi, 2 * np.pi, 0.0]
    np.testing.assert_allclose(np.abs(off[:, 1]), turns, atol=0.15)
    error = found.measures["position_error_m"]
    assert error == pytest.approx(4 * np.pi / 4.0, abs=0.05)


def test_a_plan_of_one_step_runs_out_of_room() -> None:
    measures = flown(at_speed(8, steps=30)).measures
    infeasible, nearest = measures["infeasible_steps"], measures["min_distance_m"]
    assert isinstance(infeasible, int)
    assert isinstance(nearest, float)
    assert infeasible >= 5  # Seen: 8.
    assert nearest < 3  # Seen: 1.86; safe are 5.


def test_five_steps_ahead_the_cost_falls_with_little_bank_too() -> None:
    found, cost = flown(LONG_HORIZON).measures, costs(LONG_HORIZON)
    assert found["cost_rises"] == found["candidate_losses"] == 0
    assert np.all(np.diff(cost) < 0)
    error = found["position_error_m"]
    assert isinstance(error, float)
    assert error < 0.1  # Seen: 0.085.


# The page.


def page_sequences() -> list[tuple[str, str]]:
    """Return the commands of the page, each with the costs it says they give."""
    if not PAGE.exists():
        return []  # An installed package has no documentation.
    text = PAGE.read_text().replace("\\\n", " ")
    return re.findall(r"^    (swarmstart run [^\n]*)\n    J: ([^\n]*)$", text, re.M)


def test_the_page_has_the_commands_tested_here() -> None:
    if not PAGE.exists():
        pytest.skip("an installed package has no documentation")
    shown = [resolved(command) for command, _ in page_sequences()]
    known = [LIMITED_BANK, LEADER_STRAIGHT, POSITIONS, at_speed(4, steps=60)]
    for (one, seed), command in zip(shown, [*known, LONG_HORIZON], strict=True):
        other, other_seed = resolved(command)
        assert (one.settings, seed) == (other.settings, other_seed)


@pytest.mark.parametrize(("command", "said"), page_sequences())
def test_the_page_says_what_its_commands_give(command: str, said: str) -> None:
    first, *last = said.split("...")
    cost = costs(command)
    beginning = [float(word) for word in first.split()]
    end = [float(word) for word in " ".join(last).split()]
    # Three digits.
    assert cost[: len(beginning)] == pytest.approx(beginning, rel=5.1e-3)
    assert end == pytest.approx(cost[len(cost) - len(end) :], rel=5.1e-3)
    assert end or len(beginning) == len(cost)
