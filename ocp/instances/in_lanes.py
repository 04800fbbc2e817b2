"""Instances solved at once in lanes, and verified.

`lanes_of` is the only place that knows which lanes there are.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.instances.instance_data import Instances
from swarmstart.ocp.instances.outcomes import Answers
from swarmstart.ocp.instances.polishing import Group, OneByOne
from swarmstart.ocp.instances.verification import FinePaths
from swarmstart.ocp.lanes.answers import LaneAnswers, reached
from swarmstart.ocp.rollout.fitness import started
from swarmstart.ocp.rollout.status import SolutionStatus

CHUNK = 512
"""Number of instances that are solved and verified together: all arrays along their
finer paths are in memory at once."""


class Lanes(Protocol):
    """Local solves of many instances at once, each in a lane; see lanes/interior.py."""

    def __call__(
        self,
        instances: Instances,
        controls: Array,
        starts: Array,
        states: Array | None = None,
    ) -> LaneAnswers:
        """Return the answers of all lanes.

        Args:
            instances: Instances of the core.
            controls: Shape (nu, N, n).
            starts: Decisions about the start, shape (ny, n).
            states: Between the intervals, shape (nx, N + 1, n); None: those that the
                controls lead to.
        """


def lanes_of(planner: Planner, threads: int) -> Lanes | None:
    """Return lanes for the instances of a problem; None if there are none for it.

    Args:
        planner: Planner of the problem.
        threads: Largest number of threads.
    """
    del planner, threads
    return None


@dataclass(frozen=True, slots=True, eq=False)
class InLanes:
    """Solves instances in lanes, and verifies the answers.

    Attributes:
        planner: Planner of the problem.
        lanes: The lanes.
        paths: Verification of many answers at once; None: one by one.
        each: Verification one by one.
    """

    planner: Planner
    lanes: Lanes
    paths: FinePaths | None
    each: OneByOne

    def __call__(self, instances: Instances, controls: Array) -> Iterator[Group]:
        """Yield verified answers, chunk by chunk, in order.

        Args:
            instances: Instances of the core, with the guesses of what is decided.
            controls: Starts, shape (nu, N, n).
        """
        count = controls.shape[2]
        for begin in range(0, count, CHUNK):
            chosen = np.arange(begin, min(begin + CHUNK, count))
            yield Group(
                chosen, self._solved(instances.at(chosen), controls[..., chosen])
            )

    def _solved(self, instances: Instances, controls: Array) -> Answers:
        core = self.planner.problem
        places = [one.states[0] for one in core.free_starts]
        ends = self.lanes(instances, controls, instances.x0[places])
        found = Answers.none(core, controls.shape[2])
        found.status[:] = SolutionStatus.INFEASIBLE
        found.status[~np.isfinite(ends.cost)] = SolutionStatus.NOT_FINITE
        found.iterations[:] = ends.iterations
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
                if name != "iterations":
                    kept[..., columns] = getattr(answers, name)
        return found

    def _verified(self, instances: Instances, controls: Array) -> Iterator[Group]:
        if self.paths is None:
            yield from self.each.verified(instances, controls)
        else:
            every = np.arange(controls.shape[2])
            yield Group(every, self.paths(instances, controls))
