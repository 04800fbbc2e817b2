"""Status of an answer, and advice: what to change in the problem, or in the call."""

from dataclasses import dataclass
from enum import Enum

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.checking import Excess
from swarmstart.ocp.path import Path
from swarmstart.ocp.problem import OptimalControlProblem

Array = NDArray[np.float64]
_STABLE = 2.5
"""|eigenvalue| times the step up to which classical Runge-Kutta stays stable, about."""
_OFTEN = 0.25
"""Part of the points at which a mode must be too fast for the model to be stiff."""
_LOOKED_AT = 25
"""Points of a path at which eigenvalues are computed."""


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


@dataclass(frozen=True, slots=True)
class Found:
    """A status and why.

    Attributes:
        status: The status.
        reason: Why, with numbers.
        excess: The worst excess, if constraints are the reason.
        unpolished: Whether no polish was asked for.
    """

    status: SolutionStatus
    reason: str
    excess: Excess | None = None
    unpolished: bool = False


@dataclass(frozen=True, slots=True)
class Stiffness:
    """A mode of the model that is too fast for the integrator's step.

    Attributes:
        time: When [s].
        rate: Size of the eigenvalue [1/s].
        substeps: Substeps that would be stable.
    """

    time: float
    rate: float
    substeps: int


def stiffness(
    problem: OptimalControlProblem, path: Path, parameters: Array
) -> Stiffness | None:
    """Return the fastest decaying mode along a path if the step is too long for it."""
    model = problem.model
    slopes = ca.Function(
        "slopes",
        [model.states, model.controls, model.parameters],
        [ca.jacobian(model.ode, model.states)],
    )
    finite = np.flatnonzero(np.isfinite(path.states[:, :-1]).all(axis=0))
    if not finite.size:
        return None
    places = finite[np.linspace(0, finite.size - 1, _LOOKED_AT).astype(int)]
    step = problem.dt / problem.checks / problem.substeps
    fast: list[Stiffness] = []
    for place in places:
        A = np.array(slopes(path.states[:, place], path.controls[:, place], parameters))
        values = np.linalg.eigvals(A) if np.isfinite(A).all() else np.zeros(1)
        rate = float(np.abs(values[values.real < 0]).max(initial=0.0))
        fitting = np.ceil(problem.substeps * rate * step / _STABLE)
        if rate * step > _STABLE and np.isfinite(fitting):
            fast.append(Stiffness(float(path.times[place]), rate, int(fitting)))
    if len(fast) < _OFTEN * places.size:
        return None  # The edge of a model's domain, as of a root, is no stiffness.
    return max(fast, key=lambda mode: mode.rate)


def advice_for(
    problem: OptimalControlProblem, found: Found, stiff: Stiffness | None
) -> str:
    """Return what to change for a status; empty if there is nothing.

    Args:
        problem: The problem.
        found: Its status, and why it has that.
        stiff: A mode that is too fast for the step; None: there is none.
    """
    if stiff is not None:
        return (
            f"the model is stiff: a mode decays at {stiff.rate:.3g} per second at "
            f"{stiff.time:.4g} s; set substeps to at least {stiff.substeps}"
        )
    told = {
        SolutionStatus.BROKEN: _between_checks(problem, found.excess),
        SolutionStatus.MISMATCH: _finer(problem),
        SolutionStatus.NOT_FINITE: _DEFINED,
        SolutionStatus.INFEASIBLE: _WEAKER,
    }
    if found.unpolished:
        return "polish='ipopt' would make it a local optimum"
    return told.get(found.status, "")


_DEFINED = (
    "bound the states to where the model is defined, such as "
    "Bounds(states=(1e-3, inf)), or start from a guess that stays there"
)
_WEAKER = (
    "try a larger budget, a guess, a longer horizon or weaker constraints; a search "
    "without a cost shows how little the constraints can be broken"
)


def _finer(problem: OptimalControlProblem) -> str:
    """Return how to integrate more finely."""
    if problem.integrator != "rk4":
        return "integrate more finely: integrator='rk4'"
    return (
        f"integrate more finely: substeps={2 * problem.substeps} or more; an "
        "expression that jumps needs an interval that begins there"
    )


def _between_checks(problem: OptimalControlProblem, excess: Excess | None) -> str:
    """Return what helps against a constraint broken between the checks."""
    more = f"checks={2 * problem.checks}"
    if excess is None:
        return more
    return (
        f"repair=True, more checks ({more}), or a margin of {excess.amount:.2g} on "
        f"{excess.name}"
    )
