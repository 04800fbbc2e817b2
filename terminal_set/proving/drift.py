"""Drift: the residual of f at a reference, and the core that it leaves undecided.

A reference is given in floats, so f(x_ref, u_ref) = r need not be 0 there. Entries on
which f does not depend, and which have no bounds, may move; deviations are then
relative to the moved reference. All other entries are constant, and the motion is the
relative one (`decrease.py`) plus a drift, with |e|_P the root of e'Pe:

    continuous   e' = R(e) + r           V' <= c(e) + 2 |r|_P |e|_P
    held         e+ = R(e) + d           |e+|_P <= |R(e)|_P + |d|_P

d is the motion of the reference in a hold, for the Runge-Kutta map and for the flow.
With D = |r|_P or |d|_P and a relative drift a, every statement proven with the margin

    2 a V(e)                             instead of the drift, continuous
    (|R(e)|_P + a |e|_P)^2 < V(e)        likewise, held

holds with the drift for |e|_P >= D / a, and no trajectory crosses V(e) = (D / a)^2 from
within. So a set is stated with its core, V(e) <= core. A core above MOST_CORE of the
level is refused: then the reference is not an equilibrium on the scale of the set.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.interval_arithmetic.intervals import interval_function
from swarmstart.terminal_set.linear.arrays import Mask, finite_array
from swarmstart.terminal_set.linear.reference import Reference
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
ROUNDS = 60
"""Largest number of times that a box is widened until the motion stays in it."""


@dataclass(eq=False)
class NotAnEquilibriumError(SwarmstartError, ValueError):
    """A reference is not an equilibrium in states that must be constant.

    Attributes:
        entries: Entries of x_ref that move although f depends on them or they have
            bounds.
        rates: Their rates, of f(x_ref, u_ref).
        core: Level of the core that this motion leaves undecided.
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
            f"x_ref and u_ref are no equilibrium: {moving} there, and the dynamics "
            "depend on these states or they have bounds; only other states may move "
            f"along the reference. This motion leaves V <= {self.core:.3g} undecided, "
            f"of a set V <= {self.level:.3g}"
        )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Drift:
    """The motion of a reference that the proof of its set allows for.

    Attributes:
        entries: States that it moves.
        rates: f(x_ref, u_ref) of these.
        size: D, an upper bound of |r|_P [1/s] or of |d|_P.
        relative: a, the relative drift of the proof; in 1/s, or a fraction per hold for
            a held input.
    """

    entries: tuple[int, ...]
    rates: tuple[float, ...]
    size: float
    relative: float

    def core_of(self, alpha: float) -> float:
        """Return the level of the core of a set; 0 for an exact equilibrium.

        Args:
            alpha: Level of the set.

        Raises:
            NotAnEquilibriumError: If the core is too large compared with the set.
        """
        if self.size == 0:
            return 0.0
        radius = RESERVE * self.size / self.relative if self.relative > 0 else np.inf
        if not radius**2 <= MOST_CORE * alpha:
            raise NotAnEquilibriumError(self.entries, self.rates, radius**2, alpha)
        return max(radius**2, LEAST_CORE * alpha)


def resting(dynamics: ca.Function, *, is_bounded: Mask) -> Mask:
    """Return which states must rest: f depends on them, or they have bounds.

    Args:
        dynamics: f(x, u) -> xdot.
        is_bounded: Which states have bounds, shape (nx,).
    """
    felt = dynamics.jac_sparsity(0, 0).T.get_triplet()[0]
    rests = np.array(is_bounded)
    rests[np.array(felt, dtype=int)] = True
    return rests


class ReferenceMotion:
    """The motion of a reference in states that should rest.

    Attributes:
        entries: States that should rest: f depends on them, or they have bounds.
        rates: f(x_ref, u_ref) of them.
        bound: Upper bounds of |f| there, rounding included; 0 for the other states,
            shape (nx,).
    """

    def __init__(self, dynamics: ca.Function, reference: Reference) -> None:
        """Evaluate f at the reference.

        Raises:
            NotFiniteError: If f is NaN or infinite there.
            UnknownIntervalOperationError: If f has an operation without interval form.
        """
        xdot = np.array(dynamics(reference.x_ref, reference.u_ref)).ravel()
        xdot = finite_array("the rate at the reference", xdot, (None,))
        x = ca.SX.sym("x", reference.x_ref.size)
        rate = ca.Function("rate", [x], [dynamics(x, ca.DM(reference.u_ref))])
        self._evaluate, self._x_ref = interval_function(rate), reference.x_ref
        self._rests = resting(dynamics, is_bounded=np.isfinite(reference.e_max))
        self.bound = self._fastest(np.zeros(x.numel()))
        moving = np.flatnonzero(self.bound)
        self.entries = tuple(int(entry) for entry in moving)
        self.rates = tuple(float(xdot[entry]) for entry in moving)

    def over_hold(self, dt: float, substeps: int) -> Array:
        """Bound the motion of the reference over a hold, for the map and the flow.

        On every step a box is widened until h sup |f| over it is at most its growth:
        then the flow and every stage of the map stay in it.

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
                growth = 1.5 * needed
            else:
                return np.full(moved.size, np.inf)
            moved = ROUNDING * (moved + growth)
        return moved

    def _fastest(self, around: Array) -> Array:
        """Return upper bounds of |f| within `around` of x_ref; 0 for free states."""
        # Outwards: an end is rounded by half a unit of x_ref.
        slack = np.where(around > 0, 4 * np.spacing(np.abs(self._x_ref)), 0.0)
        reach = around + slack
        low, high = self._evaluate(
            (self._x_ref - reach)[:, None], (self._x_ref + reach)[:, None]
        )
        fastest = np.maximum(np.abs(low), np.abs(high))[:, 0]
        return np.where(self._rests, fastest, 0.0)


def bearable_drift(
    motion: ReferenceMotion, moved: Array, change: Change, alpha_max: float
) -> Drift:
    """Choose the drift that a proof allows for the motion of a reference.

    Args:
        motion: The motion of the reference.
        moved: Upper bounds of |r| or |d|, shape (nx,), >= 0.
        change: The change of V without the drift.
        alpha_max: Level of the bounds: no set is larger.

    Returns:
        The drift; it costs at most MOST_SHARE of the decrease near the reference.

    Raises:
        NotAnEquilibriumError: If the motion is too large for any level up to alpha_max.
    """
    with np.errstate(invalid="ignore"):
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
    """Return the least relative decrease of V near the centre; 0 if there is none.

    Args:
        change: The change of V.

    Returns:
        The decay in 1/s, or a fraction per hold if held; from floats, not proven.
    """
    e = ca.SX.sym("e", len(change.P))
    hessian = ca.Function("hessian", [e], [ca.hessian(change.function(e), e)[0]])
    root = np.linalg.inv(np.linalg.cholesky(change.P))
    form: Array = root @ np.array(hessian(0)) @ root.T / 2
    return max(-float(np.linalg.eigvalsh((form + form.T) / 2)[-1]), 0.0)
