"""Checks before a proof: the reference rests, and a held loop is stable and accurate.

A reference rests, or it moves in states for which it states a velocity: f does not
depend on these states, they have no bounds, and deviations are relative to the
reference that moves as f says. A reference is given in floats, so that the rates
r = f(x_ref, u_ref) of the other states need not be 0. The motion of the deviation e is
the relative one plus a drift. Let R(e) be the rate of e in the relative motion
(continuous), or e after a hold (held), c(e) the change of V(e) = e'Pe by it
(`decrease.py`), and |e|_P the root of V(e):

    continuous   e' = R(e) + r           V' <= c(e) + 2 |r|_P |e|_P
    held         e+ = R(e) + d           |e+|_P <= |R(e)|_P + |d|_P

d is the motion of the reference in a hold, for the Runge-Kutta map and for the flow.
With D = |r|_P (continuous) or |d|_P (held) and a number a, the relative drift, every
statement that is proven with

    continuous   c(e) + 2 a V(e) < 0
    held         (|R(e)|_P + a |e|_P)^2 < V(e)

holds with the drift, too, for |e|_P >= D / a, and no trajectory crosses
V(e) = (D / a)^2 from within. So a set is stated with a core, V(e) <= core = (D / a)^2,
in which the decrease is not claimed. A core above MOST_CORE of the level is refused:
then the reference is not an equilibrium on the scale of the set.

For a held input, nothing can be proven if the linear loop is unstable, or if the
Runge-Kutta map is too far from the flow.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.certificates.design import TerminalSet
from swarmstart.terminal_set.interval_arithmetic.intervals import (
    UnknownIntervalOperationError,
    interval_function,
)
from swarmstart.terminal_set.interval_arithmetic.tape import tape_of
from swarmstart.terminal_set.linear.arrays import NotFiniteError, finite_array
from swarmstart.terminal_set.linear.ellipsoid import MovingReferenceError, Reference
from swarmstart.terminal_set.linear.linearisation import (
    held_spectral_radius,
    hold,
    runge_kutta_hold,
)
from swarmstart.terminal_set.proving.decrease import Change

MOST_CORE = 1e-6
"""Largest core, relative to the level: a thousandth of the set's radius."""
LEAST_CORE = 1e-24
"""Least core, relative to the level: far below rounding, but without underflow."""
MOST_SHARE = 5e-4
"""Largest fraction of the linear decrease that a drift may use."""
LEAST_SHARE = 1e-9
ROOM = 1e-6
"""Radius of a core that can be chosen, relative to that of the bounds' level."""
RESERVE = 2.0
"""Factor by which the core is larger than the drift needs, for rounding."""
ROUNDING = 1 + 1e-9
SAME_VELOCITY = 1e-9
"""Largest difference of a stated velocity and the reference's own, relative to it."""
MOST_BITS = 20_000
"""Length of a fraction beyond which a rate counts as inexact."""
ROUNDS = 60
"""Largest number of times that a box is widened until the motion stays in it."""

MOST_SUBSTEPS = 2**20
"""Largest number of Runge-Kutta steps in a hold that is tried for a recommendation."""


@dataclass(eq=False)
class NotAnEquilibriumError(SwarmstartError, ValueError):
    """A reference is not an equilibrium in states that it does not declare to move.

    Attributes:
        entries: Entries of x_ref that move although no velocity is stated for them.
        rates: Rates of these entries, from f(x_ref, u_ref).
        core: Level of e'Pe up to which this motion may cancel the decrease.
        level: Level of the set.
    """

    entries: tuple[int, ...]
    rates: tuple[float, ...]
    core: float
    level: float

    def __str__(self) -> str:
        """Return a message with the entries and the core."""
        moving = ", ".join(
            f"xdot[{entry}] = {rate:.6g}"
            for entry, rate in zip(self.entries, self.rates, strict=True)
        )
        return (
            f"x_ref and u_ref are no equilibrium: {moving} there. A reference that "
            "moves states its velocity, in states on which the dynamics do not depend. "
            f"This motion leaves V <= {self.core:.3g} undecided, of a set "
            f"V <= {self.level:.3g}"
        )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Drift:
    """The motion of a reference that the proof of its set allows for.

    Attributes:
        entries: Numbers of the states that the drift moves.
        rates: Entries of f(x_ref, u_ref) for these states.
        size: Upper bound D of the length of the drift per second [1/s], or per hold for
            a held input; the length of a vector v is |v|_P, the root of v'Pv.
        relative: A number a: the proof leaves room for a drift of a |e|_P at the
            deviation e; in 1/s, or a fraction per hold for a held input.
    """

    entries: tuple[int, ...]
    rates: tuple[float, ...]
    size: float
    relative: float

    def core_of(self, alpha: float) -> float:
        """Return the level e'Pe up to which the drift may cancel a set's decrease.

        The set below this level is called the core. The level is 0 for an exact
        equilibrium.

        Raises:
            NotAnEquilibriumError: If the core is too large compared with the set.
        """
        if self.size == 0:
            return 0.0
        radius = RESERVE * self.size / self.relative if self.relative > 0 else np.inf
        if not radius**2 <= MOST_CORE * alpha:
            raise NotAnEquilibriumError(self.entries, self.rates, radius**2, alpha)
        return max(radius**2, LEAST_CORE * alpha)


class ReferenceMotion:
    """The motion of a reference in states that should rest.

    Attributes:
        entries: Numbers of the states that move although they should rest.
        rates: Entries of f(x_ref, u_ref) for these states.
        bound: Upper bounds of |f| at the reference, rounding included; 0 for the states
            that have a stated velocity, shape (nx,).
    """

    def __init__(self, dynamics: ca.Function, reference: Reference) -> None:
        """Evaluate f at the reference.

        Raises:
            MovingReferenceError: If it moves in a state on which f depends, or not
                with its stated velocity.
            NotFiniteError: If f is NaN or infinite there.
            UnknownIntervalOperationError: If f has an operation without interval form.
        """
        xdot = np.array(dynamics(reference.x_ref, reference.u_ref)).ravel()
        xdot = finite_array("the rate at the reference", xdot, (None,))
        # Both are inputs: CasADi would round what depends on a constant u_ref alone.
        x, u = ca.SX.sym("x", xdot.size), ca.SX.sym("u", reference.u_ref.size)
        rate = ca.Function("rate", [ca.vertcat(x, u)], [dynamics(x, u)])
        self._evaluate = interval_function(rate)
        self._at = np.concatenate([reference.x_ref, reference.u_ref])
        self._rests = reference.rates == 0
        _require_velocity(dynamics, reference, xdot)
        is_zero = [value == 0 for value in exact_rates(dynamics, reference)]
        self.bound = np.where(is_zero, 0.0, self._fastest(np.zeros(xdot.size)))
        moving = np.flatnonzero(self.bound)
        self.entries = tuple(int(entry) for entry in moving)
        self.rates = tuple(float(xdot[entry]) for entry in moving)

    def over_hold(self, dt: float, substeps: int) -> Array:
        """Bound the motion of the reference over a hold, by the map and the exact flow.

        On every step, of the length h, a box is widened until h sup |f| over the box is
        at most the width that was added: then the exact flow and every stage of the
        Runge-Kutta map stay in the box.

        Args:
            dt: Time for which the input is held [s].
            substeps: Number of Runge-Kutta steps in a hold.

        Returns:
            Upper bounds, shape (nx,); infinite if no such box was found.
        """
        moved, h = np.zeros(self.bound.size), dt / substeps
        for _ in range(substeps if self.entries else 0):
            growth = ROUNDING * h * self._fastest(moved)
            for _ in range(ROUNDS):
                needed = ROUNDING * h * self._fastest(moved + growth)
                if np.all(needed <= growth):
                    break
                growth = 1.5 * needed  # A wider box may need more again.
            else:
                return np.full(moved.size, np.inf)
            moved = ROUNDING * (moved + growth)
        return moved

    def _fastest(self, around: Array) -> Array:
        """Return upper bounds of |f| within `around` of x_ref; 0 for moving states."""
        reach = np.zeros(self._at.size)
        reach[: around.size] = around
        # Outwards: an end is rounded by half a unit of x_ref.
        reach += np.where(reach > 0, 4 * np.spacing(np.abs(self._at)), 0.0)
        low, high = self._evaluate(
            (self._at - reach)[:, None], (self._at + reach)[:, None]
        )
        fastest = np.maximum(np.abs(low), np.abs(high))[:, 0]
        return np.where(self._rests, fastest, 0.0)


def exact_rates(dynamics: ca.Function, reference: Reference) -> list[Fraction | None]:
    """Return f(x_ref, u_ref) as fractions; None for rates that are no short fractions.

    Intervals widen each result, and so cannot show that a reference is exactly at rest.

    Args:
        dynamics: f(x, u) -> xdot.
        reference: The reference.
    """
    try:
        tape, xdot = tape_of(dynamics)
    except UnknownIntervalOperationError:
        return [None] * reference.x_ref.size
    inputs = {"x": reference.x_ref, "u": reference.u_ref}
    values: list[Fraction | None] = []
    for operation, *operands in tape:
        if operation == "const":
            number = float(operands[0])
            values.append(Fraction(number) if np.isfinite(number) else None)
        elif operation in inputs:
            values.append(Fraction(float(inputs[str(operation)][int(operands[0])])))
        else:
            arguments = [values[int(number)] for number in operands]
            values.append(_exactly(str(operation), arguments))
    return [values[number] for number in xdot]


def _exactly(operation: str, arguments: list[Fraction | None]) -> Fraction | None:
    """Return the result of an operation, None if it is not known exactly."""
    known = [value for value in arguments if value is not None]
    if len(known) < len(arguments):
        return None
    value = known[0]
    if operation in _EXACT_AT:
        at, there = _EXACT_AT[operation]
        return Fraction(there) if value == at else None
    if operation in _EXACT:
        try:
            result = _EXACT[operation](*known)
        except ZeroDivisionError:
            return None
        # A long chain of products takes twice the digits at each link.
        parts = result.numerator, result.denominator
        return result if max(p.bit_length() for p in parts) <= MOST_BITS else None
    return None


_EXACT: dict[str, Callable[..., Fraction]] = {
    "add": operator.add, "sub": operator.sub, "mul": operator.mul,
    "div": operator.truediv, "neg": operator.neg, "fabs": abs, "fmin": min, "fmax": max,
    "sq": lambda a: a * a, "twice": lambda a: 2 * a, "inv": lambda a: 1 / a,
}  # fmt: skip
_EXACT_AT = {
    "sin": (0, 0), "tan": (0, 0), "atan": (0, 0), "tanh": (0, 0), "sqrt": (0, 0),
    "exp": (0, 1), "cos": (0, 1), "log": (1, 0),
}  # fmt: skip
"""Function -> a point at which its value is a fraction, and that value."""


def _require_velocity(dynamics: ca.Function, reference: Reference, xdot: Array) -> None:
    """Validate that a reference can move with its stated velocity."""
    felt = set(dynamics.jac_sparsity(0, 0).T.get_triplet()[0])
    for entry in np.flatnonzero(reference.rates).tolist():
        velocity, rate = float(reference.rates[entry]), float(xdot[entry])
        if entry in felt:
            raise MovingReferenceError(entry, velocity, "on which the dynamics depend")
        if not abs(rate - velocity) <= SAME_VELOCITY * abs(velocity):
            raise MovingReferenceError(entry, velocity, f"whose rate is {rate:.12g}")


def bearable_drift(
    motion: ReferenceMotion, moved: Array, change: Change, alpha_max: float
) -> Drift:
    """Choose the drift that a proof allows for the motion of a reference.

    Args:
        motion: The motion of the reference.
        moved: Upper bounds of how far each state of the reference moves, per second,
            or per hold for a held input, shape (nx,), >= 0.
        change: The change of e'Pe without the drift.
        alpha_max: Level that the bounds allow: no set is larger.

    Returns:
        The drift; it costs at most MOST_SHARE of the decrease near the reference.

    Raises:
        NotAnEquilibriumError: If the motion is too large for any level up to alpha_max.
    """
    with np.errstate(invalid="ignore"):
        # |d|_P is at most the sum of the |d_j| sqrt(P_jj).
        parts = np.where(moved > 0, moved * np.sqrt(np.diag(change.P)), 0.0)
    size = float(ROUNDING * parts.sum())
    decay = linear_decrease(change)
    wanted = RESERVE * size / (ROOM * np.sqrt(alpha_max))
    relative = np.clip(wanted, LEAST_SHARE * decay, MOST_SHARE * decay)
    drift = Drift(
        entries=motion.entries,
        rates=motion.rates,
        size=size,
        relative=float(relative) if size > 0 else 0.0,
    )
    if decay > 0:  # Otherwise nothing can be proven for any reference.
        drift.core_of(alpha_max)
    return drift


def linear_decrease(change: Change) -> float:
    """Return the least relative decrease of V(e) = e'Pe near e = 0.

    It is 0 if V does not decrease in every direction.

    Returns:
        The decay in 1/s, or a fraction per hold if held; from floats, not proven.
    """
    e = ca.SX.sym("e", len(change.P))
    hessian = ca.Function("hessian", [e], [ca.hessian(change.function(e), e)[0]])
    root = np.linalg.inv(np.linalg.cholesky(change.P))
    form: Array = root @ np.array(hessian(0)) @ root.T / 2
    return max(-float(np.linalg.eigvalsh((form + form.T) / 2)[-1]), 0.0)


@dataclass(eq=False)
class HeldTooLongError(SwarmstartError, ValueError):
    """A gain is unstable when its input is held for this time.

    Attributes:
        dt: Time for which the input is held [s].
        spectral_radius: Spectral radius of the held loop.
        longest: Longest time for which the held loop is stable [s].
    """

    dt: float
    spectral_radius: float
    longest: float

    def __str__(self) -> str:
        """Return a message with the longest stable time."""
        return (
            f"the gain is unstable when its input is held for {self.dt:g} s: the "
            f"spectral radius is {self.spectral_radius:.4g}; it is stable up to "
            f"{self.longest:.3g} s, and a sampled design for any dt"
        )


@dataclass(eq=False)
class TooFewSubstepsError(SwarmstartError, ValueError):
    """The Runge-Kutta map of a hold is too far from the flow for any proof.

    Attributes:
        substeps: Number of Runge-Kutta steps in a hold.
        factor: Largest factor by which the map changes the length of a small deviation.
        error: Largest difference of map and flow for a small deviation, relative to its
            length.
        enough: Number of steps that is enough for small deviations; None if it is above
            `MOST_SUBSTEPS`.
    """

    substeps: int
    factor: float
    error: float
    enough: int | None

    def __str__(self) -> str:
        """Return a message with the number of steps that is enough."""
        advice = "shorten the hold"
        if self.enough is not None:
            advice = f"use ProofOptions(substeps={self.enough}) or more"
        return (
            f"substeps={self.substeps} is too few: near the reference one hold "
            f"multiplies deviations by {self.factor:.3g} in the Runge-Kutta map, with "
            f"an error of {self.error:.3g} against the flow, and the sum must stay "
            f"below 1; {advice}"
        )


def require_enough_substeps(
    A: Array, B: Array, law: TerminalSet, *, dt: float, substeps: int
) -> None:
    """Validate that some level can be proven with a Runge-Kutta map.

    The linear parts of map and exact flow over a hold are compared; the length of a
    deviation e is the root of e'Pe. If the flow shortens every deviation, then the
    largest factor by which the map changes a length, plus the map's largest error
    relative to the length, must be below 1.

    Raises:
        TooFewSubstepsError: If the sum is not below 1.
        NotPositiveError: If dt is not positive and finite.
    """
    root = np.linalg.cholesky(law.P).T
    Ad, Bd = hold(A, B, dt)
    flow = Ad - Bd @ law.K

    def length(matrix: Array) -> float:
        if not np.all(np.isfinite(matrix)):
            return float("inf")
        # Of root M root^-1, in whose coordinates |e|_P is the length.
        return float(np.linalg.norm(root @ np.linalg.solve(root.T, matrix.T).T, 2))

    def factor_and_error(substeps: int) -> tuple[float, float]:
        try:
            Ad, Bd = runge_kutta_hold(A, B, dt, substeps=substeps)
        except NotFiniteError:
            return float("inf"), float("inf")
        map_ = Ad - Bd @ law.K
        return length(map_), length(map_ - flow)

    factor, error = factor_and_error(substeps)
    # If the flow itself lengthens a deviation, more steps do not help.
    if factor + error < 1 or not length(flow) < 1:
        return
    enough = substeps
    while enough <= MOST_SUBSTEPS and not sum(factor_and_error(enough)) < 1:
        enough *= 2
    tried = enough if enough <= MOST_SUBSTEPS else None
    raise TooFewSubstepsError(substeps, factor, error, tried)


def require_stable_hold(A: Array, B: Array, K: Array, dt: float) -> None:
    """Validate that a gain is stable when its input is held for a time [s].

    Raises:
        HeldTooLongError: If the held loop has a spectral radius of 1 or more.
        NotPositiveError: If dt is not positive and finite.
    """
    radius = held_spectral_radius(A, B, K, dt)
    if radius < 1:
        return
    stable, unstable = 0.0, dt
    for _ in range(40):
        middle = (stable + unstable) / 2
        if held_spectral_radius(A, B, K, middle) < 1:
            stable = middle
        else:
            unstable = middle
    raise HeldTooLongError(dt, radius, stable)
