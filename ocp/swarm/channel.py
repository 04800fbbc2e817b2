"""Broadcasts that arrive late, out of order, or never.

A vehicle broadcasts at every tick. A message takes 1 + d ticks to a receiver, d drawn
anew for each receiver from 0 to the largest delay, or is lost on the way. If links have
a range, vehicles also pass on what they have heard of others; so a message reaches
distant vehicles through those between, and the rule only sees a longer delay.
"""

from typing import NamedTuple

import numpy as np

from swarmstart.machine_code import Count, kernel
from swarmstart.ocp.swarm.rule import Members, hear

LOST = -1
"""Tick of arrival of a message that is lost."""
LONGEST_WAY = 16
"""Links that a message passes at most in its lifetime, each with the largest delay."""


class Channel(NamedTuple):
    """Messages on their way: those of the last ticks, in ring buffers.

    Attributes:
        committed: [t, i]: plan that i is committed to in its message of tick t.
        candidate: [t, i]: candidate of i in the same message.
        accepted: [t, i, j]: candidate of j that i accepts in the same message.
        arrival: [t, i, j]: tick at which the message reaches j, or LOST.
        known: [t, i, k]: number of k's newest message that i passes on in the same
            message; of size 0 if nothing is passed on.
    """

    committed: Count
    candidate: Count
    accepted: Count
    arrival: Count
    known: Count


def empty_channel(n: int, most_delay: int, *, passed_on: bool = False) -> Channel:
    """Return a channel without messages.

    Args:
        n: Number of vehicles.
        most_delay: Largest delay [ticks].
        passed_on: Whether vehicles pass on what they hear of others.
    """
    ring = (most_delay + 2) * (min(n, LONGEST_WAY) if passed_on else 1)
    return Channel(
        committed=np.full((ring, n), -1, np.int64),
        candidate=np.full((ring, n), -1, np.int64),
        accepted=np.full((ring, n, n), -1, np.int64),
        arrival=np.full((ring, n, n), LOST, np.int64),
        known=np.full((ring, n, n) if passed_on else (0, 0, 0), -1, np.int64),
    )


@kernel
def broadcast(tick: int, delays: Count, members: Members, channel: Channel) -> None:
    """Send each vehicle's plans and the candidates that it accepts.

    Args:
        tick: Number of the present tick.
        delays: [i, j]: delay of i's message to j in ticks, or LOST, shape (n, n).
        members: Memories of the vehicles.
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
            if channel.known.size:
                channel.known[slot, i, j] = members.number[i, j]


@kernel
def deliver(tick: int, members: Members, channel: Channel) -> None:
    """Let all vehicles hear what reaches them at a tick."""
    ring, n = channel.committed.shape
    message = np.empty(3, np.int64)
    oldest = max(0, tick - ring + 1)
    for sent in range(oldest, tick):
        slot = sent % ring
        for i in range(n):
            for j in range(n):
                if i == j or channel.arrival[slot, i, j] != tick:
                    continue
                receive(j, i, sent, message, members, channel)
                if channel.known.size:
                    for k in range(n):
                        number = channel.known[slot, i, k]
                        is_new = number >= oldest and number > members.number[j, k]
                        if is_new and k != j:
                            receive(j, k, number, message, members, channel)


@kernel
def receive(
    j: int, i: int, sent: int, message: Count, members: Members, channel: Channel
) -> None:
    """Let vehicle j hear i's message of a tick that is still in the ring buffers.

    `message` is a buffer for its contents, shape (3,).
    """
    slot = sent % len(channel.arrival)
    message[0] = channel.committed[slot, i]
    message[1] = channel.candidate[slot, i]
    message[2] = channel.accepted[slot, i, j]
    hear(j, i, sent, message, members)


def drawn_delays(
    n: int, most_delay: int, loss: float, rng: np.random.Generator
) -> Count:
    """Return delays between all vehicles [ticks]; LOST with the probability `loss`."""
    delays = rng.integers(0, most_delay + 1, size=(n, n))
    delays[rng.random((n, n)) < loss] = LOST
    return delays
