"""What can be said of an answer, in one sentence."""

from enum import Enum


class SolutionStatus(Enum):
    """What can be said of an answer."""

    CONVERGED = "a local optimum, confirmed on the finer grid"
    FEASIBLE = "feasible, confirmed on the finer grid, not shown to be a local optimum"
    BROKEN = "not confirmed: a constraint is broken between the checks"
    MISMATCH = "not confirmed: the finer grid gives another answer"
    NOT_FINITE = "no answer: the trajectory leaves the finite numbers"
    INFEASIBLE = "no feasible solution was found"

    @property
    def is_confirmed(self) -> bool:
        """Whether the answer is feasible, and confirmed on the finer grid."""
        return self in (SolutionStatus.CONVERGED, SolutionStatus.FEASIBLE)
