"""Choice of weights: the largest proven set over a family of designs.

The weights of an LQR are seldom given, but matter: with Q = R = I the formation model,
held 1 s, has a set 24 cm wide in position; with another R it is metres wide. So the
weights are scaled by a scalar s, each design gets its proven level, and the largest set
is taken.

    largest_proven_set  the proven level (`level_search.py`) for each s, and the largest
                        of the sets

Levels of different P cannot be compared, sizes can. The usual size is the volume.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.certificates.design import TerminalSet
from swarmstart.terminal_set.linear.ellipsoid import Ellipsoid
from swarmstart.terminal_set.proving.decrease import Change
from swarmstart.terminal_set.proving.level_search import ProvenLevel, proven_level


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
class Candidate:
    """One design of a family.

    Attributes:
        scale: The scalar in its weights.
        terminal_set: The design, with the proven level; with the level of its bounds if
            none was proven.
        level: The proven and the refuted level.
        size: Size of the proven set; minus infinity if none was proven.
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


def largest_proven_set(
    design: Callable[[float], TerminalSet],
    change: Callable[[TerminalSet], Change],
    scales: Sequence[float],
    *,
    rng: np.random.Generator,
    size: Callable[[Ellipsoid], float] = log_volume,
    max_seconds: float = 60.0,
) -> tuple[Candidate, ...]:
    """Rank the designs of a family by the size of their proven sets.

    Args:
        design: The design at a scale, with the level of its bounds.
        change: c of a design (`decrease.py`).
        scales: The scales to try.
        rng: Source of randomness of the rays that look for counterexamples.
        size: Proven ellipsoid -> its size.
        max_seconds: Time for the proofs of one design [s].

    Returns:
        All candidates, the largest first; those without a proof last, in their order.

    Raises:
        NoProvenSetError: If no level was proven for any scale.
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
