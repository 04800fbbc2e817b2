"""Answers to instances of a rewritten problem (core), in arrays, a column for each.

An answer replaces an earlier one if it is confirmed on the finer path (the same
controls with ten times as many integration steps) and the earlier one is not. If both
are confirmed, or neither is, it does so if it is better by (violation, cost).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.answer.solution import Solution, end_differences
from swarmstart.ocp.nlp.polish import is_better
from swarmstart.ocp.rollout.status import SolutionStatus
from swarmstart.ocp.statement.problem import OptimalControlProblem

Statuses = NDArray[Any]
"""Members of SolutionStatus, of dtype object."""


class Answers(NamedTuple):
    """Answers to n instances; costs are those of the core, the rewritten problem.

    Attributes:
        status: Status of each, shape (n,).
        cost: Cost on the problem's own grid, shape (n,).
        violation: Summed violation on that grid, relative to the scales, shape (n,).
        verified_cost: Cost on the finer path, shape (n,).
        excess: Worst excess of a constraint on the finer path, relative to its scale,
            shape (n,); 0: all are kept.
        end_difference: Largest difference between a state's end on the finer path and
            on the problem's grid, relative to the state's scale, shape (n,).
        controls: Shape (nu, N, n).
        states: At the nodes, on the problem's own grid, shape (nx, nodes, n).
        by_interval: Whether an answer is judged interval by interval, shape (n,).
        iterations: Iterations of the lanes, shape (n,); 0 for an answer of an NLP
            solver.
        costates: Derivatives of the cost by the states at the start, shape (nx, n); NaN
            for an answer of an NLP solver.
    """

    status: Statuses
    cost: Array
    violation: Array
    verified_cost: Array
    excess: Array
    end_difference: Array
    controls: Array
    states: Array
    by_interval: NDArray[np.bool_]
    iterations: NDArray[np.int64]
    costates: Array

    @classmethod
    def none(cls, core: OptimalControlProblem, n: int) -> Self:
        """Return the answers to n instances before there is any."""
        cost, violation, verified, excess, end = np.full((5, n), np.nan)
        return cls(
            status=np.full(n, SolutionStatus.NOT_REACHED),
            cost=cost,
            violation=violation,
            verified_cost=verified,
            excess=excess,
            end_difference=end,
            controls=np.full((core.model.nu, core.intervals, n), np.nan),
            states=np.full((core.model.nx, core.nodes, n), np.nan),
            by_interval=np.zeros(n, dtype=np.bool_),
            iterations=np.zeros(n, dtype=np.int64),
            costates=np.full((core.model.nx, n), np.nan),
        )

    @classmethod
    def of(cls, solutions: Sequence[Solution], core: OptimalControlProblem) -> Self:
        """Return verified answers as arrays.

        Args:
            solutions: At least one.
            core: Their problem after all rewrites (core).
        """
        plans, paths = ([getattr(s, name) for s in solutions] for name in _PARTS)
        with np.errstate(invalid="ignore"):  # Of states that are infinite.
            off = [
                end_differences(core, plan, path)
                for plan, path in zip(plans, paths, strict=True)
            ]
        return cls(
            status=np.array([s.status for s in solutions], dtype=object),
            cost=np.array([plan.cost for plan in plans]),
            violation=np.array([plan.violation for plan in plans]),
            verified_cost=np.array([path.cost for path in paths]),
            excess=np.array(
                [max([0.0, *[e.relative for e in p.broken]]) for p in paths]
            ),
            end_difference=np.array([relative_difference(*one) for one in off]),
            controls=np.stack([plan.controls for plan in plans], axis=-1),
            states=np.stack([plan.states for plan in plans], axis=-1),
            by_interval=np.array([plan.ends is not None for plan in plans]),
            iterations=np.zeros(len(plans), dtype=np.int64),
            costates=np.full((core.model.nx, len(plans)), np.nan),
        )

    @property
    def confirmed(self) -> NDArray[np.bool_]:
        """Mask of the answers that are confirmed on the finer path, shape (n,)."""
        return np.array([one.is_confirmed for one in self.status], dtype=np.bool_)

    @property
    def x0(self) -> Array:
        """Initial states with the decisions about them, shape (nx, n)."""
        return self.states[:, 0]


_PARTS = "plan", "path"


def relative_difference(off: Array, scale: Array) -> float:
    """Return the largest difference relative to its scale; 0 if both are zero."""
    return float(np.max(off / np.maximum(scale, 1e-300), initial=0.0))


@dataclass(frozen=True, slots=True, eq=False)
class Outcomes:
    """The best answers so far; their arrays are written in place.

    Attributes:
        core: The problem after all rewrites (core).
        answers: The answers, a column for each instance.
        solver: Solver of each answer, shape (n,): "lanes", the name of an NLP solver,
            or empty.
        start: Start that led to each answer, shape (n,), in the words of `Solutions`;
            empty without an answer.
        attempts: Number of solves of each instance, shape (n,).
    """

    core: OptimalControlProblem
    answers: Answers
    solver: NDArray[np.str_]
    start: NDArray[np.str_]
    attempts: NDArray[np.int64]

    @classmethod
    def none(cls, core: OptimalControlProblem, n: int) -> Self:
        """Return the outcomes of n instances before any solve."""
        return cls(
            core,
            Answers.none(core, n),
            np.full(n, "", dtype="<U16"),
            np.full(n, "", dtype="<U16"),
            np.zeros(n, dtype=np.int64),
        )

    @property
    def confirmed_costs(self) -> Array:
        """Costs of the confirmed answers, else infinite, shape (n,)."""
        return np.where(self.answers.confirmed, self.answers.cost, np.inf)

    @property
    def open(self) -> NDArray[np.int64]:
        """Numbers of the instances without a confirmed answer."""
        return np.flatnonzero(~self.answers.confirmed)

    def take(
        self, chosen: NDArray[np.int64], found: Answers, *, solver: str, start: str
    ) -> None:
        """Count a solve of some instances, and keep the answers that are better.

        Args:
            chosen: Numbers of the instances, shape (n,).
            found: Answers to these instances.
            solver: The solver.
            start: What the solve started from.
        """
        self.attempts[chosen] += 1
        self.answers.iterations[chosen] += found.iterations
        better = [self._is_better(k, found, i) for i, k in enumerate(chosen)]
        columns, taken = np.flatnonzero(better), chosen[np.array(better, dtype=bool)]
        for name, kept in self.answers._asdict().items():
            if name != "iterations":
                kept[..., taken] = getattr(found, name)[..., columns]
        self.solver[taken], self.start[taken] = solver, start

    def _is_better(self, number: int, found: Answers, column: int) -> bool:
        """Return whether an answer replaces that of an instance."""
        kept = self.answers
        if kept.status[number] is SolutionStatus.NOT_REACHED:
            return True
        before, now = kept.status[number], found.status[column]
        if before.is_confirmed != now.is_confirmed:
            return bool(now.is_confirmed)
        values = (
            (float(one.cost[i]), float(one.violation[i]))
            for one, i in ((found, column), (kept, number))
        )
        return is_better(*values, tolerance=self.core.tolerance)
