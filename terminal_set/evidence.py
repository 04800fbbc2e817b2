"""Evidence for and against a level: how a proof went, and a counterexample."""

from __future__ import annotations

from dataclasses import dataclass

from swarmstart.terminal_set.arrays import FloatArray, finite_array


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Proof:
    """How a proof went.

    Attributes:
        proven: Whether c < 0 everywhere in the ellipsoid but at its centre.
        alpha: The level.
        boxes: How many were looked at.
        seconds: Wall time [s].
        counterexample: A deviation with c >= 0 or at which c is no number, shape (nx,),
            where one was met; None otherwise.
    """

    proven: bool
    alpha: float
    boxes: int
    seconds: float
    counterexample: FloatArray | None = None


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Refutation:
    """A deviation at which e'Pe does not decrease.

    Attributes:
        alpha: e'Pe there: no level from it on is one.
        e: The deviation, shape (nx,), read-only.
        change: c(e) >= 0 there.
    """

    alpha: float
    e: FloatArray
    change: float

    def __post_init__(self) -> None:
        """Copy and lock."""
        object.__setattr__(self, "e", finite_array("e", self.e, (None,)))
