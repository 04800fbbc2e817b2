"""Lines of LLVM IR on vectors of doubles, one lane an individual.

A value is the name of a register or the text of a constant; a mask is a vector of bits.
Nothing is reordered or contracted: every operation rounds as CasADi's does, so that
x^2 - y^2 is 0, not a rounding error below it, where x = y; `fma` is asked for.
"""

import struct
from collections.abc import Sequence


class VectorIR:
    """Collects the body of a function; every method returns the value it makes."""

    def __init__(self, lanes: int) -> None:
        """Begin an empty body.

        Args:
            lanes: Doubles in a vector, a power of two.
        """
        self.lanes = lanes
        self.vector = f"<{lanes} x double>"
        self.integers = f"<{lanes} x i64>"
        self.mask = f"<{lanes} x i1>"
        self.lines: list[str] = []
        self.declarations: set[str] = set()
        self.block = "%entry"
        self._count = 0

    def name(self, stem: str = "v") -> str:
        """Return a register's name that is not taken."""
        self._count += 1
        return f"%{stem}{self._count}"

    def emit(self, instruction: str) -> str:
        """Add `register = instruction` and return the register."""
        register = self.name()
        self.lines.append(f"  {register} = {instruction}")
        return register

    def label(self, name: str) -> None:
        """Begin a basic block, "%name"."""
        self.block = name
        self.lines.append(f"{name.removeprefix('%')}:")

    def constant(self, value: float) -> str:
        """Return a constant in every lane."""
        bits = struct.unpack("<Q", struct.pack("<d", value))[0]
        return self._splat(f"double 0x{bits:016X}")

    def integer(self, value: int) -> str:
        """Return an integer constant in every lane."""
        return self._splat(f"i64 {value}")

    def _splat(self, element: str) -> str:
        return f"<{', '.join([element] * self.lanes)}>"

    def broadcast(self, scalar: str) -> str:
        """Return a scalar register in every lane."""
        first = self.emit(f"insertelement {self.vector} poison, double {scalar}, i64 0")
        zeros = f"<{self.lanes} x i32> zeroinitializer"
        return self.emit(
            f"shufflevector {self.vector} {first}, {self.vector} poison, {zeros}"
        )

    def binary(self, instruction: str, a: str, b: str) -> str:
        """Return fadd, fsub, fmul or fdiv of two vectors."""
        return self.emit(f"{instruction} {self.vector} {a}, {b}")

    def add(self, a: str, b: str) -> str:
        """Return a + b."""
        return self.binary("fadd", a, b)

    def sub(self, a: str, b: str) -> str:
        """Return a - b."""
        return self.binary("fsub", a, b)

    def mul(self, a: str, b: str) -> str:
        """Return a * b."""
        return self.binary("fmul", a, b)

    def div(self, a: str, b: str) -> str:
        """Return a / b."""
        return self.binary("fdiv", a, b)

    def neg(self, a: str) -> str:
        """Return -a."""
        return self.emit(f"fneg {self.vector} {a}")

    def intrinsic(self, name: str, *arguments: str) -> str:
        """Return an LLVM intrinsic on vectors, such as fma, sqrt, minnum."""
        function = f"@llvm.{name}.v{self.lanes}f64"
        types = ", ".join([self.vector] * len(arguments))
        self.declarations.add(f"declare {self.vector} {function}({types})")
        given = ", ".join(f"{self.vector} {argument}" for argument in arguments)
        return self.emit(f"call {self.vector} {function}({given})")

    def fma(self, a: str, b: str, c: str) -> str:
        """Return a * b + c, rounded once."""
        return self.intrinsic("fma", a, b, c)

    def polynomial(self, x: str, coefficients: Sequence[float]) -> str:
        """Return a polynomial by Horner's rule, highest power first."""
        value = self.constant(coefficients[0])
        for coefficient in coefficients[1:]:
            value = self.fma(value, x, self.constant(coefficient))
        return value

    def compare(self, condition: str, a: str, b: str) -> str:
        """Return the mask of a comparison, such as olt, oeq, une."""
        return self.emit(f"fcmp {condition} {self.vector} {a}, {b}")

    def select(self, mask: str, yes: str, no: str) -> str:
        """Return yes where the mask is set, no elsewhere."""
        return self.emit(
            f"select {self.mask} {mask}, {self.vector} {yes}, {self.vector} {no}"
        )

    def mask_op(self, instruction: str, a: str, b: str) -> str:
        """Return and, or, xor of two masks."""
        return self.emit(f"{instruction} {self.mask} {a}, {b}")

    def flag(self, mask: str) -> str:
        """Return 1.0 where the mask is set, 0.0 elsewhere."""
        return self.select(mask, self.constant(1.0), self.constant(0.0))

    def bits(self, a: str) -> str:
        """Return a vector's bits as integers."""
        return self.emit(f"bitcast {self.vector} {a} to {self.integers}")

    def from_bits(self, a: str) -> str:
        """Return integers as the vector with these bits."""
        return self.emit(f"bitcast {self.integers} {a} to {self.vector}")

    def integer_op(self, instruction: str, a: str, b: str) -> str:
        """Return and, or, xor, add, sub, shl, lshr, ashr of two integer vectors."""
        return self.emit(f"{instruction} {self.integers} {a}, {b}")

    def any(self, mask: str) -> str:
        """Return whether the mask is set in some lane, as one bit."""
        function = f"@llvm.vector.reduce.or.v{self.lanes}i1"
        self.declarations.add(f"declare i1 {function}({self.mask})")
        return self.emit(f"call i1 {function}({self.mask} {mask})")

    def lane_by_lane(self, function: str, *arguments: str) -> str:
        """Return a scalar function of the C library applied to every lane.

        Args:
            function: Its name, such as "sinh".
            arguments: One or two vectors.
        """
        types = ", ".join(["double"] * len(arguments))
        self.declarations.add(f"declare double @{function}({types})")
        result = "poison"
        for lane in range(self.lanes):
            scalars = [
                self.emit(f"extractelement {self.vector} {argument}, i64 {lane}")
                for argument in arguments
            ]
            given = ", ".join(f"double {scalar}" for scalar in scalars)
            value = self.emit(f"call double @{function}({given})")
            result = self.emit(
                f"insertelement {self.vector} {result}, double {value}, i64 {lane}"
            )
        return result
