"""Status of an answer, and advice on what to change in the problem or the call."""

from dataclasses import dataclass
from enum import Enum

from swarmstart.ocp.integration.adaptive import MOST_TICKS
from swarmstart.ocp.integration.integrators import INTEGRATORS
from swarmstart.ocp.rollout.checking import Excess
from swarmstart.ocp.rollout.stiffness import FastMode
from swarmstart.ocp.statement.problem import OptimalControlProblem

_MANY = 1000
"""Number of substeps above which they are no alternative."""


class SolutionStatus(Enum):
    """Status of an answer."""

    CONVERGED = "a local optimum, confirmed on the finer grid"
    FEASIBLE = "feasible, confirmed on the finer grid, not shown to be a local optimum"
    BROKEN = "not confirmed: a constraint is broken between the checks"
    MISMATCH = "not confirmed: the finer grid gives another answer"
    NOT_FINITE = "no answer: the trajectory leaves the finite numbers"
    INFEASIBLE = "no feasible solution was found"

    @property
    def is_confirmed(self) -> bool:
        """True if the answer is feasible and confirmed on the finer grid."""
        return self in (SolutionStatus.CONVERGED, SolutionStatus.FEASIBLE)


@dataclass(frozen=True, slots=True)
class Found:
    """A status with its reason.

    Attributes:
        status: The status.
        reason: Reason, with numbers.
        excess: The worst excess, if constraints are the reason.
        unpolished: Whether no polish was asked for.
    """

    status: SolutionStatus
    reason: str
    excess: Excess | None = None
    unpolished: bool = False


def advice_for(
    problem: OptimalControlProblem, found: Found, fast: FastMode | None
) -> str:
    """Return advice on what to change for a status; empty if there is none.

    Args:
        problem: The problem.
        found: Its status, with the reason.
        fast: A mode that is too fast for the step; None without one.
    """
    if fast is not None:
        return _shorter_or_implicit(problem, fast)
    told = {
        SolutionStatus.BROKEN: _between_checks(problem, found.excess),
        SolutionStatus.MISMATCH: _finer(problem),
        SolutionStatus.NOT_FINITE: _DEFINED + _too_fast(problem),
        SolutionStatus.INFEASIBLE: _WEAKER,
    }
    if found.unpolished:
        return "polish='ipopt' would make it a local optimum"
    return told.get(found.status, "")


_DEFINED = (
    "bound the states to the domain of the model, such as "
    "Bounds(states=(1e-3, inf)), or start from a guess that stays there"
)
_WEAKER = (
    "try a larger budget, a guess, a longer horizon or weaker constraints; a search "
    "without a cost shows the smallest possible violation"
)


def _too_fast(problem: OptimalControlProblem) -> str:
    """Return another possible cause of a failure with step size control."""
    if not problem.is_adaptive:
        return ""
    return (
        f"; the integration stops after {MOST_TICKS} steps from check to check: use "
        "more intervals or checks, or a larger integrator_tolerance"
    )


def _shorter_or_implicit(problem: OptimalControlProblem, fast: FastMode) -> str:
    """Return the remedy for a mode that makes the steps unstable."""
    step = problem.dt / problem.checks / problem.substeps
    unstable = f"which makes steps of {step:.3g} s of {problem.integrator} unstable"
    if not fast.is_stiff:
        return (
            f"a mode swings at {fast.rate:.3g} rad/s at {fast.time:.4g} s, {unstable}; "
            f"set substeps to at least {fast.substeps}"
        )
    told = (
        f"the model is stiff: a mode decays at {fast.rate:.3g} per second at "
        f"{fast.time:.4g} s, {unstable}; use integrator='stiff'"
    )
    if fast.substeps > _MANY:
        return told
    return f"{told}, or set substeps to at least {fast.substeps}"


def _finer(problem: OptimalControlProblem) -> str:
    """Return the advice to integrate more finely."""
    method = INTEGRATORS[problem.integrator]
    if method.order < INTEGRATORS["rk4"].order:
        return "integrate more finely: integrator='rk4'"
    if problem.is_adaptive:
        finer = (problem.integrator_tolerance or 0.0) / 10
        return (
            f"integrate more finely: integrator_tolerance={finer:.1g}, or more "
            "intervals; an expression that jumps needs an interval that begins there"
        )
    return (
        f"integrate more finely: substeps={2 * problem.substeps} or more; an "
        "expression that jumps needs an interval that begins there"
    )


def _between_checks(problem: OptimalControlProblem, excess: Excess | None) -> str:
    """Return the remedy for a constraint broken between the checks."""
    more = f"checks={2 * problem.checks}"
    if excess is None:
        return more
    return (
        f"repair=True, more checks ({more}), or a margin of {excess.amount:.2g} on "
        f"{excess.name}"
    )
