"""Flights of swarms: safe whatever the links do, at their goals, and within bounds."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import swarmstart as ss
from swarmstart.ocp.swarm.flight import RULES
from swarmstart.ocp.swarm.plans import no_plans
from swarmstart.ocp.swarm.team import branch

SCALE = np.array([1.0, 1.0, 0.5])


def random_places(n: int, side: float, rng: np.random.Generator) -> list[list[float]]:
    """Return random places in a cube that are 0.4 m apart, scaled."""
    found = list[np.ndarray]()
    while len(found) < n:
        place = side * rng.random(3)
        if all(np.linalg.norm((place - one) * SCALE) >= 0.4 for one in found):
            found.append(place)
    return [one.tolist() for one in found]


def random_swarm(n: int, side: float, seed: int) -> ss.Swarm:
    """Return a swarm with random starts and goals in a cube."""
    rng = np.random.default_rng(seed)
    starts, goals = (random_places(n, side, rng) for _ in range(2))
    return ss.Swarm(starts=starts, goals=goals, distance=0.35, scale=SCALE)


def sampled_distance(flight: ss.SwarmFlight) -> float:
    """Return the least scaled distance at 21 points of each step, on straight lines."""
    scaled = flight.positions * flight.swarm.scale[None, :, None]
    least = np.inf
    for share in np.linspace(0, 1, 21):
        at = (1 - share) * scaled[:, :, :-1] + share * scaled[:, :, 1:]
        apart = np.linalg.norm(at[:, None] - at[None], axis=2)
        apart[np.arange(len(at)), np.arange(len(at))] = np.inf
        least = min(least, float(apart.min()))
    return least


@settings(deadline=None, max_examples=15)
@given(
    st.integers(0, 2**31), st.integers(2, 8), st.integers(0, 6), st.floats(0, 0.6),
    st.integers(1, 4),
)  # fmt: skip
def test_acknowledged_plans_never_meet_and_keep_their_bounds(
    seed: int, n: int, most_delay: int, loss: float, period: int
) -> None:
    swarm = random_swarm(n, 1.8, seed)
    links = ss.Links(period=period, most_delay=most_delay, loss=loss)
    flight = ss.simulate_swarm(swarm, links=links, seconds=15.0, seed=seed)
    assert flight.is_safe
    assert flight.min_distance_m <= sampled_distance(flight) + 1e-12
    path, h = flight.positions, flight.step_s
    assert path[:, :, 0] == pytest.approx(swarm.starts)
    assert (np.abs(np.diff(path, axis=2)) <= 2.0 * h + 1e-9).all()
    # Second differences are mean accelerations; so no commitment makes a jump.
    assert (np.abs(np.diff(path, n=2, axis=2)) <= 1.0 * h**2 + 1e-9).all()
    there = np.isfinite(flight.arrival_s)
    assert path[there, :, -1] == pytest.approx(swarm.goals[there])


def test_all_arrive_though_each_stands_on_the_goal_of_the_next() -> None:
    places = np.array([[0.0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
    swarm = ss.Swarm(starts=places, goals=np.roll(places, 1, axis=0), distance=0.35)
    flight = ss.simulate_swarm(
        swarm, links=ss.Links(most_delay=3, loss=0.3), seconds=60, seed=0
    )
    assert flight.is_safe
    assert flight.arrived_share == 1.0
    assert (flight.path_ratio < 4).all()


def test_rules_that_trust_what_they_heard_collide_where_acknowledged_ones_do_not() -> (
    None
):
    collisions = dict.fromkeys(RULES, 0)
    for seed in range(6):
        swarm = random_swarm(10, 2.2, seed)
        for rule in RULES:
            flight = ss.simulate_swarm(
                swarm, links=ss.Links(most_delay=6, loss=0.3), rule=rule,
                lead_s=None if rule == "acknowledged" else 0.1, seed=seed,
            )  # fmt: skip
            collisions[rule] += not flight.is_safe
    assert collisions["acknowledged"] == 0
    assert collisions["waiting"] > 0
    assert collisions["hearsay"] > 0


def flight_of_2(swarm: ss.Swarm) -> float:
    """Return a time by which all know the last plan of vehicle 2 [s]."""
    log = ss.simulate_swarm(swarm, links=ss.Links(), seed=0).log
    rows = np.flatnonzero((log.vehicle == 2) & log.committed)
    return float(log.ended[rows].max() + 1) * log.step_s / log.ticks


def test_who_is_silent_for_ever_stops_the_others_and_hurts_none() -> None:
    swarm = random_swarm(5, 2.0, 1)
    flight = ss.simulate_swarm(
        swarm, links=ss.Links(silences={2: (0.0, np.inf)}), seconds=5, seed=0
    )
    assert flight.is_safe
    assert flight.commitments == 0
    assert flight.arrived_share == 0.0
    # Who is silent once it has committed to its way to the goal stops none.
    gone = ss.simulate_swarm(
        swarm, links=ss.Links(silences={2: (flight_of_2(swarm), np.inf)}), seed=0
    )
    assert gone.is_safe
    assert gone.arrived_share == 1.0
    # A silence that ends costs time only.
    later = ss.simulate_swarm(swarm, links=ss.Links(silences={2: (0.0, 3.0)}), seed=0)
    assert later.is_safe
    assert later.arrived_share == 1.0
    assert later.arrival_s.min() > 3.0


def obstacle_gap(flight: ss.SwarmFlight, obstacle: ss.Obstacle) -> float:
    """Return the least distance of a vehicle from a ball's surface [m]."""
    centre = obstacle.position(flight.times).T
    apart = np.linalg.norm(flight.positions - centre[None], axis=1)
    return float(apart.min() - obstacle.radius)


def test_vehicles_out_of_range_agree_through_those_between() -> None:
    # Each hears its neighbours alone; the ends of the line change places.
    starts = [[float(x), 0.0, 1.0] for x in range(5)]
    goals = [starts[4], *starts[1:4], starts[0]]
    swarm = ss.Swarm(starts=starts, goals=goals, distance=0.35)
    links = ss.Links(most_delay=2, loss=0.2, radio_range=1.2)
    flight = ss.simulate_swarm(swarm, links=links, seed=0)
    assert flight.is_safe
    assert flight.arrived_share == 1.0
    # The way of a message is four links long, there and back.
    direct = ss.simulate_swarm(swarm, links=ss.Links(most_delay=2, loss=0.2), seed=0)
    for one, least, most in ((flight, 8, np.inf), (direct, 2, 7)):
        log = one.log
        begun, agreed = (
            ticks[log.committed & (log.proposed >= 0)]
            for ticks in (log.proposed, log.ended)
        )
        assert least <= (agreed - begun)[agreed.argmin()] <= most


def test_vehicles_that_no_message_reaches_are_refused_with_their_distance() -> None:
    starts = [[0, 0, 1], [1, 0, 1], [4, 0, 1]]
    swarm = ss.Swarm(starts=starts, goals=[[0, 1, 1], [1, 1, 1], [2, 1, 1]], distance=1)
    with pytest.raises(ss.InvalidProblemError, match="starts, got 2 m: vehicles 1 and"):
        ss.simulate_swarm(swarm, links=ss.Links(radio_range=2), seed=0)
    back = ss.Swarm(starts=swarm.goals, goals=starts, distance=1)
    with pytest.raises(ss.InvalidProblemError, match=r"goals.*2, .* are 3 m apart"):
        ss.simulate_swarm(back, links=ss.Links(radio_range=2), seed=0)


def test_obstacles_are_passed_at_half_the_distance_standing_or_moving() -> None:
    standing = ss.Obstacle(radius=0.5, path=[[2.0, 0.0, 0.0]])
    crossing = ss.Obstacle(
        radius=0.4, path=[[1.0, -3.0, 0.0], [1.0, 6.0, 0.0]], times=[0.0, 9.0]
    )
    swarm = ss.Swarm(
        starts=[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        goals=[[4.0, 0.0, 0.0], [4.0, 1.0, 0.0]], distance=0.4,
        obstacles=[standing, crossing],
    )  # fmt: skip
    flight = ss.simulate_swarm(swarm, links=ss.Links(most_delay=2), seed=0)
    assert flight.is_safe
    assert flight.arrived_share == 1.0
    for one in swarm.obstacles:
        assert obstacle_gap(flight, one) >= 0.2 - 1e-9
    free = ss.simulate_swarm(
        ss.Swarm(starts=swarm.starts, goals=swarm.goals, distance=0.4), seed=0
    )
    # They are in the way indeed.
    assert min(obstacle_gap(free, one) for one in swarm.obstacles) < 0.2


def test_the_same_seed_gives_the_same_bits() -> None:
    swarm, links = random_swarm(6, 1.8, 3), ss.Links(most_delay=3, loss=0.2)
    first, again, other = (
        ss.simulate_swarm(swarm, links=links, seed=seed).positions for seed in (5, 5, 6)
    )
    assert np.array_equal(first, again)
    assert first.shape != other.shape or not np.array_equal(first, other)


def test_who_is_at_the_goal_already_stays_and_others_come() -> None:
    swarm = ss.Swarm(
        starts=np.eye(2, 3), goals=np.array([[1.0, 0, 0], [1, 1, 0]]), distance=0.3
    )
    flight = ss.simulate_swarm(swarm, seed=0)
    assert flight.arrival_s[0] == 0.0
    assert (flight.positions[0, 0] == 1).all()
    assert flight.path_ratio == pytest.approx([1.0, 1.0])
    alone = ss.Swarm(starts=np.zeros((1, 3)), goals=np.ones((1, 3)), distance=0.3)
    assert ss.simulate_swarm(alone, seed=0).arrived_share == 1.0
    assert ss.simulate_swarm(alone, seed=0).min_distance_m == np.inf


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"starts": [[0, 0, 0], [0.1, 0, 0]]}, "starts of vehicles 0 and 1 .*0.3 m"),
        ({"goals": [[0, 1, 0], [0, 1.2, 0]]}, "goals of vehicles 0 and 1 .*0.2 m"),
        ({"goals": [[0, 1, 0]]}, r"goals must have shape \(2, 3\), got \(1, 3\)"),
        ({"starts": [[0, 0, 0], [np.nan, 0, 0]]}, r"starts must be finite.*\[1, 0\]"),
        ({"starts": np.zeros((0, 3)), "goals": np.zeros((0, 3))}, "name a vehicle"),
        ({"distance": 0.0}, "distance must be a finite number above 0"),
        ({"scale": [1, 1, 0]}, "scale must be above 0"),
        ({"acceleration": [1, -1, 1]}, "acceleration must be above 0"),
        (
            {"obstacles": [ss.Obstacle(radius=0.5, path=[[0, 1.5, 0]])]},
            "vehicle 0 must be 0.65 m from the centre of obstacle 0 .*got 0.5 m",
        ),
        ({"turn_rate": 1.0, "goals": [[0, 1, 1], [1, 1, 0]]}, "must stay in a plane"),
        ({"turn_rate": 0.0}, "turn_rate must be a number above 0"),
        ({"headings": [0.0]}, r"headings must have shape \(2\)"),
        (
            # It passes between the starts, later.
            {
                "obstacles": [
                    ss.Obstacle(
                        radius=0.5, path=[[0.5, -5, 0], [0.5, 5, 0]], times=[3.0, 5.0]
                    )
                ]
            },
            "starts of vehicle 0 must be 0.65 m from the centre of obstacle 0",
        ),
    ],
)
def test_a_swarm_without_room_is_refused_with_names_and_numbers(
    change: dict[str, Any], words: str
) -> None:
    given: dict[str, Any] = {
        "starts": [[0, 0, 0], [1, 0, 0]], "goals": [[0, 1, 0], [1, 1, 0]],
        "distance": 0.3,
    }  # fmt: skip
    with pytest.raises(ss.InvalidProblemError, match=words):
        ss.Swarm(**{**given, **change})


def test_invalid_links_paths_and_times_are_refused() -> None:
    swarm = random_swarm(2, 2.0, 0)
    with pytest.raises(ss.InvalidProblemError, match="vehicles 0 to 1, got \\[7\\]"):
        ss.simulate_swarm(swarm, links=ss.Links(silences={7: (0.0, 1.0)}), seed=0)
    with pytest.raises(ss.InvalidProblemError, match="loss must be"):
        ss.Links(loss=1.0)
    with pytest.raises(ss.InvalidProblemError, match="times must rise"):
        ss.Obstacle(radius=1.0, path=[[0, 0, 0], [1, 0, 0]], times=[1.0, 1.0])
    with pytest.raises(ss.InvalidProblemError, match="rule must be one of"):
        ss.simulate_swarm(swarm, rule="trust", seed=0)
    with pytest.raises(ss.InvalidProblemError, match="longest_s must be above the"):
        ss.simulate_swarm(swarm, longest_s=1.0, lead_s=2.0, seed=0)
    with pytest.raises(ss.InvalidProblemError, match="at most 10000 steps"):
        ss.simulate_swarm(swarm, step_s=1e-6, seed=0)
    with pytest.raises(ss.InvalidProblemError, match=r"silences of vehicle 0 must be"):
        ss.Links(silences={0: (2.0, 1.0)})
    with pytest.raises(ss.InvalidProblemError, match=r"silences of vehicle 0 must be"):
        ss.Links(silences={0: (2.0, 3.0, 4.0)})
    far = ss.Swarm(starts=np.eye(2, 3), goals=99 * np.eye(2, 3), distance=0.3)
    with pytest.raises(ss.InvalidProblemError, match="49 s in which vehicle 0 reaches"):
        ss.simulate_swarm(far, seed=0)


def headings(flight: ss.SwarmFlight, vehicle: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times and headings of a vehicle in motion, ten of each step."""
    h, path = flight.step_s, flight.positions[vehicle].T
    velocity, times, angles = np.zeros(3), list[float](), list[float]()
    for k, way in enumerate(np.diff(path, axis=0)):
        push = 2 * (way / h - velocity) / h
        for share in (np.arange(10) + 0.5) / 10:
            at = velocity + share * h * push
            if np.linalg.norm(at) > 1e-5:
                times.append((k + share) * h)
                angles.append(float(np.arctan2(at[1], at[0])))
        velocity = velocity + h * push
    return np.array(times), np.array(angles)


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 2**31), st.integers(1, 5), st.floats(0.3, 3.0))
def test_a_vehicle_that_moves_along_its_heading_turns_no_faster_than_it_can(
    seed: int, n: int, turn_rate: float
) -> None:
    rng = np.random.default_rng(seed)
    places = np.array([[x, y, 0.0] for x in range(3) for y in range(3)], dtype=float)
    shift = np.array([0.2, 0.1, 0.0])
    swarm = ss.Swarm(
        starts=rng.permutation(places)[:n], goals=rng.permutation(places + shift)[:n],
        distance=0.4, speed=[1.0, 1.0, 1.0], turn_rate=turn_rate,
        headings=rng.uniform(-np.pi, np.pi, n),
    )  # fmt: skip
    flight = ss.simulate_swarm(swarm, seconds=20.0, seed=seed)
    assert flight.is_safe
    assert (flight.positions[:, 2] == swarm.starts[0, 2]).all()
    for vehicle in range(n):
        times, angles = headings(flight, vehicle)
        times = np.append(-1e-9, times)
        angles = np.append(swarm.headings[vehicle], angles)
        turns = np.abs((np.diff(angles) + np.pi) % (2 * np.pi) - np.pi)
        # The samples of a turn on the spot are its last before and its first after.
        assert (turns <= turn_rate * np.diff(times) + 1e-3).all()


def test_an_obstacle_that_stops_between_two_steps_is_known_until_it_stands() -> None:
    # It comes to rest 0.04 s after a step, when longest_s is over.
    late = ss.Obstacle(
        radius=0.3, path=[[-3.0, 3, 0], [5.0, 0.46, 0]], times=[0.0, 6.04]
    )
    swarm = ss.Swarm(
        starts=[[0.0, 0, 0]], goals=[[5.0, -0.05, 0.0]], distance=0.4,
        obstacles=[late],
    )  # fmt: skip
    flight = ss.simulate_swarm(swarm, longest_s=6.0, seed=0)
    last = flight.log.plans.samples.shape[1] - 1
    assert last * flight.step_s >= 6.04
    assert obstacle_gap(flight, late) >= 0.2 - 1e-9


def test_a_plan_that_passes_its_end_on_the_way_is_not_at_rest_there() -> None:
    plans = no_plans(2, 6)
    plans.samples[0] = np.array([0.0, 1, 2, 1, 0, 0, 0])[:, None]
    plans.bulges[0] = 0.1
    # At its first sample it is at its end, and goes on.
    assert [branch(1, 0, (0, index), plans) for index in (0, 3, 4, 5)] == [
        False, False, True, True
    ]  # fmt: skip
    assert (plans.samples[1, :6] == plans.samples[0, :6]).all()
