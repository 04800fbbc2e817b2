"""The largest level that can be proven, between one that is and one that is not.

    bounds     the level wanted is tried first: it is proven, or a counterexample met
    refuted    the nearest counterexample, of the proof or of a search for it, is above
               all that can be proven
    downwards  shares of that, until one is proven: the model may not be defined, or
               be thin-featured if no search looks
    upwards    levels between the highest proven and the lowest that is not

until the two are within TIGHT of each other or time is up. A level counts as unproven
after MORE_BOXES times the boxes of the last proof.
"""

from __future__ import annotations

import time as clock
from dataclasses import dataclass

import numpy as np

from swarmstart.terminal_set.arrays import Array
from swarmstart.terminal_set.decrease import Change
from swarmstart.terminal_set.evidence import Proof, Refutation
from swarmstart.terminal_set.proof import prove_level
from swarmstart.terminal_set.refutation import refuted_level

FIRST_SHARE = 0.92
"""Of the refuted level, what is tried first: with six states more takes too long."""
NEARER_SHARE = 0.99
"""Of a level broken by a state, what is tried next."""
LOWER_SHARES = (0.54, 0.25)
"""Of an unproven level, what is tried then; the last again and again."""
SMALLEST_SHARE = 1e-12
"""Down to which a level is quartered. A smaller one takes hardly less time to prove;
that the model is not defined in the whole of a larger one shows at once."""
TIGHT = 1.011
"""Of the lowest unproven level over the proven one, where the search ends."""
MORE_BOXES = 10
FEW_BOXES = 50_000
"""A proof that takes no more is not given up for its boxes."""
MOST_BOXES = 100_000_000
"""Of a first proof: there it is time that ends one."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ProvenLevel:
    """The largest level that could be proven.

    Attributes:
        proof: Of the largest level that was proven, or the last try if none was.
        refutation: The nearest counterexample below the level asked for; None if none
            was found.
    """

    proof: Proof
    refutation: Refutation | None

    @property
    def alpha(self) -> float:
        """The proven level; 0 if none was."""
        return self.proof.alpha if self.proof.proven else 0.0


def proven_level(
    change: Change,
    alpha_max: float,
    *,
    rng: np.random.Generator,
    max_seconds: float = 60.0,
) -> ProvenLevel:
    """Prove as much as can be of the levels up to one.

    Args:
        change: Of `continuous_change` or `held_change`.
        alpha_max: The level wanted, > 0: that of the bounds.
        rng: Of the rays that look for a counterexample.
        max_seconds: For all proofs together [s].

    Returns:
        The level wanted if it is proven, else the largest that was found; unproven
        if none was.

    Raises:
        SwarmstartError: As `refuted_level` and `prove_level` say.
    """
    search = _LevelSearch(change, alpha_max, clock.perf_counter() + max_seconds)
    # A level that cannot be proven mostly shows a counterexample at once.
    if not search.proves(alpha_max, 0.25):
        search.refute(refuted_level(change, alpha_max=alpha_max, rng=rng))
        search.descend()
        search.tighten()
    return search.level


class _LevelSearch:
    """The highest proven level, the lowest unproven one, the nearest counterexample.

    Attributes:
        level: What was found so far.
    """

    def __init__(self, change: Change, alpha_max: float, until: float) -> None:
        """Begin without knowledge."""
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
        """Try a level, in a share of the time that is left."""
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
        """Take a state into account at which c is not below 0, or is no number."""
        alpha, change = float(e @ self._change.P @ e), float(self._change.function(e))
        # It may lie a hair outside the ellipsoid that was tried.
        self._unproven, self._is_broken = min(alpha, self._unproven), True
        if change >= 0 and alpha <= self._alpha_max:
            self.refute(Refutation(alpha=alpha, e=e, change=change))
