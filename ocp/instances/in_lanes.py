"""Instances solved at once in lanes, and verified.

Every start of an instance is solved in a lane of its own, and the best answer of each
instance is verified. `lanes_of` is the only function that knows which kinds of lanes
there are.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.instances.margins import at_other_nodes
from swarmstart.ocp.instances.outcomes import Answers
from swarmstart.ocp.instances.polishing import Group, OneByOne
from swarmstart.ocp.instances.verification import FinePaths
from swarmstart.ocp.lanes.answers import LaneAnswers, reached
from swarmstart.ocp.lanes.interior import Instances
from swarmstart.ocp.lanes.posed import NoLanesError
from swarmstart.ocp.nlp.polish import SAME_COST
from swarmstart.ocp.rollout.fitness import started
from swarmstart.ocp.rollout.status import SolutionStatus
from swarmstart.ocp.statement.problem import OptimalControlProblem

CHUNK = 512
"""Number of instances that are solved and verified together: all arrays along their
finer paths are in memory at once."""
_NEAR = 1e-5
"""First parameter of the central path from an answer to a similar instance."""


class LaneStart(NamedTuple):
    """One start for each of n instances.

    Attributes:
        controls: Shape (nu, N, n).
        states: States between the intervals, shape (nx, N + 1, n); None: the states
            that the controls lead to.
        is_near: Whether the starts are answers to similar instances.
    """

    controls: Array
    states: Array | None = None
    is_near: bool = False

    def at(self, chosen: NDArray[np.int64]) -> "LaneStart":
        """Return the start of some of the instances."""
        states = None if self.states is None else self.states[..., chosen]
        return self._replace(controls=self.controls[..., chosen], states=states)


Lanes = Callable[[Instances, LaneStart, Array], LaneAnswers]
"""Local solves of instances, each in a lane: (instances of the core, their start, the
decisions about the start (ny, n)) -> their answers."""


def lanes_of(planner: Planner, instances: Instances, threads: int) -> Lanes | None:
    """Return the solver in lanes for instances; None if lanes do not support them.

    Args:
        planner: Planner of the problem.
        instances: All instances; natural sizes are computed from their data.
        threads: Largest number of threads.
    """
    interior = planner.lanes_of_instances
    if interior is None or not instances.x0.shape[1]:
        return None
    try:
        common = interior.common(instances)
    except NoLanesError:
        return None

    def solved(some: Instances, start: LaneStart, starts: Array) -> LaneAnswers:
        return interior(
            some,
            start.controls,
            starts,
            start.states,
            common=common,
            mu=_NEAR if start.is_near else None,
            threads=threads,
        )

    return solved


@dataclass(frozen=True, slots=True, eq=False)
class InLanes:
    """Solves instances in lanes, and verifies the answers.

    Attributes:
        planner: Planner of the problem.
        core: The problem after all rewrites (core), as the lanes solve it: possibly
            with other checks and margins.
        lanes: The solver in lanes.
        paths: Verification of many answers at once; None: one by one.
        each: Verification one by one.
        threads: Largest number of threads.
    """

    planner: Planner
    core: OptimalControlProblem
    lanes: Lanes
    paths: FinePaths | None
    each: OneByOne
    threads: int

    def with_margins(
        self, core: OptimalControlProblem, instances: Instances
    ) -> "InLanes | None":
        """Return a solver with margins, whose answers are judged without them; or None.

        None if lanes do not support the problem with margins.

        Args:
            core: The problem after all rewrites (core), with other checks and margins.
            instances: The instances that it is for.
        """
        other = Planner(core, search=None, polish=self.planner.polish)
        given = at_other_nodes(self.planner.problem, core, instances)
        lanes = lanes_of(other, given, self.threads)
        return None if lanes is None else replace(self, core=core, lanes=lanes)

    def __call__(
        self, instances: Instances, starts: Sequence[LaneStart]
    ) -> Iterator[Group]:
        """Yield the best verified answers, chunk by chunk, in order.

        Args:
            instances: Instances of the core, with the guesses of what is decided.
            starts: One or several starts of all instances.
        """
        count = instances.x0.shape[1]
        for begin in range(0, count, CHUNK):
            chosen = np.arange(begin, min(begin + CHUNK, count))
            here = [start.at(chosen) for start in starts]
            yield Group(chosen, self._solved(instances.at(chosen), here))

    def _solved(self, instances: Instances, starts: Sequence[LaneStart]) -> Answers:
        core = self.planner.problem
        places = [one.states[0] for one in core.free_starts]
        decided = instances.x0[places]
        given = at_other_nodes(core, self.core, instances)
        ends = self.lanes(given, starts[0], decided)
        for start in starts[1:]:
            ends = better_of(ends, self.lanes(given, start, decided))
        found = Answers.none(core, instances.x0.shape[1])
        found.status[:] = SolutionStatus.INFEASIBLE
        found.status[~np.isfinite(ends.cost)] = SolutionStatus.NOT_FINITE
        found.iterations[:], found.costates[:] = ends.iterations, ends.costates
        good = np.flatnonzero(reached(ends))
        if not good.size:
            return found
        x0 = instances.x0.copy()
        for k in good:
            x0[:, k] = started(core, x0[:, k], ends.starts[:, k])
        here = instances._replace(x0=x0).at(good)
        for part, answers in self._verified(here, ends.controls[:, :, good]):
            columns = good[part]
            for name, kept in found._asdict().items():
                if name not in {"iterations", "costates"}:
                    kept[..., columns] = getattr(answers, name)
        # Where expressions have kinks, the derivatives of the lanes show no optimum.
        if not self.planner.tracer.kinks.names:
            feasible = found.status == SolutionStatus.FEASIBLE
            found.status[feasible & ends.optimal] = SolutionStatus.CONVERGED
        return found

    def _verified(self, instances: Instances, controls: Array) -> Iterator[Group]:
        if self.paths is None:
            yield from self.each.verified(instances, controls)
        else:
            every = np.arange(controls.shape[2])
            yield Group(every, self.paths(instances, controls))


def better_of(one: LaneAnswers, other: LaneAnswers) -> LaneAnswers:
    """Return the better of two answers to each instance, the first if they are equal.

    Args:
        one: Answers to n instances.
        other: Answers to the same instances.
    """
    able, also = reached(one), reached(other)
    size = np.maximum(np.abs(one.cost), np.abs(other.cost))
    with np.errstate(invalid="ignore"):
        cheaper = other.cost < one.cost - SAME_COST * size
        nearer = other.violation < one.violation
    better = np.where(able == also, np.where(able, cheaper, nearer), also)
    chosen = {
        field.name: np.where(
            better, getattr(other, field.name), getattr(one, field.name)
        )
        for field in fields(LaneAnswers)
    }
    return LaneAnswers(**chosen | {"iterations": one.iterations + other.iterations})
