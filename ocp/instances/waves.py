"""Waves: many instances of one problem solved in lanes, then one by one.

The lanes solve what they can (lane_waves.py). Instances without a confirmed answer are
then solved by an NLP solver, one by one: first from their own answers, if the lanes
found one that is not confirmed; then from the guess; then from the answers to similar
instances; then from random controls. If after the first of these solves the cost or the
end of an instance's answer differs on the finer grid, the problem's grid is too coarse.
No start changes that, so such an instance is not solved again.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.instances.in_lanes import InLanes
from swarmstart.ocp.instances.lane_waves import LaneWaves
from swarmstart.ocp.instances.polishing import OneByOne
from swarmstart.ocp.instances.retries import at_instances, starts_from
from swarmstart.ocp.instances.work import Work
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.rollout.status import SolutionStatus

_ROUNDS = 3
"""Largest number of times that the NLP solver tries instances from neighbours' answers;
answers found in one time serve as neighbours' answers in the next."""


class Ended(NamedTuple):
    """Result of the solves of all instances.

    Attributes:
        is_whole: Whether all solves were finished, without an interruption.
        sampled: Number of instances drawn at random at which other starts in lanes
            found nothing cheaper, so that these starts were not tried at the other
            instances; 0: no start was left out in this way.
    """

    is_whole: bool
    sampled: int


def solved(
    work: Work, lanes: InLanes | None, each: OneByOne | None, starts: int | None
) -> Ended:
    """Solve all instances; return how that ended.

    Args:
        work: The instances; their outcomes are written.
        lanes: Solves in lanes; None: there are none.
        each: Solves by the NLP solver; None: without it.
        starts: Number of starts of each instance in lanes; None: as in `solve_many`.
    """
    sampled = 0
    try:
        if lanes is not None:
            sampled = LaneWaves(work, lanes)(starts)
        if each is not None:
            _OneByOneWaves(work, each)()
    except KeyboardInterrupt:
        return Ended(is_whole=False, sampled=sampled)
    return Ended(is_whole=True, sampled=sampled)


class _OneByOneWaves:
    """Waves of solves by the NLP solver."""

    def __init__(self, work: Work, each: OneByOne) -> None:
        """Remember the work."""
        self._work, self._each = work, each
        self._core, self._instances = work.planner.problem, work.posed.core

    def __call__(self) -> None:
        """Solve the instances without a confirmed answer, and again those that fail."""
        work, given = self._work, self._work.posed.guesses
        answers = work.outcomes.answers
        # What the lanes found, but the finer path does not confirm.
        near = work.of(SolutionStatus.BROKEN, SolutionStatus.MISMATCH)
        own = [Start(answers.controls[..., k], x0=answers.x0[:, k]) for k in near]
        self._wave(near, own, "own answer")
        settled = np.intersect1d(near, work.of(SolutionStatus.MISMATCH))
        opened = self._open(settled)
        first: list[Start | None] = [None] * opened.size
        if given is not None:
            first = [Start(given[:, :, number]) for number in opened]
        self._wave(opened, first, "guess")
        self._from_neighbours(settled)
        drawn = work.random_start()
        if drawn is not None:
            opened = self._open(settled)
            starts = at_instances(self._core, self._instances, opened, drawn)
            self._wave(opened, starts, "random")

    def _open(self, settled: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the numbers of the open instances without some that are settled."""
        return np.setdiff1d(self._work.outcomes.open, settled)

    def _from_neighbours(self, settled: NDArray[np.int64]) -> None:
        outcomes, tried = self._work.outcomes, dict[int, int]()
        distances = None
        for _ in range(_ROUNDS):
            opened, confirmed = self._open(settled), outcomes.answers.confirmed
            if not opened.size or not confirmed.any():
                return
            distances = distances or self._work.neighbours()
            nearest = distances.nearest(opened, np.flatnonzero(confirmed), 1)[:, 0]
            # The same start again would lead to the same end.
            new = np.array(
                [
                    tried.get(int(own)) != k
                    for own, k in zip(opened, nearest, strict=True)
                ]
            )
            opened, nearest = opened[new], nearest[new]
            tried |= dict(zip(opened.tolist(), nearest.tolist(), strict=True))
            starts = starts_from(
                self._core, self._instances, outcomes.answers, opened, nearest
            )
            self._wave(opened, starts, "neighbour")

    def _wave(
        self,
        chosen: NDArray[np.int64],
        starts: Sequence[Start | None],
        start: str,
    ) -> None:
        each = self._each
        self._work.wave(
            lambda chosen: each.polished(self._instances.at(chosen), starts),
            chosen,
            (each.solver, start),
        )
