"""Flight of a swarm to its goals, by a rule of committed plans.

Each vehicle looks for a whole flight to its goal that is clear of what it has heard
(`seeking.py`), proposes that flight, and follows it once the rule lets the vehicle
commit to it. Until then it stays in place. A vehicle that finds no flight two times may
look for a place nearby, or on its way, in which it blocks no other; so two vehicles
that stand on each other's goals can part.
"""

from __future__ import annotations

import numpy as np

from swarmstart.arrays import Array
from swarmstart.machine_code import Count, kernel
from swarmstart.ocp.swarm.agreement import Agreement
from swarmstart.ocp.swarm.flight import SwarmFlight
from swarmstart.ocp.swarm.legs import PointMass, State
from swarmstart.ocp.swarm.plans import Plans, least_gap, no_plans
from swarmstart.ocp.swarm.seeking import PARTS, Task, seek
from swarmstart.ocp.swarm.swarm import AXES, Links, Swarm

ASIDE_AFTER, ASIDE_SHARE = 2, 0.5
"""Failed searches after which a vehicle may step aside, and the probability of it."""
DOUBT = 12
"""Most ticks until a vehicle looks again after a search that found nothing."""
ROOM = 1.01
"""Distance to others' goals and rests of a place to step aside to, in distances."""


class Team:
    """Vehicles in flight, with all plans that were ever proposed.

    Attributes:
        steps: Number of completed steps.
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
            links: Links between the vehicles.
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
        self._obstacles = np.arange(n, n + len(swarm.obstacles))
        plans = no_plans(n + len(swarm.obstacles), pieces)
        plans.samples[:n] = self._starts[:, None]
        plans.bulges[:n] = 0.0
        self._write_obstacles(plans)
        self._agreement = Agreement(
            plans, (self._starts == self._goals).all(axis=1),
            distance=swarm.plan_distance, links=links,
            rule=rule, step_s=step_s,
        )  # fmt: skip
        self._failures = np.zeros(n, np.int64)
        self._searches = 0
        self._rows = list[Count]()
        self._flight: SwarmFlight | None = None

    def advance(self) -> Array:
        """Let all vehicles exchange messages, plan, and follow their plans for a step.

        Returns:
            Accelerations that the vehicles hold in this step, not scaled, shape (n, 3)
            [m/s^2].
        """
        period, step = self._links.period, self.steps
        self._flight = None
        # Until a new plan parts from the old one, a commitment moves no vehicle.
        places = self.states()[:, :AXES]
        for tick in range(step * period, (step + 1) * period):
            self._exchange(tick)
            if tick % period == 0:
                idle = self._agreement.may_propose(tick)
                for i in self._rng.permutation(idle).tolist():
                    self._search(i, tick, step)
            self._agreement.send(tick, places, self._rng)
        self._rows.append(self._agreement.members.committed.copy())
        ways = np.diff(self._samples(self._rows[-1], (step, step + 1)), axis=1)[:, 0]
        h, self.steps = self._step_s, step + 1
        # The sum of differences keeps its rounding, so a vehicle that stands has none.
        moves = (ways != 0.0).any(axis=1)[:, None]
        pushes = np.where(moves, 2.0 * (ways - h * self.velocities) / h**2, 0.0)
        self.velocities = np.where(moves, self.velocities + h * pushes, 0.0)
        return np.asarray(pushes / self._swarm.scale)

    def states(self) -> Array:
        """Return the present states of the committed plans, not scaled.

        Returns:
            Positions and velocities, shape (n, 6) [m, m/s].
        """
        committed = self._agreement.members.committed
        places = self._samples(committed, (self.steps,))[:, 0]
        scale = self._swarm.scale
        return np.hstack([places / scale, self.velocities / scale])

    def _samples(self, rows: Count, steps: tuple[int, ...]) -> Array:
        """Return scaled positions of plans at steps, shape (rows, steps, 3)."""
        plans = self._agreement.plans
        indices = np.array(steps)[None] - plans.first[rows, None]
        last = plans.bulges.shape[1] - 1
        samples: Array = plans.samples[rows[:, None], np.minimum(indices, last)]
        return samples

    def _exchange(self, tick: int) -> None:
        """Let all hear, accept, commit and withdraw."""
        settled = self._agreement.exchange(tick, self._rng)
        for i in np.flatnonzero(settled.committed).tolist():
            self._headings[i] = self._last_heading(i)
        self._failures[settled.committed] = 0

    def _last_heading(self, i: int) -> float:
        """Return the heading with which a vehicle comes to rest [rad]."""
        agreed = self._agreement
        ways = np.diff(agreed.plans.samples[agreed.members.committed[i]], axis=0)
        moving = np.flatnonzero(ways.any(axis=1))
        if not moving.size:
            return float(self._headings[i])
        return float(np.arctan2(ways[moving[-1], 1], ways[moving[-1], 0]))

    def _search(self, i: int, tick: int, step: int) -> None:
        """Let a vehicle propose the best plan that it finds, if it is to be at rest."""
        agreed, index = self._agreement, self._lead
        row = agreed.free_row()
        committed, plans = int(agreed.members.committed[i]), agreed.plans
        if not branch(row, committed, (step, index), plans):
            return
        state = State(plans.samples[row, index].copy(), np.zeros(3))
        is_aside = self._failures[i] >= ASIDE_AFTER and self._rng.random() < ASIDE_SHARE
        goal = self._aside(i, state.position) if is_aside else self._goals[i].copy()
        if goal is None:
            return
        known = np.union1d(agreed.heard_of(i), self._obstacles)
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
            agreed.propose(i, tick, parting=step + index, is_last=not is_aside)
        else:
            self._failures[i] += 1
            agreed.not_before[i] = tick + self._rng.integers(2, DOUBT)

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
        heard = self._agreement.members.heard_committed[i]
        ends = self._agreement.plans.samples[heard[heard >= 0], -1]
        others = np.concatenate([np.delete(self._goals, i, axis=0), ends])
        apart = np.linalg.norm(others - found, axis=1)
        return found if (apart >= ROOM * self._swarm.plan_distance).all() else None

    def _write_obstacles(self, plans: Plans) -> None:
        """Write the obstacles as plans, which are long enough until they stand."""
        swarm = self._swarm
        times = np.arange(plans.bulges.shape[1]) * self._step_s
        for row, one in zip(self._obstacles, swarm.obstacles, strict=True):
            plans.samples[row] = one.position(times) * swarm.scale
            # Its clearance in place of the distance of two vehicles.
            plans.bulges[row] = swarm.clearance(one) - swarm.plan_distance
            plans.bulges[row, :-1] += swarm.scale.max() * one.bulge(times)

    def have_arrived(self) -> bool:
        """Return whether all vehicles are at rest at their goals."""
        rows = self._agreement.members.committed
        if not self._agreement.terms.is_last[rows].all():
            return False
        return bool((self._arrival_steps(rows) < self.steps).all())

    def _arrival_steps(self, rows: Count) -> Count:
        """Return the step from which on each plan is at its end for ever."""
        plans = self._agreement.plans
        samples = plans.samples[rows]
        moving = (samples != samples[:, -1:]).any(axis=2)
        # After the last sample that is elsewhere.
        last = moving.shape[1] - moving[:, ::-1].argmax(axis=1)
        return plans.first[rows] + np.where(moving.any(axis=1), last, 0)

    def flight(self) -> SwarmFlight:
        """Return the flight so far; the same object until the next step."""
        if self._flight is None:
            self._flight = self._flown()
        return self._flight

    def _flown(self) -> SwarmFlight:
        plans, rows = self._agreement.plans, np.array(self._rows)
        steps = np.arange(len(rows) + 1)[:, None]
        last = plans.bulges.shape[1] - 1
        held = np.append(rows, rows[-1:], axis=0)
        samples = plans.samples[held, np.minimum(steps - plans.first[held], last)]
        final = self._agreement.terms.is_last[rows[-1]]
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
            log=self._agreement.log(len(rows)),
        )


def lead_steps(n: int, links: Links, hops: int) -> int:
    """Return the number of steps from the proposal of a plan to its parting.

    It is enough for messages to all others and their answers: messages are repeated at
    every tick, and reach all others in time with a probability of 0.98.

    Args:
        n: Number of vehicles.
        links: Links between the vehicles.
        hops: Largest number of links that a message passes from a vehicle to another.
    """
    if links.loss:
        tries = int(np.ceil(np.log(0.02 / n) / np.log(links.loss)))
    else:
        tries = 1
    ticks = 2 * hops * (links.most_delay + max(tries, 1)) + 1
    return int(np.ceil(ticks / links.period)) + 1


@kernel
def branch(plan: int, committed: int, when: tuple[int, int], plans: Plans) -> bool:
    """Begin a plan with the committed one, up to the step at which they part.

    Return whether the committed plan is at rest by then.

    Args:
        plan: Row of the new plan.
        committed: Row of the committed one.
        when: Step of the present, and number of steps until they part.
        plans: All plans of the vehicles, each a row.
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
