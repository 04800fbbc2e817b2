"""Lines of LLVM IR on vectors, whose lanes each hold one individual, and loops.

A value is the name of a register or the text of a constant; a mask is a vector of bits.
The formats are the two of IEEE 754 that kernels compute in. Nothing is reordered or
contracted here. Sums are simplified before, in emitter.py, and operations.py decides on
the use of `fma`.
"""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

Precision = Literal["double", "single"]


@dataclass(frozen=True, slots=True)
class Format:
    """A floating-point format.

    Attributes:
        name: LLVM's name of the format.
        suffix: Name of the format in LLVM's intrinsics.
        bits: Length of a number [bits].
        significand: Bits of the significand that are stored.
        bias: Bias of the exponent.
        smallest: Smallest normal number.
        is_fused: Whether a product in a sum is not rounded (`fma`).
    """

    name: str
    suffix: str
    bits: int
    significand: int
    bias: int
    smallest: float
    is_fused: bool = True

    @property
    def integer(self) -> str:
        """LLVM's name of the integer of this length."""
        return f"i{self.bits}"

    @property
    def rounding(self) -> float:
        """Number that, added and subtracted again, rounds to an integer.

        The low bits of the sum are those of the integer.
        """
        return 1.5 * 2.0**self.significand


DOUBLE = Format("double", "f64", 64, 52, 1023, 2.0**-1022)
SINGLE = Format("float", "f32", 32, 23, 127, 2.0**-126)
FORMATS: dict[str, Format] = {"double": DOUBLE, "single": SINGLE}


RARELY = "!prof !0"
"""Mark of a branch whose first way is rarely taken."""
WEIGHTS = '!0 = !{!"branch_weights", i32 1, i32 100000}'
"""Definition of the mark, for the end of a module."""


class Function(NamedTuple):
    """A function of vectors, written once into the kernel's module and called there.

    Attributes:
        text: LLVM IR of the function.
        values: Number of vectors that it returns.
    """

    text: str
    values: int


@dataclass(frozen=True, slots=True)
class Module:
    """The parts that the functions of one module share.

    Attributes:
        has_scale: Whether the processor multiplies by powers of two in one instruction
            (AVX-512's vscalef).
        declarations: Declarations of functions from elsewhere.
        functions: The functions of vectors that the kernel calls, by name.
    """

    has_scale: bool = False
    declarations: set[str] = field(default_factory=set)
    functions: dict[str, Function] = field(default_factory=dict)


class Body:
    """The text of one function so far."""

    def __init__(self) -> None:
        """Begin an empty body."""
        self.lines: list[str] = []
        self.block = "%block"
        self._count = 0

    def name(self, stem: str) -> str:
        """Return a register's name that is not taken."""
        self._count += 1
        return f"%{stem}{self._count}"


class VectorIR:
    """Writer of the body of a function; every method returns the value it makes."""

    def __init__(
        self,
        lanes: int,
        form: Format = DOUBLE,
        *,
        module: Module | None = None,
        body: Body | None = None,
    ) -> None:
        """Begin a function, or continue one.

        Args:
            lanes: Numbers in a vector, a power of two.
            form: Format of the numbers.
            module: Module of the function; None means a new one.
            body: Body of the function so far; None means an empty one.
        """
        self.lanes, self.form = lanes, form
        self.module = Module() if module is None else module
        self.body = Body() if body is None else body
        self.vector = f"<{lanes} x {form.name}>"
        self.integers = f"<{lanes} x {form.integer}>"
        self.mask = f"<{lanes} x i1>"

    def in_format(self, form: Format) -> "VectorIR":
        """Return a writer of the same body, for numbers of another format."""
        return VectorIR(self.lanes, form, module=self.module, body=self.body)

    def name(self, stem: str = "v") -> str:
        """Return a register's name that is not taken."""
        return self.body.name(stem)

    def line(self, text: str) -> None:
        """Add a line that makes no value."""
        self.body.lines.append(f"  {text}")

    def emit(self, instruction: str) -> str:
        """Add `register = instruction` and return the register."""
        register = self.name()
        self.line(f"{register} = {instruction}")
        return register

    def label(self, name: str) -> None:
        """Begin a basic block, "%name"."""
        self.body.block = name
        self.body.lines.append(f"{name.removeprefix('%')}:")

    def constant(self, value: float) -> str:
        """Return a constant in every lane."""
        if self.form.bits < DOUBLE.bits:  # LLVM writes every constant as a double.
            with np.errstate(over="ignore"):
                value = float(np.float32(value))
        bits = struct.unpack("<Q", struct.pack("<d", value))[0]
        return self._splat(f"{self.form.name} 0x{bits:016X}")

    def integer(self, value: int) -> str:
        """Return an integer constant in every lane."""
        return self._splat(f"{self.form.integer} {value}")

    def _splat(self, element: str) -> str:
        return f"<{', '.join([element] * self.lanes)}>"

    def broadcast(self, scalar: str) -> str:
        """Return a scalar register in every lane."""
        first = self.emit(
            f"insertelement {self.vector} poison, {self.form.name} {scalar}, i64 0"
        )
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
        """Return the value of an LLVM intrinsic on vectors: fma, sqrt, minnum etc."""
        function = f"@llvm.{name}.v{self.lanes}{self.form.suffix}"
        return self.call(function, *arguments)

    def call(self, function: str, *arguments: str) -> str:
        """Return the value of a function of vectors, which is declared if needed."""
        types = ", ".join([self.vector] * len(arguments))
        self.module.declarations.add(f"declare {self.vector} {function}({types})")
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
        """Return the mask of a comparison.

        `condition` is a word of LLVM's `fcmp`, such as olt (less), oeq (equal) or une
        (not equal, or NaN).
        """
        return self.emit(f"fcmp {condition} {self.vector} {a}, {b}")

    def select(self, mask: str, yes: str, no: str) -> str:
        """Return `yes` in the lanes in which the mask is set, `no` in the others."""
        return self.emit(
            f"select {self.mask} {mask}, {self.vector} {yes}, {self.vector} {no}"
        )

    def mask_op(self, instruction: str, a: str, b: str) -> str:
        """Return and, or, xor of two masks."""
        return self.emit(f"{instruction} {self.mask} {a}, {b}")

    def flag(self, mask: str) -> str:
        """Return 1.0 in the lanes in which the mask is set, 0.0 in the others."""
        return self.select(mask, self.constant(1.0), self.constant(0.0))

    def bits(self, a: str) -> str:
        """Return a vector's bits as integers."""
        return self.emit(f"bitcast {self.vector} {a} to {self.integers}")

    def from_bits(self, a: str) -> str:
        """Return the vector whose bits are given as integers."""
        return self.emit(f"bitcast {self.integers} {a} to {self.vector}")

    def integer_op(self, instruction: str, a: str, b: str) -> str:
        """Return and, or, xor, add, sub, shl, lshr, ashr of two integer vectors."""
        return self.emit(f"{instruction} {self.integers} {a}, {b}")

    def compare_integers(self, condition: str, a: str, b: str) -> str:
        """Return the mask of a comparison of integers.

        `condition` is a word of LLVM's `icmp`, such as eq (equal), ne (not equal) or
        slt (less, with a sign).
        """
        return self.emit(f"icmp {condition} {self.integers} {a}, {b}")

    def any(self, mask: str) -> str:
        """Return whether the mask is set in some lane, as one bit."""
        function = f"@llvm.vector.reduce.or.v{self.lanes}i1"
        self.module.declarations.add(f"declare i1 {function}({self.mask})")
        return self.emit(f"call i1 {function}({self.mask} {mask})")

    def beside(
        self, name: str, make: Callable[..., Sequence[str]], *arguments: str
    ) -> list[str]:
        """Call a function of vectors that is written once in the same module.

        Args:
            name: Name of the function in the module.
            make: Function (ir, arguments) -> values, which writes it at its first use.
            arguments: Arguments of the call.
        """
        if name not in self.module.functions:
            inner = VectorIR(self.lanes, self.form, module=self.module)
            inner.body.block = "%entry"
            values = make(inner, *(f"%a{i}" for i in range(len(arguments))))
            self.module.functions[name] = inner.function(name, len(arguments), values)
        function = self.module.functions[name]
        given = ", ".join(f"{self.vector} {argument}" for argument in arguments)
        returned = _returned(self.vector, function.values)
        result = self.emit(f"call fastcc {returned} @{name}({given})")
        if function.values == 1:
            return [result]
        return [
            self.emit(f"extractvalue {returned} {result}, {i}")
            for i in range(function.values)
        ]

    def function(self, name: str, count: int, values: Sequence[str]) -> "Function":
        """Return the body as a function.

        Args:
            name: Name of the function.
            count: Number of its arguments, %a0, %a1 and so on.
            values: Values that it returns.
        """
        returned, result = _returned(self.vector, len(values)), values[0]
        if len(values) > 1:
            result = "poison"
            for i, value in enumerate(values):
                result = self.emit(
                    f"insertvalue {returned} {result}, {self.vector} {value}, {i}"
                )
        parameters = ", ".join(f"{self.vector} %a{i}" for i in range(count))
        text = [
            f"define internal fastcc {returned} @{name}({parameters}) noinline #0 {{",
            "entry:",
            *self.body.lines,
            f"  ret {returned} {result}",
            "}",
            "",
        ]
        return Function("\n".join(text), len(values))

    def corrected(
        self, values: Sequence[str], right: str, make: Callable[[], Sequence[str]]
    ) -> list[str]:
        """Return values, replaced in the lanes in which they are wrong.

        Args:
            values: The values.
            right: Mask of the lanes in which the values are right, mostly all.
            make: Function that emits the replacements; they are computed only if a lane
                needs them.
        """
        everywhere = f"<{', '.join(['i1 1'] * self.lanes)}>"
        wrong = self.any(self.mask_op("xor", right, everywhere))
        before, some, after = self.body.block, self.name("some"), self.name("after")
        self.line(f"br i1 {wrong}, label {some}, label {after}, {RARELY}")
        self.label(some)
        mixed = [
            self.select(right, value, other)
            for value, other in zip(values, make(), strict=True)
        ]
        end = self.body.block
        self.line(f"br label {after}")
        self.label(after)
        return [
            self.emit(f"phi {self.vector} [ {value}, {before} ], [ {other}, {end} ]")
            for value, other in zip(values, mixed, strict=True)
        ]

    def converted(self, value: str, given: Format, wanted: Format) -> str:
        """Return a vector in another format, rounded if that format is shorter."""
        if given == wanted:
            return value
        instruction = "fpext" if given.bits < wanted.bits else "fptrunc"
        types = (f"<{self.lanes} x {form.name}>" for form in (given, wanted))
        return self.emit(f"{instruction} {next(types)} {value} to {next(types)}")

    def lane_by_lane(self, function: str, *arguments: str) -> str:
        """Return the values of a C library function (of doubles) in every lane.

        Args:
            function: Name of the function, such as "sinh".
            arguments: One or two vectors.
        """
        (value,) = self.beside(
            f"lanes_{function}",
            lambda ir, *inner: [_each_lane(ir, function, inner)],
            *arguments,
        )
        return value


def _returned(vector: str, values: int) -> str:
    """Return the type of a function that returns so many vectors."""
    return vector if values == 1 else f"{{ {', '.join([vector] * values)} }}"


def _each_lane(ir: VectorIR, function: str, arguments: Sequence[str]) -> str:
    types = ", ".join(["double"] * len(arguments))
    ir.module.declarations.add(f"declare double @{function}({types})")
    doubles, result = f"<{ir.lanes} x double>", "poison"
    given = [ir.converted(argument, ir.form, DOUBLE) for argument in arguments]
    for lane in range(ir.lanes):
        scalars = [ir.emit(f"extractelement {doubles} {v}, i64 {lane}") for v in given]
        called = ", ".join(f"double {scalar}" for scalar in scalars)
        value = ir.emit(f"call double @{function}({called})")
        result = ir.emit(
            f"insertelement {doubles} {result}, double {value}, i64 {lane}"
        )
    return ir.converted(result, DOUBLE, ir.form)


class Loop:
    """A loop that carries values from the end of a turn to the next one.

    Attributes:
        k: Register of the turn's number, from 0.
        carried: Registers of the carried values in a turn.
    """

    def __init__(self, ir: VectorIR, initial: Sequence[str], turns: int) -> None:
        """Begin the loop's body.

        Args:
            ir: Writer of the function's body.
            initial: The carried values before the first turn.
            turns: Number of turns, at least 1.
        """
        self._ir, self._initial, self._turns = ir, initial, turns
        self._before, self._body = ir.body.block, ir.name("interval")
        ir.line(f"br label {self._body}")
        ir.label(self._body)
        self.k = ir.name("k")
        self.carried = [ir.name("carried") for _ in initial]
        self._head = len(ir.body.lines)

    def close(self, updated: Sequence[str], *, while_: str | None = None) -> None:
        """End the loop's body.

        Args:
            updated: The carried values at the end of a turn.
            while_: A bit that must be set for another turn; None for no such condition.
        """
        ir, done = self._ir, self._ir.name("done")
        following = ir.emit(f"add i64 {self.k}, 1")
        more = ir.emit(f"icmp ult i64 {following}, {self._turns}")
        if while_ is not None:
            more = ir.emit(f"and i1 {more}, {while_}")
        latch = ir.body.block
        ir.line(f"br i1 {more}, label {self._body}, label {done}")
        # A phi stands at the head, but needs values that are known only at the end.
        ir.body.lines[self._head : self._head] = [
            f"  {self.k} = phi i64 [ 0, {self._before} ], [ {following}, {latch} ]",
            *(
                f"  {name} = phi {ir.vector} "
                f"[ {first}, {self._before} ], [ {value}, {latch} ]"
                for name, first, value in zip(
                    self.carried, self._initial, updated, strict=True
                )
            ),
        ]
        ir.label(done)
