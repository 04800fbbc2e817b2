"""The answer to one optimal-control problem: recomputed on a finer grid, never trusted.

A coarse integrator lets solvers find optima that do not exist. So every answer is
integrated again with a step ten times finer, and a cost, violation or final state that
does not agree is a status, not a footnote.
"""

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.ocp.fitness import NOTHING, Known, replay
from swarmstart.ocp.planner import Plan
from swarmstart.ocp.polish import PolishStatus
from swarmstart.ocp.problem import OptimalControlProblem

Array = NDArray[np.float64]
FINER = 10


class SolutionStatus(Enum):
    """What can be said of an answer."""

    CONVERGED = "a local optimum, confirmed on the finer grid"
    FEASIBLE = "feasible, not polished to a local optimum, confirmed on the finer grid"
    MISMATCH = "not confirmed: the finer grid gives another answer"
    INFEASIBLE = "no feasible solution was found"

    @property
    def is_confirmed(self) -> bool:
        """Whether the answer is feasible, and confirmed on the finer grid."""
        return self in (SolutionStatus.CONVERGED, SolutionStatus.FEASIBLE)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Solution:
    """The best answer found, and what a finer integration says of it.

    Attributes:
        status: What can be said of the answer.
        times: At the nodes, shape (nodes,) [s].
        states: At the nodes, finely integrated, shape (nx, nodes).
        controls: Shape (nu, N).
        cost: Cost on the problem's own grid.
        violation: Summed violation on the problem's own grid.
        verified_cost: Cost on the finer grid.
        verified_violation: Violation on the finer grid, at the same checks.
        plan: The plan, with its source and what it took.
    """

    status: SolutionStatus
    times: Array
    states: Array
    controls: Array
    cost: float
    violation: float
    verified_cost: float
    verified_violation: float
    plan: Plan


def verified(
    problem: OptimalControlProblem,
    plan: Plan,
    x0: ArrayLike,
    known: Known = NOTHING,
    *,
    tolerance: float = 1e-3,
) -> Solution:
    """Return a plan as a solution, integrated ten times finer.

    Args:
        problem: The problem the plan was made for.
        plan: The plan.
        x0: Initial state, shape (nx,).
        known: Parameters and signals.
        tolerance: What counts as agreement: the largest difference of the costs and of
            the final states, relative to the cost and to each state's largest value
            (at least 1), and the largest absolute difference of the violations.
    """
    fine = replace(problem, substeps=problem.substeps * FINER)
    states, cost, violation = replay(fine, plan.controls, x0, known)
    scale = max(abs(cost), abs(plan.cost))
    agrees = abs(cost - plan.cost) <= tolerance * scale and (
        abs(violation - plan.violation) <= max(tolerance, problem.tolerance)
    )
    size = np.maximum(np.abs(states).max(axis=1), 1.0)
    agrees &= bool((np.abs(states - plan.states)[:, -1] <= tolerance * size).all())
    if not plan.feasible:
        status = SolutionStatus.INFEASIBLE
    elif not agrees:
        status = SolutionStatus.MISMATCH
    elif plan.polish_status is PolishStatus.CONVERGED:
        status = SolutionStatus.CONVERGED
    else:
        status = SolutionStatus.FEASIBLE
    return Solution(
        status=status,
        times=problem.times,
        states=states,
        controls=plan.controls,
        cost=plan.cost,
        violation=plan.violation,
        verified_cost=cost,
        verified_violation=violation,
        plan=plan,
    )
