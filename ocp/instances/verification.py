"""Verification of many answers at once, by the rules of `verified`.

The values are those of the problem's own grid and of a path ten times finer, in machine
code for all instances (rollout/paths_at_once.py). An answer that is confirmed is called
FEASIBLE: whether it is a local optimum is not asked here.

Each answer is judged by the natural sizes of its own instance, as `verified` does: with
common sizes, a small instance could break a limit unnoticed, and a large one would seem
to break a limit that it keeps. These sizes are needed only if something is broken or
differs.
"""

from dataclasses import dataclass

import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.answer.solution import allowed_cost, allowed_ends, end_scales
from swarmstart.ocp.instances.outcomes import Answers, Statuses
from swarmstart.ocp.lanes.interior import Instances
from swarmstart.ocp.rollout.fitness import at_nodes
from swarmstart.ocp.rollout.path import Tracer
from swarmstart.ocp.rollout.paths_at_once import (
    Data,
    Grid,
    Paths,
    PathValues,
    scales_of,
)
from swarmstart.ocp.rollout.scaling import Sizes
from swarmstart.ocp.rollout.status import SolutionStatus
from swarmstart.ocp.statement.problem import OptimalControlProblem


@dataclass(frozen=True, slots=True, eq=False)
class FinePaths:
    """Verifies the controls of many instances of a rewritten problem (core) at once.

    Attributes:
        paths: The compiled paths.
    """

    paths: Paths

    def __call__(self, instances: Instances, controls: Array) -> Answers:
        """Return controls with their values and statuses.

        Args:
            instances: Instances, with the decisions about the start.
            controls: Shape (nu, N, n).
        """
        n = controls.shape[2]
        with np.errstate(invalid="ignore", over="ignore"):  # Of what is infinite.
            every = [_no_sizes(self.paths.tracer)] * n
            found = self._verified(instances, controls, every)
            kept = (found.violation == 0) & (found.excess == 0)
            asked = np.flatnonzero(~(kept & found.confirmed))
            if asked.size:
                own, parts = controls[..., asked], instances.at(asked)
                better = self._verified(parts, own, self._sizes(parts, own))
                for values, exact in zip(found, better, strict=True):
                    values[..., asked] = exact
        return found

    def excesses(self, instances: Instances, controls: Array) -> tuple[Array, Array]:
        """Return the worst excess of each path row, relative, and the rows' scales.

        Args:
            instances: As in a call of the object.
            controls: Shape (nu, N, n).

        Returns:
            Both of shape (rows, n).
        """
        sizes = self._sizes(instances, controls)
        with np.errstate(invalid="ignore", over="ignore"):
            found = self.paths.along(self._data(instances, controls, sizes)).along
        return found, scales_of(self.paths.tracer.checker.path, sizes)

    def _sizes(self, instances: Instances, controls: Array) -> list[Sizes]:
        """Return the natural sizes of each instance."""
        x0, p, _ = instances
        signals = at_nodes(self.paths.tracer.problem, instances.signals)
        return self.paths.tracer.shooting.sizing.of_all(x0, p, signals, controls)

    def _data(self, instances: Instances, controls: Array, sizes: list[Sizes]) -> Data:
        signals = at_nodes(self.paths.tracer.problem, instances.signals)
        return Data(controls, instances.x0, instances.parameters, signals, sizes)

    def _verified(
        self, instances: Instances, controls: Array, sizes: list[Sizes]
    ) -> Answers:
        problem, n = self.paths.tracer.problem, controls.shape[2]
        data = self._data(instances, controls, sizes)
        grid, path = self.paths.own_grid(data), self.paths.along(data)
        scale = end_scales(problem, path.reach)
        off = np.abs(path.ends - grid.states[:, -1])
        relative = off / np.maximum(scale, 1e-300)
        rows = np.vstack([path.along, path.at_end])
        return Answers(
            status=_judged(problem, data, grid, path, (off, scale)),
            cost=grid.cost,
            violation=grid.violation,
            verified_cost=path.cost,
            excess=rows.max(axis=0, initial=0.0),
            end_difference=relative.max(axis=0, initial=0.0),
            controls=controls.copy(),
            states=grid.states,
            by_interval=np.zeros(n, dtype=np.bool_),
            iterations=np.zeros(n, dtype=np.int64),
            costates=np.full((problem.model.nx, n), np.nan),
        )


def fine_paths_of(planner: Planner, *, threads: int = 1) -> FinePaths | None:
    """Return the verification of many answers; None if they are verified one by one.

    Args:
        planner: Planner of the problem.
        threads: Largest number of threads.
    """
    paths = planner.paths_at_once
    return None if paths is None else FinePaths(paths.with_threads(threads))


def _no_sizes(tracer: Tracer) -> Sizes:
    """Return sizes that allow nothing: all differences count, and scales are 1.

    An answer that keeps all limits by them, and is confirmed, has the same values and
    the same status by its natural sizes, which are not needed then.
    """
    problem, checker = tracer.problem, tracer.checker
    numbers = [number for number, _ in (*checker.path.places, *checker.end.places)]
    count = len(problem.path_constraints) + len(problem.terminal_constraints)
    return Sizes(
        states=np.zeros(problem.model.nx),
        controls=np.zeros(problem.model.nu),
        cost=0.0,
        rows=tuple(np.ones(numbers.count(number)) for number in range(count)),
        weights=np.ones(problem.automatic),
    )


def _judged(
    problem: OptimalControlProblem,
    data: Data,
    grid: Grid,
    path: PathValues,
    ends: tuple[Array, Array],
) -> Statuses:
    """Return the status of each answer, as `_judged` of answer/solution.py does.

    Args:
        problem: The rewritten problem (core).
        data: The instances with their controls.
        grid: Roll-outs on the problem's own grid.
        path: Values of the finer paths.
        ends: Differences of the states at the end, and their scales, each (nx, n).
    """
    natural = np.array([one.cost for one in data.sizes])
    states = np.stack([one.states for one in data.sizes], axis=-1)
    off, scale = ends
    flat = grid.states.reshape(-1, grid.cost.size)
    numbers = np.vstack([flat, grid.cost, grid.violation])
    finite = np.isfinite(numbers).all(axis=0) & path.finite
    # Not `>`: NaN differs as well.
    same = np.vstack(
        [
            path.finite,
            np.abs(path.cost - grid.cost) <= allowed_cost(path.magnitude, natural),
            off <= allowed_ends(scale, states, path.ends),
            path.at_end <= problem.path_tolerance,
        ]
    ).all(axis=0)
    kept = (path.along <= problem.path_tolerance).all(axis=0)
    broken = grid.violation > problem.tolerance
    found = np.full(grid.cost.size, SolutionStatus.FEASIBLE, dtype=object)
    # The graver reason last.
    found[~kept] = SolutionStatus.BROKEN
    found[~same] = SolutionStatus.MISMATCH
    found[broken] = SolutionStatus.INFEASIBLE
    found[broken & ~finite] = SolutionStatus.NOT_FINITE
    return found
