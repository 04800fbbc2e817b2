"""Choice of weights: the largest proven set over a family of designs.

The weights of an LQR are seldom given. With Q = R = I the formation model, held 1 s,
has a set 24 cm wide in position; with another R it is metres wide. So a scalar s moves
through the weights, each design gets its proven level, and the largest set is taken.

    proven_level        the bounds' level where it can be proven, else a share of what
                        is refuted
    largest_proven_set  that, for each s, and the largest of the sets

Levels of different P do not compare; sizes do. The usual size is the volume.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.decrease import Change
from swarmstart.terminal_set.design import TerminalSet
from swarmstart.terminal_set.ellipsoid import Ellipsoid
from swarmstart.terminal_set.evidence import Proof, Refutation
from swarmstart.terminal_set.proof import prove_level
from swarmstart.terminal_set.refutation import refuted_level

SHARE = 0.92
"""Of the refuted level, what is tried first: with six states more takes too long."""
NEARER_SHARE = 0.99
SMALLEST_SHARE = 1e-12
"""Down to which a level is quartered. A smaller one takes hardly less time to prove;
that the model is not defined in the whole of a larger one shows at once."""
MOST_BOXES = 100_000_000
"""Of a proof: here it is time that ends one."""


@dataclass(eq=False)
class NoProvenSetError(SwarmstartError, ValueError):
    """No design of a family has a level that was proven.

    Attributes:
        scales: The scales that were tried.
    """

    scales: tuple[float, ...]

    def __str__(self) -> str:
        """Say what was tried."""
        tried = ", ".join(f"{scale:g}" for scale in self.scales) or "none"
        return f"no level could be proven for any of the scales tried: {tried}"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ProvenLevel:
    """How far up a level could be proven.

    Attributes:
        proof: Of the largest level that was proven, or the last try where none was.
        refutation: The counterexample below the level asked for; None where none was
            found.
    """

    proof: Proof
    refutation: Refutation | None

    @property
    def alpha(self) -> float:
        """The proven level; 0 where none was."""
        return self.proof.alpha if self.proof.proven else 0.0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Candidate:
    """One design of a family.

    Attributes:
        scale: The scalar in its weights.
        terminal_set: The design, with the level that was proven; with the level of its
            bounds where none was.
        level: What was proven and refuted.
        size: Of the proven set; minus infinity where none was.
    """

    scale: float
    terminal_set: TerminalSet
    level: ProvenLevel
    size: float


def log_volume(ellipsoid: Ellipsoid) -> float:
    """Compute the logarithm of an ellipsoid's volume, relative to the unit ball's.

    Args:
        ellipsoid: {e : e'Pe <= alpha}; log sqrt(alpha^nx / det P) of it.
    """
    _, log_determinant = np.linalg.slogdet(ellipsoid.P)
    return float(len(ellipsoid.P) * np.log(ellipsoid.alpha) - log_determinant) / 2


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
        The level wanted where it is proven, else the largest of some shares of the
        refuted one, or of the level wanted where none was refuted; unproven where none
        was.

    Raises:
        SwarmstartError: As `refuted_level` and `prove_level` say.
    """
    until = clock.perf_counter() + max_seconds

    def proof_of(alpha: float, share: float = 1.0) -> Proof:
        """Try a level, in a share of the time that is left."""
        left = (until - clock.perf_counter()) * share
        return prove_level(change, alpha, max_boxes=MOST_BOXES, max_seconds=left)

    # A level that cannot be proven mostly shows a counterexample at once.
    best = proof_of(alpha_max, 0.25)
    if best.proven:
        return ProvenLevel(proof=best, refutation=None)
    refutation = refuted_level(change, alpha_max=alpha_max, rng=rng)
    top = alpha_max if refutation is None else refutation.alpha
    best = proof_of(SHARE * top, 0.7)
    if best.proven:
        nearer = proof_of(NEARER_SHARE * top)
        best = nearer if nearer.proven else best
        return ProvenLevel(proof=best, refutation=refutation)
    share = 0.5
    while not best.proven and share > SMALLEST_SHARE and clock.perf_counter() < until:
        best = proof_of(share * top, 0.5)
        share /= 4
    return ProvenLevel(proof=best, refutation=refutation)


def largest_proven_set(
    design: Callable[[float], TerminalSet],
    change: Callable[[TerminalSet], Change],
    scales: Sequence[float],
    *,
    rng: np.random.Generator,
    size: Callable[[Ellipsoid], float] = log_volume,
    max_seconds: float = 60.0,
) -> tuple[Candidate, ...]:
    """Rank the designs of a family by the size of the set that is proven.

    Args:
        design: The design at a scale, with the level of its bounds.
        change: c of a design (`decrease.py`).
        scales: The scales to try.
        rng: Of the rays that look for counterexamples.
        size: What is to be large, of the proven ellipsoid.
        max_seconds: For the proofs of one design [s].

    Returns:
        All of them, the largest first; those with nothing proven last, in their order.

    Raises:
        NoProvenSetError: No level was proven for any scale.
        SwarmstartError: As `design`, `refuted_level` and `prove_level` say.
    """
    found = []
    for scale in scales:
        designed = design(scale)
        level = proven_level(
            change(designed), designed.alpha, rng=rng, max_seconds=max_seconds
        )
        measured = -np.inf
        if level.alpha > 0:
            designed = replace(designed, alpha=level.alpha)
            measured = float(size(designed.ellipsoid))
        found.append(
            Candidate(scale=scale, terminal_set=designed, level=level, size=measured)
        )
    if not any(candidate.level.alpha > 0 for candidate in found):
        raise NoProvenSetError(tuple(scales))
    return tuple(sorted(found, key=lambda candidate: -candidate.size))
