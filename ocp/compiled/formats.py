"""The two formats of IEEE 754 that kernels compute in."""

from dataclasses import dataclass
from typing import Literal

Precision = Literal["double", "single"]


@dataclass(frozen=True, slots=True)
class Format:
    """A floating-point format.

    Attributes:
        name: LLVM's name of it.
        suffix: How LLVM's intrinsics name it.
        bits: Its length.
        significand: Bits of the significand that are stored.
        bias: What is added to the exponent.
        smallest: Smallest normal number.
    """

    name: str
    suffix: str
    bits: int
    significand: int
    bias: int
    smallest: float

    @property
    def integer(self) -> str:
        """LLVM's name of the integer of this length."""
        return f"i{self.bits}"

    @property
    def rounding(self) -> float:
        """What rounds to an integer, added and subtracted.

        The low bits of the sum are then that integer's.
        """
        return 1.5 * 2.0**self.significand


DOUBLE = Format("double", "f64", 64, 52, 1023, 2.0**-1022)
SINGLE = Format("float", "f32", 32, 23, 127, 2.0**-126)
FORMATS: dict[str, Format] = {"double": DOUBLE, "single": SINGLE}
