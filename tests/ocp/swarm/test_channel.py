"""The channel: every message arrives when it should, once, or never."""

import itertools

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from swarmstart.machine_code import Count
from swarmstart.ocp.swarm.channel import (
    LOST,
    broadcast,
    deliver,
    drawn_delays,
    empty_channel,
)
from swarmstart.ocp.swarm.rule import members_at


@example(0, 0.9, 0, True)  # Much of what is passed on is too old.
@given(st.integers(0, 5), st.floats(0, 0.9), st.integers(0, 2**32 - 1), st.booleans())
def test_the_newest_of_what_has_arrived_is_heard(
    most_delay: int, loss: float, seed: int, passed_on: bool
) -> None:
    n, rng = 4, np.random.default_rng(seed)
    members = members_at(np.arange(n))
    channel = empty_channel(n, most_delay, passed_on=passed_on)
    expected, sent = np.full((n, n), -1), list[list[Count]]()
    told = list[Count]()
    arriving = list[tuple[int, int, int, int]]()
    for tick in range(40):
        deliver(tick, members, channel)
        for _, number, i, j in (one for one in arriving if one[0] == tick):
            expected[j, i] = max(expected[j, i], number)
            if passed_on:
                # The own messages are always newer.
                newer = told[number][i] > tick - len(channel.arrival)
                newer[j] = False
                expected[j, newer] = np.maximum(expected[j], told[number][i])[newer]
        assert (members.number == expected).all()
        for j, i in zip(*np.nonzero(expected >= 0), strict=True):
            committed, candidate, accepted = sent[expected[j, i]]
            assert members.heard_committed[j, i] == committed[i]
            assert members.heard_candidate[j, i] == candidate[i]
            assert members.heard_accepted[j, i] == accepted[i, j]
        for array in members[:3]:
            array[...] = rng.integers(0, 99, array.shape)
        sent.append([array.copy() for array in members[:3]])
        told.append(expected.copy())
        delays = drawn_delays(n, most_delay, loss, rng)
        broadcast(tick, delays, members, channel)
        arriving += [
            (tick + 1 + int(delays[i, j]), tick, i, j)
            for i, j in itertools.permutations(range(n), 2)
            if delays[i, j] != LOST
        ]


def test_the_share_of_lost_messages_is_as_asked() -> None:
    delays = drawn_delays(100, 4, 0.3, np.random.default_rng(0))
    # Four standard deviations of 10,000 draws.
    assert abs((delays == LOST).mean() - 0.3) < 4 * np.sqrt(0.3 * 0.7 / 1e4)
    assert set(np.unique(delays)) == {LOST, 0, 1, 2, 3, 4}
