"""The rule of committed plans, on vehicles that stand at places.

A plan is a place; two plans are clear of each other if their places differ. Whatever
was ever sent may be heard at any later time, any number of times: so each order, delay,
loss and repetition of messages is covered.
"""

import itertools
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.ocp.swarm.plans import GONE, Plans
from swarmstart.ocp.swarm.rule import (
    COMMITTED,
    NONE,
    WAITING,
    WITHDRAWN,
    Flags,
    Members,
    answer,
    hear,
    is_clear,
    settle,
)

PLACES = 16
RADIUS = 0.5


def at_places(candidates: int) -> Plans:
    """Return plans that stand: row PLACES * k + p stands at place p, for every k."""
    places = np.tile(np.arange(PLACES, dtype=float), candidates)
    samples = np.zeros((places.size, 2, 3))
    samples[:, :, 0] = places[:, None]
    return Plans(
        first=np.zeros(places.size, np.int64),
        samples=samples,
        bulges=np.zeros((places.size, 2)),
    )


ROWS = 128
PLANS = at_places(ROWS)
LAST = PLACES * ROWS // 2
"""Number to be added to a plan that makes it a vehicle's last."""
IS_LAST = np.arange(PLACES * ROWS) >= LAST


def starting(committed: list[int]) -> Members:
    """Return vehicles that stand at places and have heard each other."""
    n = len(committed)
    return Members(
        committed=np.array(committed, np.int64),
        candidate=np.full(n, NONE, np.int64),
        accepted=np.full((n, n), NONE, np.int64),
        number=np.zeros((n, n), np.int64),
        heard_committed=np.tile(np.array(committed, np.int64), (n, 1)),
        heard_candidate=np.full((n, n), NONE, np.int64),
        heard_accepted=np.full((n, n), NONE, np.int64),
    )


def settled(members: Members, *, is_parting: bool = False) -> int:
    """Let the first vehicle commit or withdraw, and return which."""
    return settle(0, (0, is_parting), RADIUS, members, PLANS, IS_LAST)


def meeting(members: Members) -> bool:
    """Return whether two committed plans share a place."""
    places = [plan % PLACES for plan in members.committed.tolist() if plan != GONE]
    return len(set(places)) < len(places)


@dataclass(frozen=True)
class World:
    """Vehicles, all messages that were ever sent, and what may still be proposed.

    Attributes:
        members: The vehicles.
        sent: Of each vehicle its messages, in order: committed, candidate, and which
            candidates it accepts.
        wishes: Of each vehicle the rows that it may still propose, in order.
        restarts: How many times a vehicle may still forget.
    """

    members: Members
    sent: tuple[tuple[tuple[int, ...], ...], ...]
    wishes: tuple[tuple[int, ...], ...]
    restarts: int = 0

    def key(self) -> tuple[object, ...]:
        """Return what decides all that may follow."""
        return (
            *(array.tobytes() for array in self.members),
            self.sent,
            self.wishes,
            self.restarts,
        )

    def copied(self) -> Members:
        """Return members that may be written."""
        return Members(*(array.copy() for array in self.members))

    def with_broadcast(self, i: int, members: Members) -> "World":
        """Return the world after vehicle i has sent what is new in what it has."""
        message = (
            int(members.committed[i]),
            int(members.candidate[i]),
            *members.accepted[i].tolist(),
        )
        its = self.sent[i]
        if its and its[-1] == message:
            return replace(self, members=members)
        sent = (*self.sent[:i], (*its, message), *self.sent[i + 1 :])
        return replace(self, members=members, sent=sent)

    def hearing(self, j: int, i: int, number: int, rank: list[int]) -> "World":
        """Return the world after j has heard a message of i and done what it may."""
        members = self.copied()
        committed, candidate, *accepted = self.sent[i][number]
        heard = np.array([committed, candidate, accepted[j]])
        hear(j, i, number + 1, heard, members)
        answer(j, 0, RADIUS, np.array(rank), members, PLANS)
        settle(j, (0, False), RADIUS, members, PLANS, IS_LAST)
        return self.with_broadcast(j, members)

    def proposing(self, i: int, *, careful: bool) -> "World | None":
        """Return the world after i has proposed what it wishes next, if it may."""
        members = self.copied()
        plan, *rest = self.wishes[i]
        committed = members.committed[i]
        if members.candidate[i] != NONE or IS_LAST[committed]:
            return None
        if careful and not is_clear(i, plan, 0, RADIUS, members, PLANS):
            return None
        members.candidate[i] = plan
        wishes = (*self.wishes[:i], tuple(rest), *self.wishes[i + 1 :])
        return replace(self, wishes=wishes).with_broadcast(i, members)

    def withdrawing(self, i: int) -> "World":
        """Return the world after vehicle i has given up its candidate."""
        members = self.copied()
        done = settle(i, (0, True), RADIUS, members, PLANS, IS_LAST)
        assert done in (COMMITTED, WITHDRAWN)
        return self.with_broadcast(i, members)

    def restarting(self, i: int) -> "World":
        """Return the world after vehicle i has forgotten all but its committed plan."""
        members = self.copied()
        members.candidate[i] = NONE
        for array in members[2:]:
            array[i] = -1
        return replace(self.with_broadcast(i, members), restarts=self.restarts - 1)


def followers(world: World, rank: list[int], *, careful: bool) -> Iterator[World]:
    """Yield each world that one event may make of a world."""
    n = world.members.committed.size
    for i in range(n):
        if world.wishes[i]:
            proposed = world.proposing(i, careful=careful)
            if proposed is not None:
                yield proposed
        if world.members.candidate[i] != NONE:
            yield world.withdrawing(i)
        if world.restarts:
            yield world.restarting(i)
    for j, i in itertools.permutations(range(n), 2):
        newest = int(world.members.number[j, i])
        for number in range(max(newest, 0), len(world.sent[i])):
            yield world.hearing(j, i, number, rank)


def explored(
    world: World, rank: list[int], *, careful: bool = True, events: int = 1000
) -> set[tuple[int, ...]]:
    """Return all that may be committed to, after every order of so many events.

    Raises:
        AssertionError: If two committed plans are not clear of each other in one.
    """
    known, open_worlds, outcomes = {world.key()}, [world], set()
    for _ in range(events):
        following = list[World]()
        for one in itertools.chain.from_iterable(
            followers(each, rank, careful=careful) for each in open_worlds
        ):
            if one.key() not in known:
                known.add(one.key())
                following.append(one)
                assert not meeting(one.members), one
                outcomes.add(tuple(one.members.committed.tolist()))
        open_worlds = following
    assert not open_worlds or events < 1000
    return outcomes


def world_of(committed: list[int], wishes: list[list[int]], restarts: int = 0) -> World:
    """Return vehicles at places that wish other places, each with a number of its own.

    Args:
        committed: Places of the vehicles.
        wishes: Places that each may propose, in order.
        restarts: Number of restarts.
    """
    numbers = itertools.count(1)
    rows = tuple(
        tuple(place + PLACES * next(numbers) for place in own) for own in wishes
    )
    return World(starting(committed), ((),) * len(committed), rows, restarts)


@pytest.mark.parametrize("careful", [True, False])
def test_two_that_want_the_same_place_never_both_get_it(careful: bool) -> None:
    world = world_of([0, 1], [[2], [2]], restarts=1)
    found = explored(world, [0, 1], careful=careful)
    places = {tuple(plan % PLACES for plan in one) for one in found}
    assert places == {(0, 1), (2, 1), (0, 2)}


@pytest.mark.parametrize("careful", [True, False])
def test_no_vehicle_moves_into_a_place_before_it_is_left(careful: bool) -> None:
    # The first goes to 2 and comes back; the second wants its place, and then another.
    world = world_of([0, 1], [[2, 0], [0, 3]])
    found = explored(world, [0, 1], careful=careful)
    places = {tuple(plan % PLACES for plan in one) for one in found}
    assert (2, 0) in places
    assert {(0, 1), (2, 1), (2, 3), (0, 3)} <= places


def test_three_vehicles_never_meet_in_any_order_of_events() -> None:
    world = world_of([0, 1, 2], [[3], [3], []])
    found = explored(world, [0, 1, 2])
    places = {tuple(plan % PLACES for plan in one) for one in found}
    assert places == {(0, 1, 2), (3, 1, 2), (0, 3, 2)}


@pytest.mark.parametrize("careful", [True, False])
def test_a_last_plan_needs_no_acceptance_and_is_met_by_none(careful: bool) -> None:
    # The second wants the place of the first, before and after that goes for good; the
    # first would come back, if it might.
    world = world_of([0, 1], [[2 + LAST, 0], [2, 0]])
    found = explored(world, [1, 0], careful=careful)
    places = {tuple(plan % PLACES for plan in one) for one in found}
    assert places == {(0, 1), (2, 1), (0, 2), (2, 0)}
    # And both may go for good at once, to places of which each wants the other's.
    explored(world_of([0, 1], [[2 + LAST, 1 + LAST], [2 + LAST, 0]]), [1, 0])


def test_three_vehicles_never_meet_if_one_goes_for_good() -> None:
    world = world_of([0, 1, 2], [[3 + LAST], [3], []])
    explored(world, [0, 1, 2])
    # The third moves into the place that the first leaves, without asking it.
    world = world_of([0, 1, 2], [[3 + LAST], [], [0]])
    found = explored(world, [0, 1, 2], events=9)
    places = {tuple(plan % PLACES for plan in one) for one in found}
    assert (3, 1, 0) in places


def test_who_has_gone_for_good_and_falls_silent_stops_nobody() -> None:
    members = starting([0, 1])
    members.candidate[0] = 2 + PLACES
    hear(0, 1, 1, np.array([1 + LAST, NONE, NONE]), members)
    assert settled(members) == COMMITTED
    # A plan in its way is not committed to, nor one of which nothing was heard.
    for committed, candidate in ((2 + LAST, 2 + PLACES), (NONE, 2 + PLACES)):
        members = starting([0, 1])
        members.candidate[0] = candidate
        hear(0, 1, 1, np.array([committed, NONE, NONE]), members)
        assert settled(members) == WAITING


def test_three_vehicles_never_meet_whatever_they_forget() -> None:
    # The third wants the place of the first, which the first may leave.
    world = world_of([0, 1, 2], [[3], [3], [0]], restarts=1)
    found = explored(world, [2, 1, 0], careful=False, events=7)
    assert found


def test_commitments_without_acceptances_meet(monkeypatch: pytest.MonkeyPatch) -> None:
    def trusting(
        i: int, now: tuple[int, bool], radius: float, members: Members, plans: Plans,
        is_last: Flags,
    ) -> int:  # fmt: skip
        """Commit to a candidate that is clear of what was heard."""
        del now, radius, plans, is_last
        if members.candidate[i] == NONE:
            return WITHDRAWN
        if is_clear(i, members.candidate[i], 0, RADIUS, members, PLANS):
            members.committed[i] = members.candidate[i]
        members.candidate[i] = NONE
        return COMMITTED

    monkeypatch.setattr(sys.modules[__name__], "settle", trusting)
    with pytest.raises(AssertionError):
        explored(world_of([0, 1], [[2], [2]]), [0, 1])


EVENTS = st.tuples(
    st.sampled_from(["propose", "hear", "hear", "hear", "withdraw", "restart"]),
    st.integers(0, 3),
    st.integers(0, 2),
    st.integers(0, 9),
)


@settings(deadline=None)
@given(st.lists(EVENTS, max_size=120), st.permutations([0, 1, 2, 3]))
def test_four_vehicles_never_meet_whatever_happens(
    events: list[tuple[str, int, int, int]], rank: list[int]
) -> None:
    world = world_of([0, 1, 2, 3], [[], [], [], []], restarts=1000)
    numbers = itertools.count(1)
    for what, i, other, number in events:
        j = (i + 1 + other) % 4
        if what == "propose":
            # Four places for four vehicles and two more.
            wish = number % 6 + PLACES * (next(numbers) % (ROWS // 2 - 1) + 1)
            wish += LAST * (number > 7)  # Two of ten proposals are their last.
            wishes = (*world.wishes[:i], (wish,), *world.wishes[i + 1 :])
            world = (
                replace(world, wishes=wishes).proposing(i, careful=bool(other)) or world
            )
        elif what == "withdraw" and world.members.candidate[i] != NONE:
            world = world.withdrawing(i)
        elif what == "restart" and not number:
            world = world.restarting(i)
        elif what == "hear" and world.sent[i]:
            # The newest, or one of the last.
            newest = len(world.sent[i]) - 1
            world = world.hearing(j, i, max(newest - number // 3, 0), rank)
        assert not meeting(world.members)


def test_a_vehicle_uses_what_it_has_itself_and_nothing_of_others() -> None:
    world = world_of([0, 1, 2], [[3], [4], [5]])
    for i in range(3):
        world = world.proposing(i, careful=True) or world
    poisoned, plain = world.copied(), world.copied()
    for array in poisoned:
        array[[0, 2]] = 77
    for members in (poisoned, plain):
        hear(1, 0, 1, np.array([0, world.members.candidate[0], NONE]), members)
        answer(1, 0, RADIUS, np.arange(3), members, PLANS)
        settle(1, (0, False), RADIUS, members, PLANS, IS_LAST)
        assert not is_clear(1, PLACES, 0, RADIUS, members, PLANS)
    assert all(
        a[1].tolist() == b[1].tolist() for a, b in zip(poisoned, plain, strict=True)
    )
    assert plain.accepted[1, 0] == world.members.candidate[0]


def test_who_has_left_need_not_accept_and_is_in_no_way() -> None:
    members = starting([0, 1])
    members.candidate[0] = 1 + PLACES
    assert settled(members) == WAITING
    hear(0, 1, 1, np.array([GONE, NONE, NONE]), members)
    assert is_clear(0, 1 + PLACES, 0, RADIUS, members, PLANS)
    assert settled(members) == COMMITTED
    assert members.committed[0] == 1 + PLACES


def test_nothing_is_proposed_before_all_others_were_heard() -> None:
    members = starting([0, 1, 2])
    assert is_clear(0, 5, 0, RADIUS, members, PLANS)
    members.number[0, 2] = -1
    assert not is_clear(0, 5, 0, RADIUS, members, PLANS)


def test_an_older_message_changes_nothing() -> None:
    members = starting([0, 1])
    hear(0, 1, 5, np.array([2, 7, NONE]), members)
    before = [array.copy() for array in members]
    for number in (5, 4, 0):
        hear(0, 1, number, np.array([3, 8, 9]), members)
    assert all(np.array_equal(a, b) for a, b in zip(before, members, strict=True))


def test_the_lower_rank_keeps_its_candidate() -> None:
    for rank, withdraws in (([0, 1], True), ([1, 0], False), ([0, 0], False)):
        members = starting([0, 1])
        members.candidate[1] = 2 + PLACES
        hear(1, 0, 1, np.array([0, 2 + 2 * PLACES, NONE]), members)
        assert answer(1, 0, RADIUS, np.array(rank), members, PLANS) == withdraws
        assert (members.candidate[1] == NONE) == withdraws
        assert (members.accepted[1, 0] != NONE) == withdraws


def test_what_is_committed_is_no_candidate_any_more() -> None:
    members = starting([0, 1])
    members.candidate[0] = members.heard_accepted[0, 1] = 2 + PLACES
    assert settled(members, is_parting=True) == COMMITTED
    assert members.candidate[0] == NONE
    assert settled(members, is_parting=True) == WITHDRAWN


def test_what_another_proposes_or_keeps_is_not_proposed() -> None:
    members = starting([0, 1])
    hear(0, 1, 1, np.array([1, 2 + PLACES, NONE]), members)
    free = [is_clear(0, p, 0, RADIUS, members, PLANS) for p in (0, 1, 2, 3)]
    assert free == [True, False, False, True]
