"""Agreement of vehicles on plans: what they propose, hear, accept and commit to.

Rules, which say when a vehicle commits to a candidate:

    acknowledged  when all others that may still propose have accepted it (`rule.py`):
                  safe with any delays
    waiting       when the candidate parts from the old plan, if nothing in its way was
                  heard until then: safe if each message arrives before that
    hearsay       at once, if the candidate is clear of what was heard last: not safe

Other modules find the plans, and follow them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.machine_code import Count, kernel
from swarmstart.ocp.swarm.certificate import OPEN, START, Log
from swarmstart.ocp.swarm.channel import (
    LOST,
    broadcast,
    deliver,
    drawn_delays,
    empty_channel,
)
from swarmstart.ocp.swarm.flight import ACKNOWLEDGED, HEARSAY, RULES
from swarmstart.ocp.swarm.plans import Plans, chosen, grown
from swarmstart.ocp.swarm.rule import (
    COMMITTED,
    NONE,
    WAITING,
    WITHDRAWN,
    Flags,
    Members,
    answer,
    is_clear,
    members_at,
    settle,
)
from swarmstart.ocp.swarm.swarm import Links, pairwise_distances

NOTHING = -1
"""Result of a vehicle without a candidate."""
PATIENCE = 8
"""Most ticks until a vehicle proposes again after a withdrawal."""
TURN = 10
"""Steps after which the order of right of way changes."""
GROWTH = 8
"""Rows of plans for each vehicle that are added when there is no room."""


class Terms(NamedTuple):
    """Terms of plans, which vehicles know in addition to their paths.

    Attributes:
        parting: Step at which each plan parts from its vehicle's plan before, shape
            (rows,).
        is_last: Whether a plan is its vehicle's last: the vehicle proposes no other
            plan once it has committed to this one, shape (rows,).
    """

    parting: Count
    is_last: Flags


def _no_terms(rows: int) -> Terms:
    """Return the terms of plans that are not proposed yet."""
    return Terms(np.zeros(rows, np.int64), np.zeros(rows, np.bool_))


@kernel
def decide(
    now: tuple[int, int, float], rank: Count, terms: Terms, members: Members,
    plans: Plans, results: Count,
) -> None:  # fmt: skip
    """Let all vehicles accept, commit to and withdraw candidates.

    Args:
        now: Number of the rule (`RULES`), present step, and least distance that two
            plans must keep [m], scaled.
        rank: Rank of each vehicle: of two candidates that may meet, that of the vehicle
            with the higher rank gives way, shape (n,).
        terms: The step at which each plan parts from the plan before, and whether it is
            its vehicle's last.
        members: Memories of the vehicles.
        plans: All plans of the vehicles, each a row.
        results: Gets WAITING, COMMITTED, WITHDRAWN or NOTHING, shape (n,).
    """
    rule, step, distance = now
    for i in range(results.size):
        results[i] = NOTHING
        if rule == ACKNOWLEDGED and answer(i, step, distance, rank, members, plans):
            results[i] = WITHDRAWN
        candidate = members.candidate[i]
        if candidate == NONE:
            continue
        is_parting = step >= terms.parting[candidate] - 1
        if rule == ACKNOWLEDGED:
            results[i] = settle(
                i, (step, is_parting), distance, members, plans, terms.is_last
            )
        elif not is_clear(i, candidate, step, distance, members, plans):
            members.candidate[i] = NONE
            results[i] = WITHDRAWN
        elif is_parting or rule == HEARSAY:
            members.committed[i] = candidate
            members.candidate[i] = NONE
            results[i] = COMMITTED
        else:
            results[i] = WAITING


@dataclass(slots=True)
class _Proposal:
    """A plan's vehicle, its ticks, and the ticks of its acceptances; see `Log`."""

    vehicle: int
    proposed: int
    ended: int
    committed: bool
    accepted: dict[int, int]


class Settled(NamedTuple):
    """Vehicles that have committed to their candidates or withdrawn them, at a tick.

    Attributes:
        committed: Whether each has committed, shape (n,).
        withdrawn: Whether each has withdrawn, shape (n,).
    """

    committed: Flags
    withdrawn: Flags


class Agreement:
    """Vehicles, what they know of each other, and all plans that were ever proposed.

    Attributes:
        plans: All plans: those of the start, those that are known to all, such as
            obstacles, and those that were proposed, in this order.
        terms: The step at which each plan parts from the plan before, and whether it is
            its vehicle's last.
        members: Memories of the vehicles.
        not_before: Tick before which a vehicle proposes nothing, shape (n,).
    """

    def __init__(
        self,
        plans: Plans,
        is_last: Flags,
        *,
        distance: float,
        links: Links,
        rule: str,
        step_s: float,
    ) -> None:
        """Let all vehicles be committed to their first plans.

        Args:
            plans: Plans of the start, and then plans that are known to all.
            is_last: Whether the plans of the start are their vehicles' last, shape
                (n,).
            distance: Least distance that two plans must keep [m], scaled.
            links: Links between the vehicles.
            rule: Name of the rule.
            step_s: Step of the grid of the plans [s].
        """
        n = is_last.size
        self._links, self._rule = links, rule
        self._distance, self._step_s = distance, step_s
        self._used = len(plans.first)
        self.plans = grown(plans, GROWTH * n)
        self.terms = _no_terms(len(self.plans.first))
        self.terms.is_last[:n] = is_last
        self.members = members_at(np.arange(n))
        self.not_before = np.zeros(n, np.int64)
        self._channel = empty_channel(
            n, links.most_delay, passed_on=links.radio_range < np.inf
        )
        self._log = {row: _Proposal(row, START, START, True, {}) for row in range(n)}

    def exchange(self, tick: int, rng: np.random.Generator) -> Settled:
        """Let all vehicles exchange messages; return who has committed or withdrawn.

        Each vehicle receives messages, accepts candidates of others, and may commit to
        its own candidate or withdraw it.

        Args:
            tick: Number of the present tick.
            rng: Random number generator for the pauses after a withdrawal.
        """
        members, step = self.members, tick // self._links.period
        n = members.committed.size
        deliver(tick, members, self._channel)
        # Any order is safe; one that changes lets no vehicle wait for ever.
        rank = (np.arange(n) + step // TURN) % n
        results = np.empty(n, np.int64)
        candidates, accepted = members.candidate.copy(), members.accepted.copy()
        decide(
            (RULES[self._rule], step, self._distance), rank, self.terms, members,
            self.plans, results,
        )  # fmt: skip
        settled = Settled(results == COMMITTED, results == WITHDRAWN)
        for i in np.flatnonzero(settled.committed | settled.withdrawn).tolist():
            proposal = self._log[int(candidates[i])]
            proposal.ended, proposal.committed = tick, bool(settled.committed[i])
        for j, i in np.argwhere(members.accepted != accepted).tolist():
            self._log[int(members.accepted[j, i])].accepted[j] = tick
        pauses = rng.integers(0, PATIENCE, size=n)
        self.not_before[settled.withdrawn] = tick + pauses[settled.withdrawn]
        return settled

    def may_propose(self, tick: int) -> Count:
        """Return the numbers of the vehicles that may propose a plan at a tick."""
        members = self.members
        heard = members.number >= 0
        np.fill_diagonal(heard, True)
        return np.flatnonzero(
            (members.candidate == NONE)
            & (self.not_before <= tick)
            & ~self.terms.is_last[members.committed]
            & heard.all(axis=1)
        )

    def free_row(self) -> int:
        """Return a row of `plans` that a candidate may be written into."""
        if self._used == len(self.plans.first):
            more = GROWTH * self.members.committed.size
            self.plans = grown(self.plans, more)
            both = zip(self.terms, _no_terms(more), strict=True)
            self.terms = Terms(*(np.concatenate(pair) for pair in both))
        return self._used

    def propose(self, i: int, tick: int, *, parting: int, is_last: bool) -> None:
        """Let a vehicle propose the plan in the free row.

        Args:
            i: Number of the vehicle.
            tick: Number of the present tick.
            parting: Step at which the plan parts from the vehicle's committed plan.
            is_last: Whether the vehicle proposes no further plan once it has committed
                to this one.
        """
        row = self._used
        self.members.candidate[i] = row
        self._log[row] = _Proposal(i, tick, OPEN, False, {})
        self.terms.parting[row] = parting
        self.terms.is_last[row] = is_last
        self._used += 1

    def heard_of(self, i: int) -> Count:
        """Return the rows of those plans of others that a vehicle has heard of."""
        heard = self.members.heard_committed[i], self.members.heard_candidate[i]
        known = np.concatenate(heard)
        return np.unique(known[known >= 0])

    def send(self, tick: int, places: Array, rng: np.random.Generator) -> None:
        """Let all vehicles broadcast their plans and acceptances.

        Args:
            tick: Number of the present tick.
            places: Positions of the vehicles, not scaled, shape (n, 3) [m].
            rng: Random number generator for delays and losses.
        """
        links = self._links
        delays = drawn_delays(len(places), links.most_delay, links.loss, rng)
        now = tick * self._step_s / links.period
        for i, (begins, ends) in links.silences.items():
            if begins <= now < ends:
                delays[i, :] = delays[:, i] = LOST
        if links.radio_range < np.inf:
            delays[pairwise_distances(places) > links.radio_range] = LOST
        broadcast(tick, delays, self.members, self._channel)

    def log(self, steps: int) -> Log:
        """Return the plans of the start and all proposed since, in order.

        Args:
            steps: Number of steps of the flight so far.
        """
        rows = sorted(self._log)
        every = [self._log[row] for row in rows]
        accepted = np.full((len(rows), self.not_before.size), OPEN, np.int64)
        for place, one in enumerate(every):
            for j, tick in one.accepted.items():
                accepted[place, j] = tick
        return Log(
            plans=chosen(self.plans, rows),
            vehicle=np.array([one.vehicle for one in every]),
            parting=self.terms.parting[rows],
            proposed=np.array([one.proposed for one in every]),
            ended=np.array([one.ended for one in every]),
            committed=np.array([one.committed for one in every]),
            accepted=accepted,
            ticks=self._links.period,
            steps=steps,
            step_s=self._step_s,
        )
