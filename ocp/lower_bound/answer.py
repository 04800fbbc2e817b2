"""The answer of `lower_bound`: a number, its kind, and what it rests on."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from swarmstart.ocp.lower_bound.evidence import Evidence


class BoundKind(Enum):
    """What a bound is worth.

    PROVEN: no admissible answer is better, rounding included.
    TRIVIAL: proven too, but from the least stage cost alone.
    SAMPLED: an estimate from samples; no bound.
    NONE: there is none, for a reason that is said.
    """

    PROVEN = "proven"
    TRIVIAL = "trivial"
    SAMPLED = "sampled"
    NONE = "none"

    @property
    def is_bound(self) -> bool:
        """Whether the value may be called a bound."""
        return self in (BoundKind.PROVEN, BoundKind.TRIVIAL)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LowerBound:
    """How good an answer to a problem can be, at most.

    Attributes:
        kind: What it is worth.
        value: The bound, as the problem states its cost: no answer costs less; of a
            maximised cost none is worth more. NaN if there is none.
        reason: How it was found, or why there is none: sentences.
        degree: Degree of the polynomial; 0 if none was used.
        slack: What the proof left over, taken off the bound [cost].
        boxes: How many boxes all proofs took.
        cpu_seconds: CPU time of the process [s].
        set_name: What holds the trajectories, in words.
        evidence: What the proof rests on; None if nothing is proven by polynomials.
        sense: 1 of a minimised cost, -1 of a maximised one.
    """

    kind: BoundKind
    value: float
    reason: str
    degree: int = 0
    slack: float = 0.0
    boxes: int = 0
    cpu_seconds: float = 0.0
    set_name: str = ""
    evidence: Evidence | None = None
    sense: float = 1.0

    def gap(self, cost: float) -> float:
        """Return how far an answer is from the optimum at most, in parts of its cost.

        Args:
            cost: Of the answer, as the problem states it.

        Returns:
            (cost - bound) / |cost|, or (bound - cost) / |cost| of a maximised cost;
            NaN if there is no bound; 0 if both are the same.
        """
        if not self.kind.is_bound:
            return float("nan")
        apart = self.sense * (cost - self.value)
        return (
            apart / abs(cost)
            if apart and cost
            else (0.0 if not apart else float("inf"))
        )
