"""Writer of C99 that has the methods of the writer of machine code (ocp/compiled).

So the functions that write machine code, operation by operation, write C as well, with
one number in place of a vector of numbers; C and machine code compute the same values.
A product in a sum is rounded in C, since not every processor has a fast `fma`;
constants are hexadecimal, so that no digit is lost. Where machine code calls the C
library, outside the range of its own methods, the value in C is NaN.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.ocp.compiled.vectors.operations import emit_operation
from swarmstart.ocp.compiled.vectors.vector_ir import DOUBLE, Format, VectorIR

_COMPARED = {
    "olt": "{a} < {b}", "ole": "{a} <= {b}", "ogt": "{a} > {b}", "oge": "{a} >= {b}",
    "oeq": "{a} == {b}", "une": "{a} != {b}", "ult": "!({a} >= {b})",
    "ule": "!({a} > {b})", "ugt": "!({a} <= {b})", "uno": "{a} != {a} || {b} != {b}",
}  # fmt: skip
_BINARY = {"fadd": "+", "fsub": "-", "fmul": "*", "fdiv": "/"}
_OF_MASKS = {"and": "&", "or": "|", "xor": "^"}
_OF_INTEGERS = {"and": "&", "or": "|", "xor": "^", "add": "+", "sub": "-", "shl": "<<"}
_FUNCTIONS = {
    "sqrt": "square_root", "floor": "floor_of", "ceil": "ceiling_of",
    "fabs": "absolute", "copysign": "with_sign_of", "minnum": "smaller",
    "maxnum": "larger",
}  # fmt: skip
"""Name of an intrinsic -> the function of the file's preamble."""


class CFunction(NamedTuple):
    """A function of a C file.

    Attributes:
        text: Text of the function in C.
        operations: Number of operations in the function.
        values: Number of values that the function returns.
    """

    text: str
    operations: int
    values: int


class CWriter(VectorIR):
    """Writer of the body of a C function.

    Attributes:
        operations: Number of operations so far, those of called functions included.
    """

    def __init__(self, form: Format, *, common: dict[str, CFunction]) -> None:
        """Begin the body of a function.

        Args:
            form: Floating-point format of its numbers.
            common: Elementary functions of the file by their names; new ones are added.
        """
        super().__init__(1, replace(form, is_fused=False))
        self.common, self.operations = common, 0
        self._is_own = form.bits == DOUBLE.bits

    def in_format(self, form: Format) -> "CWriter":
        """Return this writer, whatever the format, since a file has one precision."""
        del form
        return self

    def name(self, stem: str = "v") -> str:
        """Return a new name that begins with the stem."""
        return self.body.name(stem).removeprefix("%")

    def declared(self, kind: str, stem: str, expression: str) -> str:
        """Declare a constant of a C type, counted as one operation; return its name."""
        name = self.name(stem)
        self.line(f"const {kind} {name} = {expression};")
        self.operations += 1
        return name

    def real(self, expression: str) -> str:
        """Declare a number, counted as one operation; return its name."""
        return self.declared("real", "v", expression)

    def constant(self, value: float) -> str:
        """Return a number as a C constant."""
        return c_number(value, self.form)

    def integer(self, value: int) -> str:
        """Return an integer as a C constant of the type `bits_t`."""
        return f"((bits_t)0x{value % 2**self.form.bits:X}u{'ll' * self._is_own})"

    def binary(self, instruction: str, a: str, b: str) -> str:
        """Return the result of fadd, fsub, fmul or fdiv of two numbers."""
        return self.real(f"{a} {_BINARY[instruction]} {b}")

    def neg(self, a: str) -> str:
        """Return -a."""
        return self.real(f"-{a}")

    def fma(self, a: str, b: str, c: str) -> str:
        """Return a * b + c; the product is rounded."""
        return self.real(f"{a} * {b} + {c}")

    def intrinsic(self, name: str, *arguments: str) -> str:
        """Return the value of a function of the preamble, such as sqrt or minnum."""
        return self.real(f"{_FUNCTIONS[name]}({', '.join(arguments)})")

    def compare(self, condition: str, a: str, b: str) -> str:
        """Return the mask of a comparison of two numbers, such as olt, oeq, une."""
        return self.declared("int", "m", _COMPARED[condition].format(a=a, b=b))

    def compare_integers(self, condition: str, a: str, b: str) -> str:
        """Return the mask of eq or ne of two integers, or of slt of one with 0."""
        if condition == "slt":
            return self.declared("int", "m", f"({a} >> {self.form.bits - 1}) != 0u")
        sign = {"eq": "==", "ne": "!="}[condition]
        return self.declared("int", "m", f"{a} {sign} {b}")

    def select(self, mask: str, yes: str, no: str) -> str:
        """Return `yes` if the mask is set, else `no`."""
        return self.real(f"{mask} ? {yes} : {no}")

    def mask_op(self, instruction: str, a: str, b: str) -> str:
        """Return the result of and, or, xor of two masks."""
        return self.declared("int", "m", f"{a} {_OF_MASKS[instruction]} {b}")

    def bits(self, a: str) -> str:
        """Return a number's bits."""
        return self.declared("bits_t", "i", f"bits_of({a})")

    def from_bits(self, a: str) -> str:
        """Return the number that has the given bits."""
        return self.real(f"number_of({a})")

    def integer_op(self, instruction: str, a: str, b: str) -> str:
        """Return the result of and, or, xor, add, sub, shl, ashr of two integers."""
        if instruction == "ashr":
            return self.declared("bits_t", "i", f"shifted_right({a}, {b})")
        return self.declared("bits_t", "i", f"{a} {_OF_INTEGERS[instruction]} {b}")

    def converted(self, value: str, given: Format, wanted: Format) -> str:
        """Return the value itself, since a file has one precision."""
        del given, wanted
        return value

    def beside(
        self, name: str, make: Callable[..., Sequence[str]], *arguments: str
    ) -> list[str]:
        """Call a function that is written once into the file; return its values.

        Args:
            name: Name of the function.
            make: Function that writes the body, given a writer and the arguments.
            *arguments: Arguments of the call.
        """
        own = name.removeprefix("vector_")
        if own not in self.common:
            inner = CWriter(self.form, common=self.common)
            values = make(inner, *(f"a{i}" for i in range(len(arguments))))
            text = _function_text(own, len(arguments), inner, values)
            self.common[own] = CFunction(text, inner.operations, len(values))
        function, given = self.common[own], ", ".join(arguments)
        self.operations += function.operations
        if function.values == 1:
            return [self.real(f"{own}_of({given})")]
        names = [self.name() for _ in range(function.values)]
        self.line(f"real {', '.join(names)};")
        found = ", ".join(f"&{one}" for one in names)
        self.line(f"{own}_of({given}, {found});")
        return names

    def corrected(
        self, values: Sequence[str], right: str, make: Callable[[], Sequence[str]]
    ) -> list[str]:
        """Return `values` if the mask `right` is set, else those that `make` writes."""
        others = make()
        return [self.select(right, a, b) for a, b in zip(values, others, strict=True)]

    def lane_by_lane(self, function: str, *arguments: str) -> str:
        """Return the value of a function that machine code takes from the C library.

        The C file does not call that library: hypot, remainder and pow are written
        as a few operations, and the value of any other function is NaN.
        """
        if function == "hypot":
            a, b = arguments
            return self.intrinsic("sqrt", self.fma(a, a, self.mul(b, b)))
        if function == "remainder":
            return self._remainder(*arguments)
        if function == "pow":
            return self.beside("wide_power", _wide_power, *arguments)[0]
        return self.constant(math.nan)

    def _remainder(self, a: str, b: str) -> str:
        """Return a - n b, n the whole number nearest to a / b, even in the middle."""
        half, quotient = self.constant(0.5), self.div(a, b)
        turns = self.intrinsic("floor", self.add(quotient, half))
        middle = self.compare("oeq", self.sub(turns, quotient), half)
        halves = self.mul(turns, half)
        odd = self.compare("une", self.intrinsic("floor", halves), halves)
        lower = self.sub(turns, self.constant(1.0))
        turns = self.select(self.mask_op("and", middle, odd), lower, turns)
        return self.fma(self.neg(turns), b, a)


def _wide_power(ir: VectorIR, base: str, exponent: str) -> list[str]:
    """Return a power of any base, from zero to infinity, by exp and log."""
    zero, one, half = (ir.constant(value) for value in (0.0, 1.0, 0.5))
    size = emit_operation(ir, "log", [ir.intrinsic("fabs", base)])
    value = emit_operation(ir, "exp", [ir.mul(exponent, size)])
    whole = ir.compare("oeq", ir.intrinsic("floor", exponent), exponent)
    halves = ir.mul(exponent, half)
    even = ir.compare("oeq", ir.intrinsic("floor", halves), halves)
    signed = ir.select(even, value, ir.neg(value))
    signed = ir.select(whole, signed, ir.constant(math.nan))
    value = ir.select(ir.compare("olt", base, zero), signed, value)
    return [ir.select(ir.compare("oeq", exponent, zero), one, value)]


def _function_text(name: str, count: int, inner: CWriter, values: Sequence[str]) -> str:
    """Return a static function of numbers."""
    given = ", ".join(f"real a{i}" for i in range(count))
    if len(values) == 1:
        head, end = f"static real {name}_of({given})", [f"  return {values[0]};"]
    else:
        found = ", ".join(f"real *r{i}" for i in range(len(values)))
        head = f"static void {name}_of({given}, {found})"
        end = [f"  *r{i} = {value};" for i, value in enumerate(values)]
    return "\n".join([head, "{", *inner.body.lines, *end, "}", ""])


def c_number(value: float, form: Format) -> str:
    """Return a number as a constant of C99, without losing a digit."""
    if math.isnan(value):
        return "NOT_A_NUMBER"
    if form.bits < DOUBLE.bits:
        with np.errstate(over="ignore"):
            value = float(np.float32(value))
    if math.isinf(value):
        return "INFINITE" if value > 0 else "(-INFINITE)"
    suffix = "" if form.bits == DOUBLE.bits else "f"
    text = f"{value.hex()}{suffix}"
    return f"({text})" if math.copysign(1.0, value) < 0 else text


def c_table(name: str, values: ArrayLike, form: Format) -> str:
    """Return a constant array in C, row after row; no text if it has no entries."""
    rows = [c_number(float(v), form) for v in np.ravel(values)]
    if not rows:
        return ""
    lines = [", ".join(rows[i : i + 3]) for i in range(0, len(rows), 3)]
    inner = ",\n    ".join(lines)
    return f"static const real {name}[{len(rows)}] = {{\n    {inner}\n}};\n"
