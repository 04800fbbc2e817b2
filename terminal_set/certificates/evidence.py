"""Evidence for and against a level: outcomes of proofs, and counterexamples."""

from __future__ import annotations

from dataclasses import dataclass

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.linear.arrays import finite_array


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Proof:
    """The outcome of a proof.

    Attributes:
        proven: Whether c < 0 everywhere in the ellipsoid except at its centre.
        alpha: The level.
        boxes: Number of boxes examined.
        seconds: Wall time [s].
        counterexample: A deviation at which c >= 0 or c is not a number, shape (nx,);
            None if none was met.
    """

    proven: bool
    alpha: float
    boxes: int
    seconds: float
    counterexample: Array | None = None


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Refutation:
    """A deviation at which e'Pe does not decrease.

    Attributes:
        alpha: e'Pe there: no level at or above it can be proven.
        e: The deviation, shape (nx,), read-only.
        change: c(e) >= 0 there.
    """

    alpha: float
    e: Array
    change: float

    def __post_init__(self) -> None:
        """Copy and lock."""
        object.__setattr__(self, "e", finite_array("e", self.e, (None,)))


@dataclass(eq=False)
class UnprovenSetError(SwarmstartError, ArithmeticError):
    """No level of a design could be proven.

    Attributes:
        smallest: The smallest level that was tried.
        refuted: The refuted level; None if none was refuted.
        seconds: The allowed time [s].
    """

    smallest: float
    refuted: float | None
    seconds: float

    def __str__(self) -> str:
        """Return a message with the levels that were tried."""
        refuted = "none" if self.refuted is None else f"{self.refuted:.6g}"
        return (
            f"no level could be proven within {self.seconds:g} s: the smallest tried "
            f"was {self.smallest:.6g}, the refuted one is {refuted}"
        )


@dataclass(eq=False)
class CoarseHoldError(UnprovenSetError):
    """The integrator's error over a hold leaves too little of the decrease.

    Attributes:
        substeps: Number of Runge-Kutta steps in a hold.
    """

    substeps: int

    def __str__(self) -> str:
        """Return a message with a remedy."""
        return (
            f"{super().__str__()}; the error of {self.substeps} Runge-Kutta steps a "
            "hold, or the bound that could be proven of it, leaves too little of the "
            "decrease: more substeps may help, or a shorter hold"
        )
