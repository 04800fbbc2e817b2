"""The margins of a held input: error of its map against the flow, growth of e'Pe.

    c with |flow - map|_P <= c |e|_P        proven (`flow_error.py`)
    g with V(map at any time) <= g V        proven (`growth.py`); then
                                            V(flow) <= (sqrt(g) + c)^2 V

A level at which c would use up the decrease is lowered until it does not. A statement
proven for one level holds for every smaller one.
"""

from __future__ import annotations

import time as clock
from dataclasses import dataclass, replace

import numpy as np

from swarmstart.terminal_set.certificates.certificate import HeldMargins
from swarmstart.terminal_set.certificates.evidence import (
    CoarseHoldError,
    Refutation,
    UnprovenSetError,
)
from swarmstart.terminal_set.proving.decrease import Change
from swarmstart.terminal_set.proving.drift import linear_decrease
from swarmstart.terminal_set.proving.flow_error import FlowError, prove_flow_error
from swarmstart.terminal_set.proving.growth import prove_growth
from swarmstart.terminal_set.proving.held_motion import HeldMotion
from swarmstart.terminal_set.proving.refutation import refuted_level

ENOUGH = 0.005
"""Margin, relative to the linear decrease, that hardly lowers the level."""
AFFORDABLE = 0.5
"""Margin, relative to the linear decrease, that leaves too little of it."""
HALVINGS = 40
"""Largest number of halvings of a level at which the model is undefined, e'Pe does not
decrease, or no affordable margin is proven."""
CLOSE = 1.05
"""Ratio of a level without an affordable margin and one with it at which to stop."""
SHARE = 0.25
"""Fraction of the remaining time for each attempt at a margin."""
GROWTH_RESERVE = 1.1
LEAST_GROWTH = 1.05
ROOMIER = 2.0
"""Factor by which the stated growth is larger, if bounds allow it: faster to prove."""
SHRUNK = 1 - 1e-9
"""Factor for the growth that the states' bounds allow, for its rounding."""


@dataclass(frozen=True, kw_only=True, slots=True)
class HoldBounds:
    """Limits of a level other than the decrease.

    Attributes:
        inputs: The level of the bounds of the inputs.
        states: The level of the bounds of the states, at all times.
        drift: Motion of the reference relative to e, a fraction (`drift.py`).
    """

    inputs: float
    states: float
    drift: float


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ProvableHold:
    """A decrease to be proven for a held input, with its margins.

    Attributes:
        motion: The motion.
        change: c, the margins of integrator and drift included.
        top: The level within all bounds, those between the samples included, up to
            which the integrator's error is proven; the refuted level if that is lower.
        margins: The proven error and the measured growth.
        refutation: Counterexample of the map without a margin, within the bounds; None
            if none is known.
    """

    motion: HeldMotion
    change: Change
    top: float
    margins: HeldMargins
    refutation: Refutation | None


def provable_hold(
    motion: HeldMotion,
    change: Change,
    bounds: HoldBounds,
    *,
    rng: np.random.Generator,
    until: float,
) -> ProvableHold:
    """Return the margins, and the largest level at which they are affordable.

    Args:
        motion: The motion.
        change: c of its map, without the margins of integrator and drift.
        bounds: Levels of the bounds.
        rng: Source of randomness of samples and rays.
        until: Time of `time.perf_counter` at which proofs of the integrator's error
            stop [s].

    Raises:
        UnprovenSetError: If no level can be proven.
    """
    top = min(bounds.inputs, bounds.states)
    growth, falls = motion.measured(top, rng)
    refutation = None
    if not falls:
        refutation = refuted_level(change, alpha_max=top, rng=rng)
        top = top if refutation is None else refutation.alpha
        growth, falls = motion.measured(top, rng)
    for _ in range(HALVINGS):
        if np.isfinite(growth) and (falls or refutation is not None):
            break
        top /= 2
        growth, falls = motion.measured(top, rng)
    top, error = _affordable_error(motion, top, linear_decrease(change), until)
    c = error.relative + bounds.drift
    least = max(LEAST_GROWTH, GROWTH_RESERVE * growth)
    top = min(top, bounds.states / (least**0.5 + c) ** 2)
    room = SHRUNK * max((bounds.states / top) ** 0.5 - c, 0.0) ** 2
    margins = HeldMargins(
        substeps=len(motion.holds),
        integrator_error=error.relative,
        boxes=error.boxes,
        growth=max(least, min(ROOMIER * least, room)),
        growth_is_proven=False,
    )
    return ProvableHold(
        motion=motion,
        change=replace(change, Q_m=change.Q_m + (2 * c + c**2) * change.P),
        top=top,
        margins=margins,
        refutation=refutation,
    )


def with_proven_growth(
    hold: ProvableHold, alpha: float, *, max_seconds: float
) -> HeldMargins:
    """Return the margins of a hold, and whether its growth is proven.

    Args:
        hold: The hold.
        alpha: The level, at most the one up to which its error is proven.
        max_seconds: Time for the proof [s].
    """
    until = clock.perf_counter() + max_seconds
    for one in hold.motion.holds:
        left = until - clock.perf_counter()
        proof = prove_growth(one, alpha, hold.margins.growth, max_seconds=left)
        if not proof.proven:
            return hold.margins
    return replace(hold.margins, growth_is_proven=True)


def _affordable_error(
    motion: HeldMotion, top: float, decrease: float, until: float
) -> tuple[float, FlowError]:
    """Prove the integrator's error up to the largest level at which it is affordable.

    Returns:
        The level and the error there.

    Raises:
        UnprovenSetError: If there is no decrease at all.
        CoarseHoldError: If the error is not affordable at any level that was tried.
    """
    if not decrease > 0:
        raise UnprovenSetError(top, None, until - clock.perf_counter())

    def error_at(alpha: float) -> tuple[FlowError, bool]:
        now = clock.perf_counter()
        error = prove_flow_error(
            motion.residual,
            alpha,
            enough=ENOUGH * decrease / 2,
            useless=AFFORDABLE * decrease / 2,
            until=now + SHARE * (until - now),
        )
        c = error.relative
        return error, bool(2 * c + c**2 <= AFFORDABLE * decrease)

    low, began = top, clock.perf_counter()
    error, is_affordable = error_at(low)
    for _ in range(HALVINGS):
        if is_affordable or clock.perf_counter() > until:
            break
        low /= 2
        error, is_affordable = error_at(low)
    if not is_affordable:
        seconds = clock.perf_counter() - began
        raise CoarseHoldError(low, None, seconds, len(motion.holds))
    high = min(2 * low, top)
    while high > CLOSE * low and clock.perf_counter() < until:
        middle = (low * high) ** 0.5
        found, is_affordable = error_at(middle)
        if is_affordable:
            low, error = middle, found
        else:
            high = middle
    return low, error
