"""Flight of a swarm to its goals, by a rule of committed plans.

Each vehicle looks for a whole flight to its goal that is clear of what it has heard
(`seeking.py`), proposes it, and follows it when the rule lets it commit to it. Until
then it stays in place. If it finds none twice, it may look for a place nearby, or on
its way, that is in no other's way; so two that stand on each other's goals can part.

Rules, which say when a vehicle commits to a candidate:

    acknowledged  when all others that may still propose have accepted it (`rule.py`):
                  safe with any delays
    waiting       if nothing in its way is heard until it parts from the old plan: safe
                  if each message arrives before that
    hearsay       at once, if it is clear of what was heard last: not safe
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
from swarmstart.ocp.swarm.flight import ACKNOWLEDGED, HEARSAY, RULES, SwarmFlight
from swarmstart.ocp.swarm.legs import PointMass, State
from swarmstart.ocp.swarm.plans import Plans, chosen, grown, least_gap, no_plans
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
from swarmstart.ocp.swarm.seeking import PARTS, Task, seek
from swarmstart.ocp.swarm.swarm import AXES, Links, Swarm, pairwise_distances

NOTHING = -1
"""Result of a vehicle without a candidate."""
ASIDE_AFTER, ASIDE_SHARE = 2, 0.5
"""Failed searches after which a vehicle may step aside, and the probability of it."""
PATIENCE, DOUBT = 8, 12
"""Most ticks until a vehicle proposes again after a withdrawal, or looks again."""
TURN = 10
"""Steps after which the order of right of way changes."""
ROOM = 1.01
"""Distance to others' goals and rests of a place to step aside to, in distances."""
GROWTH = 8
"""Rows of plans for each vehicle that are added when there is no room."""


class Terms(NamedTuple):
    """Terms of plans, beside their paths.

    Attributes:
        parting: Step at which each parts from the one before, shape (rows,).
        is_last: Whether its vehicle proposes none once it has committed to it, shape
            (rows,).
    """

    parting: Count
    is_last: Flags


@kernel
def decide(
    now: tuple[int, int, float], rank: Count, terms: Terms, members: Members,
    plans: Plans, results: Count,
) -> None:  # fmt: skip
    """Let all vehicles accept, commit to and withdraw candidates.

    Args:
        now: Rule, step, least distance.
        rank: Order in which candidates give way, shape (n,).
        terms: Those of the plans.
        members: The vehicles.
        plans: All plans.
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


def _no_terms(rows: int) -> Terms:
    """Return the terms of plans that are not proposed yet."""
    return Terms(np.zeros(rows, np.int64), np.zeros(rows, np.bool_))


@dataclass(slots=True)
class _Proposal:
    """A plan's vehicle, its ticks, and the ticks of its acceptances; see `Log`."""

    vehicle: int
    proposed: int
    ended: int
    committed: bool
    accepted: dict[int, int]


class Team:
    """Vehicles in flight, with all plans that were ever proposed.

    Attributes:
        steps: Number of steps that are over.
        velocities: Scaled velocities of the committed plans, shape (n, 3) [m/s].
    """

    def __init__(
        self,
        swarm: Swarm,
        links: Links,
        rule: str,
        *,
        step_s: float,
        sizes: tuple[int, int, int],
        rng: np.random.Generator,
    ) -> None:
        """Let all vehicles stand at their starts.

        Args:
            swarm: The swarm.
            links: Its links.
            rule: Name of the rule.
            step_s: Step of the grid of the plans [s].
            sizes: Pieces of a plan, steps from a proposal to its parting, and flights
                that a search tries.
            rng: Random number generator.
        """
        n = swarm.size
        self.steps = 0
        self.velocities = np.zeros((n, AXES))
        pieces, self._lead, self._tries = sizes
        self._swarm, self._links, self._rule = swarm, links, rule
        self._rng, self._step_s = rng, step_s
        self._body = PointMass(
            np.multiply(swarm.acceleration, swarm.scale),
            np.multiply(swarm.speed, swarm.scale),
            step_s,
            swarm.turn_rate,
            *map(float, (swarm.drift * swarm.scale)[:2]),
        )
        self._headings = swarm.headings.copy()
        self._starts, self._goals = (
            places * swarm.scale for places in (swarm.starts, swarm.goals)
        )
        self._used = n + len(swarm.obstacles)
        self._obstacles = np.arange(n, self._used)
        self._plans = no_plans(self._used + GROWTH * n, pieces)
        self._plans.samples[:n] = self._starts[:, None]
        self._plans.bulges[:n] = 0.0
        self._write_obstacles()
        self._terms = _no_terms(len(self._plans.first))
        self._terms.is_last[:n] = (self._starts == self._goals).all(axis=1)
        self._members = members_at(np.arange(n))
        self._channel = empty_channel(
            n, links.most_delay, passed_on=links.radio_range < np.inf
        )
        self._not_before = np.zeros(n, np.int64)
        self._failures = np.zeros(n, np.int64)
        self._searches = 0
        self._rows = list[Count]()
        self._flight: SwarmFlight | None = None
        self._log = {row: _Proposal(row, START, START, True, {}) for row in range(n)}

    def advance(self) -> Array:
        """Let all exchange messages, plan, and follow their plans for a step.

        Returns:
            Accelerations that they hold in it, not scaled, shape (n, 3) [m/s^2].
        """
        period, step = self._links.period, self.steps
        self._flight = None
        for tick in range(step * period, (step + 1) * period):
            self._exchange(tick, step)
            if tick % period == 0:
                for i in self._rng.permutation(self._planning(tick)).tolist():
                    self._search(i, tick, step)
            delays = self._delays(tick)
            broadcast(tick, delays, self._members, self._channel)
        self._rows.append(self._members.committed.copy())
        ways = np.diff(self._samples(self._rows[-1], (step, step + 1)), axis=1)[:, 0]
        h, self.steps = self._step_s, step + 1
        # The sum of differences keeps its rounding, so a vehicle that stands has none.
        moves = (ways != 0.0).any(axis=1)[:, None]
        pushes = np.where(moves, 2.0 * (ways - h * self.velocities) / h**2, 0.0)
        self.velocities = np.where(moves, self.velocities + h * pushes, 0.0)
        return np.asarray(pushes / self._swarm.scale)

    def states(self) -> Array:
        """Return where the committed plans are now, and how fast, not scaled.

        Returns:
            Positions and velocities, shape (n, 6) [m, m/s].
        """
        places = self._samples(self._members.committed, (self.steps,))[:, 0]
        scale = self._swarm.scale
        return np.hstack([places / scale, self.velocities / scale])

    def _samples(self, rows: Count, steps: tuple[int, ...]) -> Array:
        """Return scaled positions of plans at steps, shape (rows, steps, 3)."""
        indices = np.array(steps)[None] - self._plans.first[rows, None]
        last = self._plans.bulges.shape[1] - 1
        samples: Array = self._plans.samples[rows[:, None], np.minimum(indices, last)]
        return samples

    def _exchange(self, tick: int, step: int) -> None:
        """Let all hear, accept, commit and withdraw."""
        n = self._swarm.size
        deliver(tick, self._members, self._channel)
        # Any order is safe; one that changes lets no vehicle wait for ever.
        rank = (np.arange(n) + step // TURN) % n
        results = np.empty(n, np.int64)
        candidates = self._members.candidate.copy()
        accepted = self._members.accepted.copy()
        decide(
            (RULES[self._rule], step, self._swarm.plan_distance), rank, self._terms,
            self._members, self._plans, results,
        )  # fmt: skip
        committed, withdrawn = results == COMMITTED, results == WITHDRAWN
        for i in np.flatnonzero(committed | withdrawn).tolist():
            proposal = self._log[int(candidates[i])]
            proposal.ended, proposal.committed = tick, bool(committed[i])
            if committed[i]:
                self._headings[i] = self._last_heading(i)
        for j, i in np.argwhere(self._members.accepted != accepted).tolist():
            self._log[int(self._members.accepted[j, i])].accepted[j] = tick
        self._failures[committed] = 0
        pauses = self._rng.integers(0, PATIENCE, size=n)
        self._not_before[withdrawn] = tick + pauses[withdrawn]

    def _last_heading(self, i: int) -> float:
        """Return the heading with which a vehicle comes to rest [rad]."""
        ways = np.diff(self._plans.samples[self._members.committed[i]], axis=0)
        moving = np.flatnonzero(ways.any(axis=1))
        if not moving.size:
            return float(self._headings[i])
        return float(np.arctan2(ways[moving[-1], 1], ways[moving[-1], 0]))

    def _planning(self, tick: int) -> Count:
        """Return the vehicles that look for a plan at a tick."""
        members = self._members
        heard = members.number >= 0
        np.fill_diagonal(heard, True)
        return np.flatnonzero(
            (members.candidate == NONE)
            & (self._not_before <= tick)
            & ~self._terms.is_last[members.committed]
            & heard.all(axis=1)
        )

    def _search(self, i: int, tick: int, step: int) -> None:
        """Let a vehicle propose the best plan that it finds, if it is to be at rest."""
        members, plans = self._members, self._plans
        committed, row, index = int(members.committed[i]), self._used, self._lead
        if row == len(plans.first):
            self._make_room()
            plans = self._plans
        if not branch(row, committed, (step, index), plans):
            return
        state = State(plans.samples[row, index].copy(), np.zeros(3))
        is_aside = self._failures[i] >= ASIDE_AFTER and self._rng.random() < ASIDE_SHARE
        goal = self._aside(i, state.position) if is_aside else self._goals[i].copy()
        if goal is None:
            return
        known = np.concatenate(
            [members.heard_committed[i], members.heard_candidate[i], self._obstacles]
        )
        known = np.unique(known[known >= 0])
        task = Task(
            step,
            index,
            state,
            goal,
            known,
            self._swarm.plan_distance,
            self._headings[i],
        )
        draws = self._rng.standard_normal((self._tries, PARTS))
        self._searches += 1
        if np.isfinite(seek(row, task, draws, self._body, plans)):
            members.candidate[i] = row
            self._log[row] = _Proposal(i, tick, OPEN, False, {})
            self._terms.parting[row] = step + index
            self._terms.is_last[row] = not is_aside
            self._used += 1
        else:
            self._failures[i] += 1
            self._not_before[i] = tick + self._rng.integers(2, DOUBT)

    def _aside(self, i: int, place: Array) -> Array | None:
        """Return a place on which no goal lies and no known plan ends.

        It is nearby, to make way, or about the straight way, to come nearer.
        """
        drawn = self._rng.standard_normal(3) * (self._swarm.speed > 0)
        if self._swarm.turn_rate < np.inf:
            drawn[2] = 0.0
        share = max(0.0, self._rng.uniform(-1.0, 1.0))
        spread = self._swarm.plan_distance * (2.0 + 0.4 * self._failures[i])
        found = place + share * (self._goals[i] - place) + spread * drawn
        heard = self._members.heard_committed[i]
        ends = self._plans.samples[heard[heard >= 0], -1]
        others = np.concatenate([np.delete(self._goals, i, axis=0), ends])
        apart = np.linalg.norm(others - found, axis=1)
        return found if (apart >= ROOM * self._swarm.plan_distance).all() else None

    def _make_room(self) -> None:
        """Add rows for further plans."""
        more = GROWTH * self._swarm.size
        self._plans = grown(self._plans, more)
        both = zip(self._terms, _no_terms(more), strict=True)
        self._terms = Terms(*(np.concatenate(pair) for pair in both))

    def _write_obstacles(self) -> None:
        """Write the obstacles as plans, which are long enough until they stand."""
        swarm, plans = self._swarm, self._plans
        times = np.arange(plans.bulges.shape[1]) * self._step_s
        for row, one in zip(self._obstacles, swarm.obstacles, strict=True):
            plans.samples[row] = one.position(times) * swarm.scale
            # Its clearance in place of the distance of two vehicles.
            plans.bulges[row] = swarm.clearance(one) - swarm.plan_distance
            plans.bulges[row, :-1] += swarm.scale.max() * one.bulge(times)

    def _delays(self, tick: int) -> Count:
        """Return the delays of all messages of a tick."""
        links = self._links
        delays = drawn_delays(self._swarm.size, links.most_delay, links.loss, self._rng)
        now = tick * self._step_s / links.period
        for i, (begins, ends) in links.silences.items():
            if begins <= now < ends:
                delays[i, :] = delays[:, i] = LOST
        if links.radio_range < np.inf:
            places = self.states()[:, :AXES]
            delays[pairwise_distances(places) > links.radio_range] = LOST
        return delays

    def have_arrived(self) -> bool:
        """Return whether all are at rest at their goals."""
        rows = self._members.committed
        if not self._terms.is_last[rows].all():
            return False
        return bool((self._arrival_steps(rows) < self.steps).all())

    def _arrival_steps(self, rows: Count) -> Count:
        """Return the step from which on each plan is at its end for ever."""
        samples = self._plans.samples[rows]
        moving = (samples != samples[:, -1:]).any(axis=2)
        # After the last sample that is elsewhere.
        last = moving.shape[1] - moving[:, ::-1].argmax(axis=1)
        return self._plans.first[rows] + np.where(moving.any(axis=1), last, 0)

    def flight(self) -> SwarmFlight:
        """Return the flight so far; the same object until the next step."""
        if self._flight is None:
            self._flight = self._flown()
        return self._flight

    def _flown(self) -> SwarmFlight:
        plans, rows = self._plans, np.array(self._rows)
        steps = np.arange(len(rows) + 1)[:, None]
        last = plans.bulges.shape[1] - 1
        held = np.append(rows, rows[-1:], axis=0)
        samples = plans.samples[held, np.minimum(steps - plans.first[held], last)]
        final = self._terms.is_last[rows[-1]]
        arrival = np.where(final, self._arrival_steps(rows[-1]), np.inf)
        return SwarmFlight(
            swarm=self._swarm,
            rule=self._rule,
            step_s=self._step_s,
            positions=np.moveaxis(samples / self._swarm.scale, 0, 2),
            arrival_s=np.where(arrival <= len(rows), arrival, np.inf) * self._step_s,
            apart=np.array(
                [least_gap(each, step, plans) for step, each in enumerate(rows)]
            ),
            searches=self._searches,
            log=self._logged(),
        )

    def _logged(self) -> Log:
        """Return all plans that were proposed, in order."""
        rows = sorted(self._log)
        every = [self._log[row] for row in rows]
        accepted = np.full((len(rows), self._swarm.size), OPEN, np.int64)
        for place, one in enumerate(every):
            for j, tick in one.accepted.items():
                accepted[place, j] = tick
        return Log(
            plans=chosen(self._plans, rows),
            vehicle=np.array([one.vehicle for one in every]),
            parting=self._terms.parting[rows],
            proposed=np.array([one.proposed for one in every]),
            ended=np.array([one.ended for one in every]),
            committed=np.array([one.committed for one in every]),
            accepted=accepted,
            ticks=self._links.period,
            steps=len(self._rows),
            step_s=self._step_s,
        )


def lead_steps(n: int, links: Links, hops: int) -> int:
    """Return the steps from a proposal to its parting: a round trip to all, mostly.

    Each message is repeated at every tick; so many repetitions reach all others with a
    probability of 0.98.

    Args:
        n: Number of vehicles.
        links: Their links.
        hops: Number of links between the two that are farthest apart.
    """
    if links.loss:
        tries = int(np.ceil(np.log(0.02 / n) / np.log(links.loss)))
    else:
        tries = 1
    ticks = 2 * hops * (links.most_delay + max(tries, 1)) + 1
    return int(np.ceil(ticks / links.period)) + 1


@kernel
def branch(plan: int, committed: int, when: tuple[int, int], plans: Plans) -> bool:
    """Begin a plan with what is committed to; return whether that rests then.

    Args:
        plan: Row of the new plan.
        committed: Row of the committed one.
        when: Step of the present, and number of steps until they part.
        plans: All plans.
    """
    step, index = when
    plans.first[plan] = step
    last = plans.bulges.shape[1] - 1
    held = 0
    for k in range(index + 1):
        held = min(step + k - plans.first[committed], last)
        plans.bulges[plan, k] = plans.bulges[committed, held]
        for axis in range(3):
            plans.samples[plan, k, axis] = plans.samples[committed, held, axis]
    followed = plans.samples[committed]
    for k in range(held, last):
        for axis in range(3):
            if followed[k, axis] != followed[last, axis]:
                return False
    return True
