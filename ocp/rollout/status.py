"""Status of an answer, and advice on what to change in the problem or the call.

One cause of an answer that is not finite is a mode that is too fast for the steps of
an explicit integrator. A step of length h multiplies a mode e^(lambda t) of the
linearised model by R(h lambda), whereas the exact factor is e^(h lambda):

    rk4    R(z) = 1 + z + z^2/2 + z^3/6 + z^4/24     stable for real z >= -2.785
    euler  R(z) = 1 + z                              for real z >= -2

If a mode decays, Re lambda < 0, but grows from step to step, |R(h lambda)| > 1, the
computed states explode. The model is stiff if such a mode decays faster than it
oscillates. If it oscillates faster, only a shorter step resolves it.

The model may also be unstable. With x' = f(x, u), a small deviation d of the state
obeys d' = A(t) d with A = df/dx. Over some time d is multiplied by a matrix. The
largest singular value of this matrix, with each state divided by its size, is the
growth. A roll-out of controls that are right up to 1e-8 says nothing about the end
state after a growth of 1e8; a roll-out of each interval alone still confirms an answer.

Source: Hairer and Wanner (1996), Solving Ordinary Differential Equations II, IV.2.
"""

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.integration.integrators import INTEGRATORS
from swarmstart.ocp.integration.rodas import MOST_TICKS
from swarmstart.ocp.rollout.checking import Excess
from swarmstart.ocp.rollout.fitness import Known, at_nodes, replay, shared_arguments
from swarmstart.ocp.rollout.path import Path, signals_between
from swarmstart.ocp.rollout.shooting import Shooting
from swarmstart.ocp.statement.problem import OptimalControlProblem

_MANY = 1000
"""Number of substeps above which more substeps are not advised."""
_OFTEN = 0.25
"""Share of points with a mode that is too fast from which it counts as the cause."""
_MUCH = np.log(1e6)
"""Logarithm of the growth over all points from which the mode also counts as the
cause: an explosion in one of many intervals."""
_A_STEP = np.log(4.0)
"""Largest logarithm of growth that one step counts for: at the edge of a model's
domain, as of a root, a few steps see modes of any rate."""
_IMPLICIT = 16
"""Number of implicit steps between checks, if the explicit steps explode."""
_LOOKED_AT = 100
"""Number of points of a path at which eigenvalues are computed."""

MOST_GROWTH = math.log(1e8)
"""Logarithm of the largest growth that a roll-out is trusted with."""
_LONGEST = 300
"""Power of ten above which a factor is no number any more."""
_STEEPEST = 300.0
"""Largest norm of A dt that is exponentiated; more is growth enough."""
_ORDERS = 14
"""Orders of the series of an exponential of a norm of at most 1/2."""


class SolutionStatus(Enum):
    """Status of an answer.

    INVALID and NOT_REACHED occur only if many instances are solved at once.
    """

    CONVERGED = "a local optimum, confirmed on the finer grid"
    FEASIBLE = "feasible, confirmed on the finer grid, not shown to be a local optimum"
    BROKEN = "not confirmed: a constraint is broken between the checks"
    MISMATCH = "not confirmed: the finer grid gives another answer"
    NOT_FINITE = "no answer: the trajectory leaves the finite numbers"
    INFEASIBLE = "no feasible solution was found"
    INVALID = "not solved: the data of the instance are invalid"
    NOT_REACHED = "not solved: the work was stopped before"

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
        advice: Advice that the reason leads to; empty if the status says enough.
    """

    status: SolutionStatus
    reason: str
    excess: Excess | None = None
    advice: str = ""


@dataclass(frozen=True, slots=True)
class FastMode:
    """A mode of the model that is too fast for the integrator's step.

    Attributes:
        time: Time of the path's point at which the model is linearised [s].
        rate: Absolute value of the eigenvalue [1/s].
        growth: Natural logarithm of the largest factor by which a step multiplies a
            mode that decays.
        substeps: Number of substeps that would be stable.
        is_stiff: Whether the mode decays faster than it oscillates.
    """

    time: float
    rate: float
    growth: float
    substeps: int
    is_stiff: bool


class Growth(NamedTuple):
    """The largest growth of a deviation.

    Attributes:
        log: Natural logarithm of the growth.
        begin: When the deviation begins to grow [s].
        end: When it is largest [s].
        rate: Rate of the fastest growing mode: the largest real part of an eigenvalue
            [1/s].
        time: Time at which this mode occurs [s].
    """

    log: float
    begin: float
    end: float
    rate: float
    time: float

    @property
    def is_large(self) -> bool:
        """True if the growth is so large that a roll-out confirms nothing."""
        return not self.log <= MOST_GROWTH

    def __str__(self) -> str:
        """Return the growth as part of a sentence."""
        power = self.log / math.log(10)
        factor = f"{10**power:.2g}" if power < _LONGEST else f"1e{power:.0f}"
        return (
            f"a deviation grows {factor}-fold from {self.begin:.4g} s to "
            f"{self.end:.4g} s (fastest by {self.rate:.3g} per second at "
            f"{self.time:.4g} s)"
        )


def advice_for(
    problem: OptimalControlProblem,
    found: Found,
    fast: FastMode | None,
    grown: Growth | None = None,
) -> str:
    """Return advice on what to change for a status; empty if there is no advice.

    Args:
        problem: The problem.
        found: Status of the answer, with the reason.
        fast: A mode that is too fast for the step; None if there is no such mode.
        grown: Growth of deviations, if it may be the reason.
    """
    if fast is not None:
        return _shorter_or_implicit(problem, fast)
    if grown is not None and grown.is_large:
        return _unstable(problem, grown, found.status.is_confirmed)
    told = {
        SolutionStatus.BROKEN: _between_checks(problem, found.excess),
        SolutionStatus.MISMATCH: _finer(problem),
        SolutionStatus.NOT_FINITE: _DEFINED + _too_many_ticks(problem),
        SolutionStatus.INFEASIBLE: _WEAKER,
        SolutionStatus.INVALID: "correct the data of the instance",
        SolutionStatus.NOT_REACHED: "solve the instance again",
    }
    return found.advice or told.get(found.status, "")


def _unstable(problem: OptimalControlProblem, grown: Growth, is_confirmed: bool) -> str:
    """Return the advice for a model whose deviations grow too much for a roll-out."""
    if is_confirmed:
        return "controls alone do not hold this path; it needs feedback"
    return (
        f"the model is unstable: {grown}, so that no roll-out confirms an answer; "
        "polish='ipopt' solves it interval by interval, with more intervals "
        f"({2 * problem.intervals}) or a guess of the states if it does not converge"
    )


_DEFINED = (
    "bound the states to the domain of the model, such as "
    "Bounds(states=(1e-3, inf)), or start from a guess that stays there"
)
_WEAKER = (
    "try a larger budget, a guess, a longer horizon or weaker constraints; a search "
    "without a cost shows the smallest possible violation"
)


def _too_many_ticks(problem: OptimalControlProblem) -> str:
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


def fastest_mode(
    shooting: Shooting, path: Path, x0: Array, known: Known
) -> FastMode | None:
    """Return the fastest mode for which an explicit step is too long.

    None if there is no such mode, or if such modes are rare and grow little.

    Args:
        shooting: The problem's functions.
        path: The finer path.
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
    """
    problem = shooting.problem
    # An implicit method is stable for every mode that decays.
    if not INTEGRATORS[problem.integrator].growth:
        return None
    points = _points(problem, path, x0, known)
    fast: list[FastMode] = []
    for time, A in zip(points[0], _slopes(shooting, *points, known), strict=True):
        # eigvals raises an error for numbers that are not finite.
        values = np.linalg.eigvals(A) if np.isfinite(A).all() else np.zeros(1)
        mode = _too_fast(problem, float(time), values.astype(np.complex128))
        if mode is not None:
            fast.append(mode)
    if not fast:
        return None
    # Number of steps that each of the points stands for.
    steps = problem.intervals * problem.checks * problem.substeps / points[0].size
    grown = sum(min(mode.growth, _A_STEP) for mode in fast) * steps
    if len(fast) < _OFTEN * points[0].size and grown < _MUCH:
        return None
    if np.isfinite(path.states).all():
        return max(fast, key=lambda mode: mode.rate)
    return fast[0]  # Later ones may come from an explosion.


def _points(
    problem: OptimalControlProblem, path: Path, x0: Array, known: Known
) -> tuple[Array, Array, Array]:
    """Return times, states and controls of the test points, one column each.

    States that explode because the finer steps are too long as well say nothing of the
    model. A method that is stable for any decaying mode then finds the true states.
    """
    times, states, controls = path.times[:-1], path.states[:, :-1], path.controls
    if not np.isfinite(path.states).all():
        every = controls.shape[1] // problem.intervals
        implicit = replace(problem, integrator="stiff", substeps=_IMPLICIT)
        with np.errstate(all="ignore"):
            found, _, _ = replay(implicit, controls[:, ::every], x0, known)
        if np.isfinite(found).all():
            times, states = problem.times[:-1], found[:, :-1]
            controls = np.repeat(controls[:, ::every], problem.checks, axis=1)
    # The initial state is finite, so there is at least one such point.
    finite = np.flatnonzero(np.isfinite(states).all(axis=0))
    places = finite[np.linspace(0, finite.size - 1, _LOOKED_AT).astype(int)]
    return times[places], states[:, places], controls[:, places]


def _slopes(
    shooting: Shooting, times: Array, states: Array, controls: Array, known: Known
) -> list[Array]:
    """Return the Jacobian of the dynamics at each point."""
    problem, slopes = shooting.problem, shooting.rate_slopes
    _, parameters, flat = shared_arguments(problem, states[:, 0], known)
    signals = signals_between(problem, at_nodes(problem, flat), times)
    return [
        np.array(slopes(x, u, parameters, s[: problem.model.ns]))
        for x, u, s in zip(states.T, controls.T, signals.T, strict=True)
    ]


def growth_along(
    shooting: Shooting,
    states: Array,
    controls: Array,
    known: Known,
    sizes: Array,
) -> Growth:
    """Return the largest growth of a deviation along a path.

    Args:
        shooting: The problem's functions.
        states: States of the path at the beginning of each interval, shape (nx, N); the
            growth ends at the first state that is not finite.
        controls: Shape (nu, N).
        known: Values of the parameters and signals.
        sizes: Natural sizes of the states, shape (nx,).
    """
    problem = shooting.problem
    finite = np.isfinite(states).all(axis=0)
    count = int(np.argmin(finite)) if not finite.all() else finite.size
    times = problem.times[:: problem.checks][:-1]
    nothing = Growth(0.0, 0.0, 0.0, 0.0, 0.0)
    if not count:
        return nothing
    _, parameters, flat = shared_arguments(problem, states[:, 0], known)
    signals = signals_between(problem, at_nodes(problem, flat), times)
    slopes = shooting.rate_slopes
    # With a free end time the core's horizon is 1: its rates are per horizon.
    whole = shooting.lowered.end_time(states[:, 0]) / problem.length
    best, deviation, log, begin = nothing, np.eye(sizes.size), 0.0, 0.0
    fastest = (0.0, 0.0)
    for k in range(count):
        given = states[:, k], controls[:, k], parameters, signals[: problem.model.ns, k]
        with np.errstate(over="ignore", invalid="ignore"):  # No number: see below.
            A = np.array(slopes(*given)) * sizes / sizes[:, None]
        if not np.isfinite(A).all():
            break
        time = float(times[k]) * whole
        rate = float(np.linalg.eigvals(A).real.max()) / whole
        if rate > (1 + 1e-9) * fastest[0]:  # The first of equal ones.
            fastest = rate, time
        step = A * problem.dt
        norm = float(np.linalg.norm(step))
        step *= min(1.0, _STEEPEST / max(norm, 1e-300))
        deviation = exponential(step) @ deviation
        size = max(float(np.linalg.norm(deviation, 2)), 1e-300)
        log, deviation = log + math.log(size), deviation / size
        if log > best.log:
            best = Growth(log, begin, time + problem.dt * whole, 0.0, 0.0)
        if log < 0.0:  # A later deviation grows more.
            log, deviation, begin = 0.0, np.eye(sizes.size), time + problem.dt * whole
    return best._replace(rate=fastest[0], time=fastest[1])


def exponential(A: Array) -> Array:
    """Return e^A of a small matrix of moderate norm, by its series for A / 2^k.

    SciPy's function takes a thousand times as long while other work runs: its threads
    wait for each other.

    Args:
        A: The matrix, shape (n, n), finite.
    """
    halvings = max(0, math.ceil(math.log2(max(float(np.linalg.norm(A)), 0.5))) + 1)
    part, one = A / 2.0**halvings, np.eye(len(A))
    found = one
    for order in range(_ORDERS, 0, -1):  # Horner's scheme.
        found = one + part @ found / order
    for _ in range(halvings):
        found = found @ found
    return found


def _too_fast(
    problem: OptimalControlProblem, time: float, values: NDArray[np.complex128]
) -> FastMode | None:
    """Return the fastest of the decaying modes that grow from step to step."""
    step = problem.dt / problem.checks / problem.substeps
    method = INTEGRATORS[problem.integrator]
    with np.errstate(over="ignore", invalid="ignore"):
        growth = np.abs(polyval(step * values, method.growth))
    # Not `growth > 1`: NaN, after an overflow, is growth as well.
    grows = (values.real < 0) & ~(growth <= 1)
    if not grows.any():
        return None
    fastest = values[grows][np.argmax(np.abs(values[grows]))]
    rate = float(np.abs(fastest))
    needed = np.ceil(problem.substeps * rate * step / method.stable)
    if not np.isfinite(needed):
        return None
    return FastMode(
        time=time,
        rate=rate,
        growth=float(np.log(np.nan_to_num(growth[grows], nan=np.inf).max())),
        # Advice to keep the present number would help nothing.
        substeps=max(int(needed), problem.substeps + 1),
        is_stiff=bool(abs(fastest.real) >= abs(fastest.imag)),
    )
