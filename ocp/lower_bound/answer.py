"""The answer of `lower_bound`: a number, its kind and its evidence."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from swarmstart.ocp.lower_bound.stated.evidence import Evidence


class BoundKind(Enum):
    """Kind of a lower bound.

    PROVEN: no admissible answer is better, rounding included.
    TRIVIAL: proven too, but from the least stage cost alone.
    SAMPLED: an estimate from samples; not a bound.
    NONE: there is no bound; the reason is given.
    """

    PROVEN = "proven"
    TRIVIAL = "trivial"
    SAMPLED = "sampled"
    NONE = "none"

    @property
    def is_bound(self) -> bool:
        """True if the value is a bound: PROVEN or TRIVIAL."""
        return self in (BoundKind.PROVEN, BoundKind.TRIVIAL)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LowerBound:
    """A limit of the cost that any answer to a problem can reach.

    Attributes:
        kind: Kind of the bound.
        value: The bound, as the problem states its cost: no answer costs less; if the
            cost is maximised, no answer reaches more. NaN if there is no bound.
        reason: How it was found, or why there is none: sentences.
        degree: Degree of the polynomial; 0 if none was used.
        slack: Gap that the proofs left, already subtracted from the bound [cost].
        boxes: Number of boxes of all proofs.
        cpu_seconds: CPU time of the process [s].
        set_name: Name of the set that holds the trajectories.
        evidence: Facts that the proof rests on; None if nothing is proven by
            polynomials.
        sense: 1 if the cost is minimised, -1 if it is maximised.
    """

    kind: BoundKind
    value: float
    reason: str
    degree: int = 0
    slack: float = 0.0
    boxes: int = 0
    cpu_seconds: float = 0.0
    set_name: str = ""
    evidence: Evidence | None = field(default=None, repr=False)  # Hundreds of lines.
    sense: float = 1.0

    def gap(self, cost: float) -> float:
        """Return the largest possible relative distance of an answer from the optimum.

        Args:
            cost: Cost of the answer, as the problem states it.

        Returns:
            (cost - bound) / |cost|, or (bound - cost) / |cost| if the cost is
            maximised; NaN if there is no bound; 0 if both are the same.
        """
        if not self.kind.is_bound:
            return float("nan")
        apart = self.sense * (cost - self.value)
        return (
            apart / abs(cost)
            if apart and cost
            else (0.0 if not apart else float("inf"))
        )
