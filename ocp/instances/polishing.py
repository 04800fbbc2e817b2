"""Instances solved one by one by an NLP solver, in processes, or verified one by one.

A copy of this process solves several instances, since a copy takes some milliseconds.
The first group is solved here, so that all copies have what is built at the first use.
Each instance has its own generator from the seed, and so its answer is that of `solve`
without search and lanes, for any number of processes and instances.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.answer.improving import improved
from swarmstart.ocp.answer.plan import Source
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.answer.solution import Solution, verified
from swarmstart.ocp.common.processes import Ahead, processes_of
from swarmstart.ocp.instances.outcomes import Answers
from swarmstart.ocp.lanes.interior import Instances
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.rollout.fitness import Known

_TOGETHER = 8
"""Largest number of instances that a process solves before it reports them."""
Seed = Sequence[int]


class Group(NamedTuple):
    """Answers to some instances.

    Attributes:
        chosen: Places of the instances among those that were asked for, shape (n,).
        answers: Their answers.
    """

    chosen: NDArray[np.int64]
    answers: Answers


class OneByOne:
    """Solves or verifies instances of one problem, one by one.

    Attributes:
        solver: Name of the NLP solver.
    """

    def __init__(
        self, planner: Planner, *, seed: Seed, repair: bool, threads: int | None
    ) -> None:
        """Keep how instances are solved.

        Args:
            planner: Planner of the problem, with a polish and without a search.
            seed: Seed of the generator of each instance.
            repair: As in `solve`.
            threads: Largest number of processes; None as in `solve`.
        """
        self._planner, self._seed = planner, seed
        self.solver = "" if planner.polish is None else planner.polish.plugin
        self._repair, self._threads = repair, threads

    def polished(
        self, instances: Instances, starts: Sequence[Start | None]
    ) -> Iterator[Group]:
        """Yield the answers of the NLP solver, group by group, in order.

        Args:
            instances: The instances.
            starts: Start of each; None: as `solve` starts without a guess.
        """

        def solved(number: int) -> Solution:
            known = instances.known(self._planner.problem, number)
            return self.solution(instances.x0[:, number], known, starts[number])

        return self._in_groups(solved, len(starts))

    def verified(self, instances: Instances, controls: Array) -> Iterator[Group]:
        """Yield the verified roll-outs of controls, group by group, in order.

        Args:
            instances: The instances, with the decisions about the start.
            controls: Shape (nu, N, n).
        """
        planner = self._planner

        def checked(number: int) -> Solution:
            x0 = instances.x0[:, number]
            known = instances.known(planner.problem, number)
            plan = planner.evaluated(
                controls[:, :, number], x0, known=known, source=Source.LANES
            )
            return verified(planner.tracer, plan, x0, known, advised=False)

        return self._in_groups(checked, controls.shape[2])

    def solution(
        self, x0: Array, known: Known, start: Start | None, *, near: bool = False
    ) -> Solution:
        """Return the polished, verified and improved answer to one instance.

        Args:
            x0: Initial state of the core, shape (nx,).
            known: Known data of the core.
            start: Start of the NLP solver; None as in `polished`.
            near: Whether the start is an answer that the solver should stay near.
        """
        planner, rng = self._planner, np.random.default_rng(self._seed)
        plan = planner.plan(x0, known=known, guess=start, near=near, rng=rng)
        *_, found = improved(planner, plan, x0, known, repair=self._repair, rng=rng)
        return found

    def _in_groups(
        self, solved: Callable[[int], Solution], count: int
    ) -> Iterator[Group]:
        """Yield the answers to instances by groups; see the head of the module."""
        if not count:
            return
        processes = processes_of(self._threads)
        # Its size changes no bit, so it may depend on the number of processes.
        size = min(_TOGETHER, max(1, count // (4 * processes)))
        parts = np.array_split(np.arange(count), range(1, count, size))

        def answered(part: NDArray[np.int64]) -> Answers:
            solutions = [solved(int(number)) for number in part]
            return Answers.of(solutions, self._planner.problem)

        first, *others = parts
        yield Group(first, answered(first))
        calls = [partial(answered, part) for part in others]
        with Ahead(
            calls,
            processes=processes,
            begins=lambda: None,
            sent=lambda found: found,
            received=lambda found: found,
        ) as results:
            for part, found in zip(others, results, strict=True):
                yield Group(part, found)
