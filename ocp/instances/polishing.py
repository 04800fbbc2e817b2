"""Instances solved by an NLP solver, verified or differentiated, in processes.

The instances are solved in groups, each by a copy of this process, since making a copy
takes some milliseconds. The first group is solved in this process, so that all copies
have the functions that are built at their first use. Each instance has its own
generator from the seed. So its answer is that of `solve` without search and lanes, for
any number of processes and instances.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.answer.improving import improved
from swarmstart.ocp.answer.plan import Source
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.answer.sensitivity import (
    NOT_CONVERGED,
    Data,
    NoSensitivityError,
    Sensitivity,
    sensitivities_of,
)
from swarmstart.ocp.answer.solution import Solution, verified
from swarmstart.ocp.common.processes import Ahead, processes_of
from swarmstart.ocp.instances.outcomes import Answers
from swarmstart.ocp.lanes.interior import Instances
from swarmstart.ocp.nlp.optimality import NlpPoint, is_stationary
from swarmstart.ocp.nlp.polish import Polisher
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.rollout.fitness import Known

_TOGETHER = 8
"""Largest number of instances that a process solves before it reports them."""
Seed = Sequence[int]
Derived = Sensitivity | NoSensitivityError
T = TypeVar("T")


class Group(NamedTuple):
    """Answers to some instances.

    Attributes:
        chosen: Numbers of these instances among those that were asked for, shape (n,).
        answers: Answers to these instances.
    """

    chosen: NDArray[np.int64]
    answers: Answers


class Answered(NamedTuple):
    """Answer to one instance of the rewritten problem (core).

    Attributes:
        controls: Shape (nu, N).
        states: At the nodes, shape (nx, nodes).
        known: Known data.
    """

    controls: Array
    states: Array
    known: Known


class OneByOne:
    """Solves or verifies instances of one problem, one by one.

    Attributes:
        planner: Planner of the problem.
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
        self.planner, self._seed = planner, seed
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
            known = instances.known(self.planner.problem, number)
            return self.solution(instances.x0[:, number], known, starts[number])

        return self._in_groups(solved, len(starts))

    def verified(self, instances: Instances, controls: Array) -> Iterator[Group]:
        """Yield the verified roll-outs of controls, group by group, in order.

        Args:
            instances: The instances, with the decisions about the start.
            controls: Shape (nu, N, n).
        """
        planner = self.planner

        def checked(number: int) -> Solution:
            x0 = instances.x0[:, number]
            known = instances.known(planner.problem, number)
            plan = planner.evaluated(
                controls[:, :, number], x0, known=known, source=Source.LANES
            )
            return verified(planner.tracer, plan, x0, known, advised=False)

        return self._in_groups(checked, controls.shape[2])

    def sensitivities(
        self, answers: Sequence[Answered], by: Sequence[Data]
    ) -> list[Derived]:
        """Return the derivatives of answers, or the errors that say why there are none.

        An answer that satisfies the first-order conditions of the NLP is not solved
        again. Any other answer is first polished from itself, without repair. Such an
        answer may have margins at its limits, which the NLP does not have, or come from
        collocation, whose inner variables are not stored.

        Args:
            answers: Confirmed answers.
            by: "x0" or "parameters", as in `Solution.sensitivity`.
        """
        planner = self.planner
        core, held = planner.lowered, planner.problem.integer
        # The planner of many instances always has one.
        polisher = planner.polisher or Polisher(planner.fitness)

        def derived(part: NDArray[np.int64]) -> list[Derived]:
            found, points = dict[int, Derived](), dict[int, NlpPoint]()
            for number in part.tolist():
                u, x, known = answers[number]
                point = polisher.point(u, x, x[:, 0], known, held=held)
                if point is None:
                    near = polisher(u, x[:, 0], known, states=x, near=True, held=held)
                    point = near.point
                    if point is None or not is_stationary(point):
                        found[number] = NoSensitivityError(NOT_CONVERGED)
                        continue
                points[number] = point
            controls = [answers[number].controls for number in points]
            several = sensitivities_of([*points.values()], core, controls, by)
            found |= zip(points, several, strict=True)
            return [found[number] for number in part.tolist()]

        groups = self._by_groups(derived, len(answers))
        return [one for _, found in groups for one in found]

    def solution(
        self, x0: Array, known: Known, start: Start | None, *, near: bool = False
    ) -> Solution:
        """Return the polished, verified and improved answer to one instance.

        Args:
            x0: Initial state of the rewritten problem (core), shape (nx,).
            known: Known data of the rewritten problem (core).
            start: Start of the NLP solver; None as in `polished`.
            near: Whether the start is an answer that the solver should stay near.
        """
        planner, rng = self.planner, np.random.default_rng(self._seed)
        plan = planner.plan(x0, known=known, guess=start, near=near, rng=rng)
        *_, found = improved(planner, plan, x0, known, repair=self._repair, rng=rng)
        return found

    def _in_groups(
        self, solved: Callable[[int], Solution], count: int
    ) -> Iterator[Group]:
        """Yield the answers to instances by groups."""

        def answered(part: NDArray[np.int64]) -> Answers:
            solutions = [solved(int(number)) for number in part]
            return Answers.of(solutions, self.planner.problem)

        return map(Group._make, self._by_groups(answered, count))

    def _by_groups(
        self, work: Callable[[NDArray[np.int64]], T], count: int
    ) -> Iterator[tuple[NDArray[np.int64], T]]:
        """Yield groups of instances with what is found; see the head of the module."""
        if not count:
            return
        processes = processes_of(self._threads)
        # Its size changes no bit, so it may depend on the number of processes.
        size = min(_TOGETHER, max(1, count // (4 * processes)))
        first, *others = np.array_split(np.arange(count), range(1, count, size))
        yield first, work(first)
        calls = [partial(work, part) for part in others]
        with Ahead(
            calls,
            processes=processes,
            begins=lambda: None,
            sent=lambda found: found,
            received=lambda found: found,
        ) as results:
            yield from zip(others, results, strict=True)
