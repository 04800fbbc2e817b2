"""Waves: the rounds in which many instances are solved in lanes.

    starts       every instance is solved from its first start, and the answer verified
    margins      an instance whose answer breaks a limit between the checks, but would
                 be cheaper than its confirmed answer (if it has one), is solved again
                 with finer checks and margins. This is done at once, since an answer
                 that is not confirmed never replaces a confirmed one, and would be lost
    neighbours   instances that failed, or for which the answer to a similar instance
                 (a neighbour) promises a lower cost, are solved from answers to similar
                 instances; this is repeated while it finds better answers
    more starts  the three rounds above are done again from other starts, for instances
                 that failed and for some drawn at random; more instances are drawn as
                 long as the other starts find cheaper answers

Solves from neighbours' answers carry a better optimum from instance to instance. So the
optimum needs to be found once only, and the starts that find it need not be tried at
every instance.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.instances.in_lanes import InLanes, LaneStart
from swarmstart.ocp.instances.margins import Amounts, with_margins
from swarmstart.ocp.instances.polishing import Group
from swarmstart.ocp.instances.retries import (
    is_cheaper,
    promises,
    with_decisions_of,
)
from swarmstart.ocp.instances.work import Work
from swarmstart.ocp.lanes.interior import Instances
from swarmstart.ocp.rollout.status import SolutionStatus
from swarmstart.ocp.statement.guesses import cold_controls

_STARTS = 4
"""Largest number of starts of an instance, if no number is given."""
_PART, _FEWEST, _MOST = 4, 64, 300
"""Other starts and neighbours' answers are first tried at one in _PART instances, but
at least at _FEWEST and at most at _MOST. If they are cheaper at none of 300 instances,
they are so at less than 1 % of all, with 95 % confidence."""
_ROUNDS = 100
"""Largest number of times that instances are tried from neighbours' answers. An optimum
gets one or two neighbours further each time, and few instances are tried after the
first times: each answer of a neighbour is tried once."""
_AROUND = 8
"""Number of nearest neighbours that are tried, the most promising one first."""
_MARGINS = 2
"""Largest number of times in a wave that limits get finer checks and margins."""
_TIGHTENED = 6
"""The same in all waves: the lanes are compiled each time, and a limit that cannot be
kept would be broken in every wave."""


class LaneWaves:
    """The waves in which the instances of a problem are solved in lanes."""

    def __init__(self, work: Work, lanes: InLanes) -> None:
        """Keep the work and the lanes.

        Args:
            work: The instances.
            lanes: Solves in lanes.
        """
        self._work, self._lanes = work, lanes
        self._instances, self._answers = work.posed.core, work.outcomes.answers
        self._neighbours = work.neighbours()
        self._few = min(max(work.size // _PART, _FEWEST), _MOST)
        # Cost of each neighbour's answer that was tried: it would lead to the same end.
        self._tried = np.full((work.size, _AROUND), np.nan)
        self._tight: InLanes | None = None
        self._amounts, self._left = Amounts(), _TIGHTENED

    def __call__(self, count: int | None) -> int:
        """Solve all instances; return the size of the sample that spared them starts.

        With a count, all instances are solved from so many starts. Without one, all are
        solved from the first start; those that fail, and some drawn at random, are
        solved from the other starts, too. If these find nothing cheaper at the
        instances drawn last, the remaining instances are not solved from them.

        Args:
            count: Number of starts of each instance; None: as in `solve_many`.

        Returns:
            Number of the instances drawn last that had a confirmed answer before; 0 if
            no start was left out in this way.
        """
        work, starts = self._work, self._starts(count or _STARTS)
        first = count or 1
        self._from(starts[:first], np.arange(work.size))
        others, rest = starts[first:], work.drawn()
        while others and rest.size:
            sample, rest = rest[: self._few], rest[self._few :]
            failed = np.isin(rest, work.outcomes.open)
            before = work.outcomes.confirmed_costs[sample]
            self._from(others, np.union1d(sample, rest[failed]))
            rest = rest[~failed]
            after = work.outcomes.confirmed_costs[sample]
            # Those that had failed say nothing of the others.
            solved = np.isfinite(before)
            if solved.any() and not is_cheaper(after, before)[solved].any():
                return int(solved.sum()) if rest.size else 0
        return 0

    def _from(self, starts: Sequence[LaneStart], chosen: NDArray[np.int64]) -> None:
        """Solve some instances from given starts, then all from neighbours' answers."""
        here = self._instances.at(chosen)
        if chosen.size < self._work.size:  # Copies of those of all would be large.
            starts = [start.at(chosen) for start in starts]
        self._wave(here, starts, chosen, "guess")
        self._from_neighbours()

    def _starts(self, count: int) -> list[LaneStart]:
        """Return starts of all instances, the last ones with random controls."""
        starts = self._led_or_held()[:count]
        for number in range(len(starts), count):
            drawn = self._work.random_start(number)
            if drawn is not None:
                starts.append(LaneStart(self._work.of_all(drawn.controls)))
        return starts

    def _led_or_held(self) -> list[LaneStart]:
        """Return starts with states that controls lead to, or that stay at x0."""
        work, x0 = self._work, self._instances.x0
        core = work.planner.problem
        cold, given = cold_controls(core), work.posed.guesses
        shape = core.model.nx, core.intervals + 1, work.size
        held = np.broadcast_to(x0[:, None], shape)
        middle = work.of_all(cold[-1])
        starts = [
            LaneStart(work.of_all(cold[0]) if given is None else given),
            LaneStart(middle if given is None else given, held),
        ]
        if given is None and len(cold) == 1:  # The first one is the middle.
            return starts
        return [*starts, LaneStart(middle)]

    def _from_neighbours(self) -> None:
        """Solve instances from neighbours' answers that promise to be cheaper there.

        The clearest promises are tried first, and further ones as long as these give
        cheaper answers.
        """
        work, answers = self._work, self._answers
        every, size = np.arange(work.size), self._few
        for _ in range(_ROUNDS):
            solved = np.flatnonzero(answers.confirmed)
            if not solved.size:
                return
            around = self._neighbours.nearest(every, solved, _AROUND)
            costs = np.where(around >= 0, answers.cost[around], np.nan)
            found = promises(work.planner.problem, self._instances, answers, around)
            found[costs == self._tried[:, : costs.shape[1]]] = 0.0
            best = found.argmax(axis=1)
            clear = found[every, best]
            size = max(size, int(np.isinf(clear).sum()))
            first = np.argsort(-clear, kind="stable")[:size]
            chosen = np.sort(first[clear[first] > 0])
            if not chosen.size:
                return
            places = chosen, best[chosen]
            self._tried[places] = costs[places]
            before = work.outcomes.confirmed_costs[chosen]
            self._from_answers(chosen, around[places])
            after = work.outcomes.confirmed_costs[chosen]
            # Those that failed are tried from all of their neighbours.
            size = 2 * size if is_cheaper(after, before).any() else 0

    def _from_answers(
        self, chosen: NDArray[np.int64], others: NDArray[np.int64]
    ) -> None:
        """Solve some instances, each from the answer to another one."""
        core, answers = self._work.planner.problem, self._answers
        own = self._instances.at(chosen)
        here = with_decisions_of(core, own, answers.x0[:, others])
        states = answers.states[:, :: core.checks, others].copy()
        states[:, 0] = here.x0
        start = LaneStart(answers.controls[..., others], states, is_near=True)
        self._wave(here, [start], chosen, "neighbour")

    def _wave(
        self,
        here: Instances,
        starts: Sequence[LaneStart],
        chosen: NDArray[np.int64],
        kind: str,
    ) -> None:
        """Solve some instances, again with margins if broken answers are cheaper.

        Args:
            here: The instances, with the guesses of what is decided.
            starts: One or several starts of each.
            chosen: Numbers of these instances.
            kind: Kind of the starts.
        """
        lanes = self._lanes
        broken = self._solved(lanes, here, starts, chosen, kind)
        if self._tight is not None:
            broken = self._again(self._tight, broken)
        for _ in range(_MARGINS):
            if lanes.paths is None or not (broken.numbers.size and self._left):
                return
            self._left -= 1
            some = broken.instances, broken.controls
            core, self._amounts = with_margins(lanes.paths, *some, self._amounts)
            self._tight = lanes.with_margins(core, broken.instances)
            if self._tight is None:
                return
            broken = self._again(self._tight, broken)

    def _again(self, tight: InLanes, broken: "_Broken") -> "_Broken":
        """Solve instances whose answers break a limit from these, with margins."""
        start = LaneStart(broken.controls, is_near=True)
        return self._solved(
            tight, broken.instances, [start], broken.numbers, "own answer"
        )

    def _solved(
        self,
        lanes: InLanes,
        here: Instances,
        starts: Sequence[LaneStart],
        chosen: NDArray[np.int64],
        kind: str,
    ) -> "_Broken":
        """Solve some instances; return answers that break a limit between the checks.

        Returned are only those that would be cheaper than the confirmed answer.
        """
        costs = self._work.outcomes.confirmed_costs[chosen]
        found = list[tuple[NDArray[np.int64], Array, Array]]()

        def noted() -> Iterator[Group]:
            for group in lanes(here, starts):
                answers, own = group.answers, costs[group.chosen]
                broken = [one is SolutionStatus.BROKEN for one in answers.status]
                asked = np.flatnonzero(broken & is_cheaper(answers.cost, own))
                places = group.chosen[asked]
                found.append(
                    (places, answers.x0[:, asked], answers.controls[..., asked])
                )
                yield group

        self._work.wave(lambda _: noted(), chosen, ("lanes", kind))
        if not found:
            return _Broken(chosen[:0], here.at(slice(0)), np.zeros((0, 0, 0)))
        places, x0, controls = (
            np.concatenate(parts, axis=-1) for parts in zip(*found, strict=True)
        )
        instances = here.at(places)._replace(x0=x0)
        return _Broken(chosen[places], instances, controls)


class _Broken(NamedTuple):
    """Answers that break a limit between the checks only.

    Attributes:
        numbers: Numbers of their instances, shape (n,).
        instances: The instances, with the decisions about the start.
        controls: Shape (nu, N, n).
    """

    numbers: NDArray[np.int64]
    instances: Instances
    controls: Array
