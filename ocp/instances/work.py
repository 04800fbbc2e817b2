"""Work on the instances of one problem: their data, and their best answers so far."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.heuristics.running import heeded
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.common.presentation import ProgressCallback
from swarmstart.ocp.instances.instance_data import PosedInstances
from swarmstart.ocp.instances.outcomes import Outcomes
from swarmstart.ocp.instances.polishing import Group
from swarmstart.ocp.instances.retries import Neighbours, random_start
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.rollout.status import SolutionStatus

_RANDOM, _DRAWN = 1, 2
"""Numbers that are appended to the seed: for random starts, and for the instances that
are drawn."""

Solve = Callable[[NDArray[np.int64]], Iterator[Group]]
"""numbers of instances -> groups of their answers."""


@dataclass(frozen=True, slots=True, eq=False)
class Work:
    """The instances of a problem, and their best answers so far.

    Attributes:
        planner: Planner of the problem.
        posed: The valid instances.
        outcomes: Their best answers so far.
        seeds: Whole numbers that seed all random draws.
        progress: Callback for the progress, as in `solve_many`.
    """

    planner: Planner
    posed: PosedInstances
    outcomes: Outcomes
    seeds: tuple[int, ...]
    progress: ProgressCallback

    @property
    def size(self) -> int:
        """Number of instances."""
        return int(self.posed.core.x0.shape[1])

    def neighbours(self) -> Neighbours:
        """Return the distances between the instances."""
        return Neighbours(self.planner.problem, self.posed.core)

    def random_start(self, *numbers: int) -> Start | None:
        """Return random controls for all instances; None if there is nothing to draw.

        Args:
            numbers: The number of the start; left out: the first one.
        """
        return random_start(self.planner.problem, (*self.seeds, _RANDOM, *numbers))

    def drawn(self) -> NDArray[np.int64]:
        """Return the numbers of all instances in random order."""
        return np.random.default_rng((*self.seeds, _DRAWN)).permutation(self.size)

    def of(self, *statuses: SolutionStatus) -> NDArray[np.int64]:
        """Return the numbers of the instances whose status is one of those given."""
        found = [one in statuses for one in self.outcomes.answers.status]
        return np.flatnonzero(found)

    def wave(
        self, solve: Solve, chosen: NDArray[np.int64], words: tuple[str, str]
    ) -> None:
        """Solve some instances and keep the better answers, group by group.

        Args:
            solve: Function (numbers of instances) -> groups of answers to them.
            chosen: Numbers of the instances to solve.
            words: Name of the solver, and the kind of the starts in the words of
                `Solutions.start`, such as "guess".
        """
        solver, start = words
        what = "solving" if start == "guess" else f"again: {start}"
        done = 0
        groups = solve(chosen) if chosen.size else iter(())
        while True:
            with heeded():
                group = next(groups, None)
            if group is None:
                return
            self.outcomes.take(
                chosen[group.chosen], group.answers, solver=solver, start=start
            )
            done += group.chosen.size
            self.progress(done, chosen.size, f"{what} ({solver})")

    def of_all(self, controls: Array) -> Array:
        """Return controls (nu, N) as those of all instances, without copies."""
        shape = *controls.shape, self.size
        return np.broadcast_to(controls[..., None], shape)
