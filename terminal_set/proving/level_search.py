"""Search for the largest level that can be proven.

    bounds     the requested level is tried first: it is proven, or a counterexample met
    refuted    the nearest counterexample, of the proof or of a search for it, is an
               upper limit of all levels that can be proven
    downwards  fractions of that, until one is proven: the model may be undefined, or
               have thin features that samples miss
    upwards    levels between the highest proven and the lowest unproven one

until the two are within TIGHT of each other or time is up. A level counts as unproven
after MORE_BOXES times the boxes of the last proof.
"""

from __future__ import annotations

import time as clock
from dataclasses import dataclass

import numpy as np

from swarmstart.arrays import Array
from swarmstart.terminal_set.certificates.evidence import Proof, Refutation
from swarmstart.terminal_set.proving.decrease import Change
from swarmstart.terminal_set.proving.proof import prove_level
from swarmstart.terminal_set.proving.refutation import refuted_level

FIRST_SHARE = 0.92
"""Fraction of the refuted level that is tried first: with six states more takes too
long."""
NEARER_SHARE = 0.99
"""Fraction of a level refuted by a state that is tried next."""
LOWER_SHARES = (0.54, 0.25)
"""Fractions of an unproven level that are tried next; the last one repeatedly."""
SMALLEST_SHARE = 1e-12
"""Smallest level, relative to the first, down to which levels are quartered. A smaller
one takes hardly less time to prove; if the model is undefined somewhere in a larger
one, that shows at once."""
TIGHT = 1.011
"""Ratio of the lowest unproven level and the proven one at which the search ends."""
MORE_BOXES = 10
FEW_BOXES = 50_000
"""Number of boxes that every proof may take."""
MOST_BOXES = 100_000_000
"""Largest number of boxes of a first proof, which ends by time in practice."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ProvenLevel:
    """The largest level that could be proven.

    Attributes:
        proof: Proof of the largest proven level, or the last attempt if none was
            proven.
        refutation: The nearest counterexample below the requested level; None if none
            was found.
    """

    proof: Proof
    refutation: Refutation | None

    @property
    def alpha(self) -> float:
        """The proven level; 0 if no level was proven."""
        return self.proof.alpha if self.proof.proven else 0.0


def proven_level(
    change: Change,
    alpha_max: float,
    *,
    rng: np.random.Generator,
    max_seconds: float = 60.0,
) -> ProvenLevel:
    """Prove the largest possible level up to a given one.

    Args:
        change: Change from `continuous_change` or `held_change`.
        alpha_max: The requested level, > 0: that of the bounds.
        rng: Source of randomness of the rays that look for a counterexample.
        max_seconds: Time for all proofs together [s].

    Returns:
        The requested level if it is proven, else the largest one that was; unproven if
        none was.

    Raises:
        SwarmstartError: As `refuted_level` and `prove_level` say.
    """
    search = _LevelSearch(change, alpha_max, clock.perf_counter() + max_seconds)
    # For a level that cannot be proven, a counterexample is usually found at once.
    if not search.proves(alpha_max, 0.25):
        search.refute(refuted_level(change, alpha_max=alpha_max, rng=rng))
        search.descend()
        search.tighten()
    return search.level


class _LevelSearch:
    """The highest proven level, the lowest unproven one, the nearest counterexample.

    Attributes:
        level: The result so far.
    """

    def __init__(self, change: Change, alpha_max: float, until: float) -> None:
        """Begin without any proven or refuted level."""
        self._change, self._alpha_max, self._until = change, alpha_max, until
        self._unproven, self._is_broken = alpha_max, False  # By a state.
        self._proof: Proof | None = None
        self._refutation: Refutation | None = None

    @property
    def level(self) -> ProvenLevel:
        """The result so far."""
        if self._proof is None:
            raise TypeError("expected a level that was tried")
        return ProvenLevel(proof=self._proof, refutation=self._refutation)

    def proves(self, alpha: float, share: float, boxes: int = MOST_BOXES) -> bool:
        """Try to prove a level, in a fraction of the remaining time."""
        left = (self._until - clock.perf_counter()) * share
        proof = prove_level(self._change, alpha, max_boxes=boxes, max_seconds=left)
        if proof.proven or self._proof is None or not self._proof.proven:
            self._proof = proof
        if not proof.proven:
            self._unproven, self._is_broken = alpha, False
            if proof.counterexample is not None:
                self._break(proof.counterexample)
        return proof.proven

    def refute(self, refutation: Refutation | None) -> None:
        """Take a counterexample into account."""
        if refutation is None:
            return
        if refutation.alpha <= self._unproven:
            self._unproven, self._is_broken = refutation.alpha, True
        if self._refutation is None or refutation.alpha < self._refutation.alpha:
            self._refutation = refutation

    def descend(self) -> None:
        """Try lower and lower levels until one is proven."""
        if self.proves(FIRST_SHARE * self._unproven, 0.7):
            return
        shares = iter(LOWER_SHARES)
        share = next(shares)
        while not self._is_late and self._unproven > SMALLEST_SHARE * self._alpha_max:
            if self.proves(share * self._unproven, 0.5):
                return
            share = next(shares, share)

    def tighten(self) -> None:
        """Try levels between the highest proven and the lowest unproven one."""
        while not self._is_late:
            proof = self.level.proof
            if not proof.proven or self._unproven <= TIGHT * proof.alpha:
                return
            alpha = float(np.sqrt(proof.alpha * self._unproven))
            if self._is_broken:
                alpha = max(alpha, NEARER_SHARE * self._unproven)
            self.proves(alpha, 1.0, max(MORE_BOXES * proof.boxes, FEW_BOXES))

    @property
    def _is_late(self) -> bool:
        return clock.perf_counter() > self._until

    def _break(self, e: Array) -> None:
        """Take a state into account at which c is not below 0, or not a number."""
        alpha, change = float(e @ self._change.P @ e), float(self._change.function(e))
        # It may lie slightly outside the ellipsoid that was tried.
        self._unproven, self._is_broken = min(alpha, self._unproven), True
        if change >= 0 and alpha <= self._alpha_max:
            self.refute(Refutation(alpha=alpha, e=e, change=change))
