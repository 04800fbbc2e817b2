"""Certificates of swarms' flights: what is true is proven again, forgeries are not."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import swarmstart as ss
from swarmstart.ocp.swarm.certificate import STATEMENTS as WRITTEN
from swarmstart.terminal_set.check import main
from swarmstart.terminal_set.checker.file_content import digest
from swarmstart.terminal_set.checker.findings import Verdict
from swarmstart.terminal_set.checker.swarm.certificate_file import (
    STATEMENTS,
    certificate_of,
)
from swarmstart.terminal_set.checker.swarm.separation import separated
from swarmstart.terminal_set.checker.swarm.statements import findings

Content = dict[str, Any]
PROVEN, INVALID, REFUSED, UNDECIDED = 0, 2, 3, 4
CROSS = 0.35


@cache
def genuine() -> str:
    """Return the certificate of three vehicles that cross among obstacles."""
    swarm = ss.Swarm(
        starts=np.array([[0.0, 0, 1], [2, 0, 1], [1, 1, 1]]),
        goals=np.array([[2.0, 0, 1], [0, 0, 1], [1, -1, 1]]),
        distance=CROSS,
        obstacles=[
            ss.Obstacle(radius=0.2, path=[[1.0, 0.0, 1.0]]),
            ss.Obstacle(radius=0.1, path=[[1.5, 3, 1], [1.5, -3, 1]], times=[0.0, 6.0]),
        ],
    )
    flight = ss.simulate_swarm(swarm, links=ss.Links(most_delay=2, loss=0.2), seed=0)
    assert flight.arrived_share == 1.0
    return flight.certificate()


def judged(content: Content, folder: Path) -> int:
    """Return the exit code for a content with a new digest."""
    content["sha256"] = digest(content)
    file = folder / "certificate.json"
    file.write_text(json.dumps(content))
    return main([str(file)])


def plan_of(content: Content, number: int = -1) -> Content:
    """Return the plan of a number among those that were committed to in flight."""
    plans = content["plans"][content["vehicles"] :]
    found: Content = [one for one in plans if one["committed"]][number]
    return found


def test_a_flight_is_proven_again_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert judged(json.loads(genuine()), tmp_path) == PROVEN
    said = capsys.readouterr().out
    assert [line.partition(": ")[2] for line in said.splitlines()[:-1]] == [*STATEMENTS]
    assert said.splitlines()[-1] == (
        "verdict: no two of 3 vehicles that follow their plans come nearer than 0.35 "
        "in scaled positions, for ever"
    )
    assert WRITTEN == STATEMENTS


def test_no_acceptance_is_needed_of_who_has_gone_for_good(tmp_path: Path) -> None:
    content = json.loads(genuine())
    plan_of(content)["accepted"] = [None] * 3
    assert judged(content, tmp_path) == PROVEN
    earlier = plan_of(content)["ended"] - 1
    further_proposal(content, earlier - 3, earlier)
    assert judged(content, tmp_path) == PROVEN


def moved(by: float, axis: int, place: slice) -> Callable[[Content], None]:
    """Return a forgery that moves samples of the last plan."""

    def forge(content: Content) -> None:
        samples = plan_of(content)["samples"]
        for sample in samples[place]:
            sample[axis] += by

    return forge


def entered(**entries: object) -> Callable[[Content], None]:
    """Return a forgery that changes entries of the last plan."""
    return lambda content: plan_of(content).update(entries)


def of_file(**entries: object) -> Callable[[Content], None]:
    """Return a forgery that changes entries of the file."""
    return lambda content: content.update(entries)


def other_of(content: Content) -> int:
    """Return a vehicle that is not that of the last plan."""
    return int((plan_of(content)["vehicle"] + 1) % 3)


def asked(content: Content) -> tuple[Content, int]:
    """Return the first plan, and a vehicle that proposes after its commitment."""
    first = plan_of(content, 0)
    later = [one for one in content["plans"] if one["proposed"] > first["ended"]]
    return first, int(later[0]["vehicle"])


def accepted(tick: int | None) -> Callable[[Content], None]:
    """Return a forgery of the tick of an acceptance."""

    def forge(content: Content) -> None:
        plan, other = asked(content)
        plan["accepted"][other] = tick

    return forge


def at_commitment(content: Content) -> None:
    plan, other = asked(content)
    plan["accepted"][other] = plan["ended"]


def at_proposal(content: Content) -> None:
    plan, other = asked(content)
    plan["accepted"][other] = plan["proposed"]


def without_acceptances(content: Content) -> None:
    plan_of(content, 0)["accepted"] = [None] * 3


def further_proposal(content: Content, proposed: int, ended: int | None) -> None:
    """Let a vehicle that has not accepted the last plan propose, far from all."""
    last = plan_of(content)
    last["accepted"] = [None] * 3
    far = copy.deepcopy(last)
    for sample in far["samples"]:
        sample[2] += 50.0
    far.update(
        vehicle=other_of(content), proposed=proposed, ended=ended, committed=False
    )
    content["plans"].append(far)


def proposed_after_the_last(content: Content) -> None:
    ended = plan_of(content)["ended"]
    further_proposal(content, ended + 3, ended + 5)


def withdrawn_with_the_commitment(content: Content) -> None:
    ended = plan_of(content)["ended"]
    further_proposal(content, ended - 3, ended)


def late(content: Content) -> None:
    plan = plan_of(content)
    plan["ended"] = plan["parting"] * content["ticks"]


def earlier_parting(content: Content) -> None:
    plan = plan_of(content)
    plan["parting"] = plan["ended"] // content["ticks"]


def later_parting(content: Content) -> None:
    plan_of(content)["parting"] += 8


def wide(content: Content) -> None:
    plan_of(content)["bulges"][-1] = 5.0


def wide_on_the_way(content: Content) -> None:
    bulges = plan_of(content)["bulges"]
    bulges[len(bulges) // 2] = 3.0


def stolen(content: Content) -> None:
    plan = plan_of(content)
    plan["vehicle"] = other_of(content)


def in_an_obstacle(content: Content) -> None:
    plan_of(content)["samples"][-1] = content["obstacles"][0]["samples"][-1]


def place_of(content: Content, vehicle: int, step: int) -> np.ndarray:
    """Return where a vehicle is at a step."""
    held = [
        one
        for one in content["plans"]
        if one["vehicle"] == vehicle and one["committed"]
        and one["ended"] < (step + 1) * content["ticks"]
    ]  # fmt: skip
    last = max(held, key=lambda one: int(one["ended"]))
    index = min(step - last["first"], len(last["samples"]) - 1)
    return np.array(last["samples"][index])


def never_withdrawn(content: Content) -> None:
    """A copy of a plan is proposed by another vehicle, and stays a candidate."""
    plan = plan_of(content)
    other = copy.deepcopy(plan)
    other.update(
        vehicle=other_of(content), proposed=plan["proposed"], ended=None,
        committed=False, accepted=[None] * 3,
    )  # fmt: skip
    content["plans"].append(other)


def stands_elsewhere(content: Content) -> None:
    """The start of one vehicle is put beside that of another."""
    content["plans"][0]["samples"] = [[1.9, 0.1, 1.0]]


def moved_obstacle(content: Content) -> None:
    place = plan_of(content)["samples"][-1]
    content["obstacles"][0]["samples"] = [place]


def larger_obstacle(content: Content) -> None:
    content["obstacles"][0]["clearance"] = 2.0


def late_obstacle(content: Content) -> None:
    content["obstacles"][1]["first"] = 3


def faster_obstacle(content: Content) -> None:
    one = content["obstacles"][1]
    one["samples"] = one["samples"][::2]
    one["bulges"] = one["bulges"][::2]
    plan = plan_of(content)
    one["samples"][-1] = plan["samples"][-1]


def twice(content: Content) -> None:
    """A second plan of the same vehicle is committed to at the same tick."""
    content["plans"].append(copy.deepcopy(plan_of(content)))


def through(content: Content) -> None:
    """A vehicle passes through another between two samples."""
    plan, other = plan_of(content), other_of(content)
    samples, index = plan["samples"], len(plan["samples"]) - 3
    step = plan["first"] + index
    there = place_of(content, other, step) + place_of(content, other, step + 1)
    samples[index + 1] = (there - np.array(samples[index])).tolist()


def at_anothers_end(content: Content) -> None:
    end = place_of(content, other_of(content), 100_000)
    plan_of(content)["samples"][-1] = end.tolist()


FALSE = {
    "another start of the plan": moved(1e-9, 0, slice(0, 1)),
    "another start of the plan, the last digit": moved(1e-15, 2, slice(0, 1)),
    "a place before the parting": moved(1e-6, 1, slice(1, 3)),
    "an end in another vehicle's place": at_anothers_end,
    "accepted by no message": accepted(None),
    "accepted at the commitment": at_commitment,
    "accepted at the proposal": at_proposal,
    "accepted before the proposal": accepted(0),
    "accepted much later": accepted(10**6),
    "committed to after the parting": late,
    "parting too early": earlier_parting,
    "parting too late": later_parting,
    "a wide rest": wide,
    "a wide piece": wide_on_the_way,
    "a plan of another vehicle": stolen,
    "a candidate in the way that is not withdrawn": never_withdrawn,
    "a start beside another": stands_elsewhere,
    "an obstacle at a goal": moved_obstacle,
    "a larger obstacle": larger_obstacle,
    "an obstacle that comes later": late_obstacle,
    "a faster obstacle": faster_obstacle,
    "two commitments at once": twice,
    "a larger distance": of_file(distance=1.2),
    "a step through another": through,
    "a plan that begins later": entered(first=10_000),
    "more ticks in a step": of_file(ticks=50),
    "a plan at its commitment without acceptances": without_acceptances,
    "a proposal after the last plan": proposed_after_the_last,
    "a candidate while others do not ask": withdrawn_with_the_commitment,
    "no flight, and a longer distance": of_file(steps=0, distance=3.0),
    "an end in an obstacle": in_an_obstacle,
}


@pytest.mark.parametrize("name", FALSE)
def test_a_false_statement_is_refused(name: str, tmp_path: Path) -> None:
    content = json.loads(genuine())
    FALSE[name](content)
    assert judged(content, tmp_path) == REFUSED


INVALID_FILES = {
    "another version": of_file(version=2),
    "no vehicles": of_file(vehicles=0),
    "one vehicle less": of_file(vehicles=2),
    "a distance of zero": of_file(distance=0.0),
    "a negative distance": of_file(distance=-1.0),
    "a true distance": of_file(distance=True),
    "another key": of_file(more=1),
    "no plans": of_file(plans=[]),
    "a negative bulge": lambda content: plan_of(content)["bulges"].__setitem__(0, -0.1),
    "a bulge too few": lambda content: plan_of(content)["bulges"].pop(),
    "two coordinates": lambda content: plan_of(content)["samples"][0].pop(),
    "too many obstacles": lambda content: content.update(
        obstacles=content["obstacles"] * 6_000
    ),
    "no samples": entered(samples=[], bulges=[]),
    "a text": entered(parting="soon"),
    "an unknown vehicle": entered(vehicle=7),
    "committed to before the proposal": entered(ended=0, proposed=5),
    "committed to and open": entered(ended=None),
    "committed is a number": entered(committed=1),
    "a start that was proposed": lambda content: content["plans"][0].update(proposed=0),
    "other words": lambda content: content["statements"][1].update(
        statement="no two vehicles come nearer than ten times the distance"
    ),
    "other grounds": lambda content: content["statements"][1].update(grounds="obvious"),
    "a statement less": lambda content: content["statements"].pop(),
    "a huge number": moved(1e12, 0, slice(None)),
}


@pytest.mark.parametrize("name", INVALID_FILES)
def test_an_invalid_file_is_named(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = json.loads(genuine())
    INVALID_FILES[name](content)
    assert judged(content, tmp_path) == INVALID
    assert "cannot be used: " in capsys.readouterr().err


def test_a_change_without_a_new_digest_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "certificate.json"
    file.write_text(genuine().replace('"distance": 0.35', '"distance": 0.34'))
    assert main([str(file)]) == REFUSED


def test_time_that_is_up_is_no_proof(tmp_path: Path) -> None:
    file = tmp_path / "certificate.json"
    file.write_text(genuine())
    assert main([str(file), "--seconds", "1e-9"]) == UNDECIDED


def test_rules_that_prove_nothing_give_no_certificate() -> None:
    swarm = ss.Swarm(starts=[[0.0, 0, 0]], goals=[[1.0, 0, 0]], distance=0.3)
    flight = ss.simulate_swarm(swarm, rule="waiting", seed=0)
    with pytest.raises(ss.InvalidProblemError, match="needs the rule acknowledged"):
        flight.certificate()


NUMBER = st.floats(-1e3, 1e3)
POINT = st.tuples(NUMBER, NUMBER, NUMBER).map(np.array)


@given(POINT, POINT)
def test_no_segment_is_separated_farther_than_its_nearest_point(
    start: np.ndarray, end: np.ndarray
) -> None:
    shares = np.linspace(0, 1, 1001)[:, None]
    sampled = np.linalg.norm(start + shares * (end - start), axis=1).min()
    assert not separated(start, end, np.array(sampled * (1 + 1e-9) + 1e-300))
    # And the bound is sharp, up to the samples' distance from the nearest point. (A
    # segment through the origin keeps no distance.)
    gap = np.linalg.norm(end - start) / 1000
    least = (sampled - gap) * (1 - 1e-9) - 1e-9
    assert least <= 0.0 or separated(start, end, np.array(least))


@given(POINT.filter(lambda point: np.abs(point).max() > 1e-100))
def test_a_distance_that_is_larger_by_the_last_digit_is_not_proven(
    point: np.ndarray,
) -> None:
    # The exact square of the distance decides, without any rounding.
    square = sum(Fraction(float(part)) ** 2 for part in point)
    least = float(np.linalg.norm(point))
    while Fraction(least) ** 2 <= square:
        least = float(np.nextafter(least, np.inf))
    assert not separated(point, point, np.array(least))
    assert separated(point, point, np.array(least * (1 - 1e-12)))


def test_a_segment_through_the_origin_is_not_separated() -> None:
    start = np.array([[1.0, 0, 0], [0, 0, 0], [1, 1, 0]])
    end = np.array([[-1.0, 0, 0], [0, 0, 0], [0, 0, 0]])
    assert not separated(start, end, np.full(3, 1e-300)).any()
    assert not separated(np.full(3, np.nan), np.ones(3), np.array(0.1))


@settings(deadline=None, max_examples=15)
@given(
    st.integers(0, 2**31), st.integers(1, 6), st.integers(0, 5), st.floats(0, 0.5),
    st.integers(1, 4), st.booleans(),
)  # fmt: skip
def test_every_flight_that_keeps_the_rule_is_proven(
    seed: int, n: int, most_delay: int, loss: float, period: int, silent: bool
) -> None:
    rng = np.random.default_rng(seed)
    corners = np.stack(np.meshgrid(*[np.arange(2.0)] * 3), -1).reshape(-1, 3)
    grid = rng.permutation(corners)
    aim = rng.permutation(grid)
    crossing = [[0.5, -2.0, 0.5], [0.5, 3.0, 0.5]]
    swarm = ss.Swarm(
        starts=grid[:n], goals=aim[:n] + 0.1, distance=0.4, scale=(1.0, 1.0, 0.8),
        obstacles=[ss.Obstacle(radius=0.1, path=crossing, times=[0.0, 4.0])],
    )  # fmt: skip
    links = ss.Links(
        period=period, most_delay=most_delay, loss=loss,
        silences={0: (0.5, 3.0)} if silent else {},
    )  # fmt: skip
    flight = ss.simulate_swarm(swarm, links=links, seconds=8.0, seed=seed)
    certificate = certificate_of(json.loads(flight.certificate()))
    found = [one.verdict for one in findings(certificate, seconds=600)]
    assert found == [Verdict.PROVED] * len(STATEMENTS)
