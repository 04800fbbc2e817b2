"""Broadcasts that arrive late, out of order, or never.

A vehicle broadcasts at every tick. A message takes 1 + d ticks to a receiver, d drawn
anew for each receiver from 0 to the largest delay, or is lost on the way.
"""

from typing import NamedTuple

import numpy as np

from swarmstart.machine_code import Count, kernel
from swarmstart.ocp.swarm.rule import Members, hear

LOST = -1
"""Tick of arrival of a message that is lost."""


class Channel(NamedTuple):
    """Messages on their way: those of the last ticks, in rings.

    Attributes:
        committed: [t, i]: plan that i is committed to in its message of tick t.
        candidate: [t, i]: its candidate in it.
        accepted: [t, i, j]: candidate of j that it accepts in it.
        arrival: [t, i, j]: tick at which the message reaches j, or LOST.
    """

    committed: Count
    candidate: Count
    accepted: Count
    arrival: Count


def empty_channel(n: int, most_delay: int) -> Channel:
    """Return a channel of n vehicles without messages, of a largest delay in ticks."""
    ring = most_delay + 2
    return Channel(
        committed=np.full((ring, n), -1, np.int64),
        candidate=np.full((ring, n), -1, np.int64),
        accepted=np.full((ring, n, n), -1, np.int64),
        arrival=np.full((ring, n, n), LOST, np.int64),
    )


@kernel
def broadcast(tick: int, delays: Count, members: Members, channel: Channel) -> None:
    """Send what each vehicle has.

    Args:
        tick: Number of the present tick.
        delays: [i, j]: delay of i's message to j in ticks, or LOST, shape (n, n).
        members: The vehicles.
        channel: Gets the messages.
    """
    slot = tick % len(channel.arrival)
    n = members.committed.size
    for i in range(n):
        channel.committed[slot, i] = members.committed[i]
        channel.candidate[slot, i] = members.candidate[i]
        for j in range(n):
            channel.accepted[slot, i, j] = members.accepted[i, j]
            delay = delays[i, j]
            channel.arrival[slot, i, j] = LOST if delay < 0 else tick + 1 + delay


@kernel
def deliver(tick: int, members: Members, channel: Channel) -> None:
    """Let all vehicles hear what reaches them at a tick."""
    ring, n = channel.committed.shape
    message = np.empty(3, np.int64)
    for sent in range(max(0, tick - ring + 1), tick):
        slot = sent % ring
        for i in range(n):
            message[0] = channel.committed[slot, i]
            message[1] = channel.candidate[slot, i]
            for j in range(n):
                if i != j and channel.arrival[slot, i, j] == tick:
                    message[2] = channel.accepted[slot, i, j]
                    hear(j, i, sent, message, members)


def drawn_delays(
    n: int, most_delay: int, loss: float, rng: np.random.Generator
) -> Count:
    """Return delays in ticks from each vehicle to each, LOST with a probability."""
    delays = rng.integers(0, most_delay + 1, size=(n, n))
    delays[rng.random((n, n)) < loss] = LOST
    return delays
