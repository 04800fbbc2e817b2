"""The operations of a tape as LLVM IR, value by value."""

from collections.abc import Callable, Mapping, Sequence

from swarmstart.ocp.compiled.vectors.elementary import (
    acos,
    asin,
    atan,
    atan2,
    exp,
    fmod,
    log,
    sin_and_cos,
    tan,
)
from swarmstart.ocp.compiled.vectors.exponentials import (
    acosh,
    asinh,
    atanh,
    cosh,
    erf,
    expm1,
    log1p,
    power,
    sinh,
    tanh,
)
from swarmstart.ocp.compiled.vectors.vector_ir import VectorIR
from swarmstart.tape import Node, Tape, UnknownOperationError

Read = Callable[[int, int], str]
"""(argument, dense entry) -> its value."""


def emit_tape(
    ir: VectorIR, tape: Tape, read: Read, given: Mapping[int, str] | None = None
) -> list[str]:
    """Emit a tape; return its values, in the order of its nodes.

    Args:
        ir: Writer of the function's body.
        tape: The tape.
        read: Function that emits the reading of an input and returns the value.
        given: Number of a node -> its value, for nodes whose value is known.

    Raises:
        UnknownOperationError: If an operation cannot be emitted.
    """
    values: list[str] = []
    angles: dict[int, tuple[str, str]] = {}
    fused = fused_products(tape)
    products = set(fused.values())
    for number, node in enumerate(tape.nodes):
        if given and number in given:
            value = given[number]
        elif number in products:
            value = "never read"  # Its only user computes it.
        elif number in fused:
            value = _fused(ir, tape, number, fused[number], values)
        elif node.operation in OF_ANGLES:
            (argument,) = node.arguments
            if argument not in angles:
                angles[argument] = _sin_and_cos(ir, values[argument])
            value = OF_ANGLES[node.operation](ir, *angles[argument])
        else:
            value = _value(ir, tape, node, read, values)
        values.append(value)
    return values


def _value(
    ir: VectorIR, tape: Tape, node: Node, read: Read, values: Sequence[str]
) -> str:
    """Emit a value that is computed from its arguments alone."""
    if node.operation == "constant":
        return ir.constant(node.value)
    if node.operation == "input":
        return read(*node.arguments)
    arguments = [values[a] for a in node.arguments]
    if node.operation == "constpow":
        known = tape.nodes[node.arguments[1]].value
        return constant_power(ir, arguments[0], arguments[1], known)
    return emit_operation(ir, node.operation, arguments)


PRODUCTS = ("mul", "sq", "twice")


def fused_products(tape: Tape) -> dict[int, int]:
    """Return the sums that fuse with a product, without rounding it first.

    A sum of two products is not fused, unless both are squares: x y - z w would leave a
    rounding error if the two are equal.

    Returns:
        Number of the sum -> number of the product, which nothing else uses.
    """
    users = tape.users()
    fused: dict[int, int] = {}
    for number, node in enumerate(tape.nodes):
        if node.operation not in ("add", "sub"):
            continue
        kinds = [tape.nodes[a].operation for a in node.arguments]
        alone = [
            a
            for a, kind in zip(node.arguments, kinds, strict=True)
            if kind in PRODUCTS and users[a] == 1
        ]
        exact = [a for a in alone if tape.nodes[a].operation == "twice"]
        squares = node.operation == "add" and kinds == ["sq", "sq"]
        if exact:  # Twice a value is not rounded in any case.
            fused[number] = exact[0]
        elif alone and (squares or not all(kind in PRODUCTS for kind in kinds)):
            fused[number] = alone[0]
    return fused


def _fused(
    ir: VectorIR, tape: Tape, number: int, product: int, values: list[str]
) -> str:
    """Return the sum or difference of a product and a value, rounded once."""
    first, second = tape.nodes[number].arguments
    factors = [values[a] for a in tape.nodes[product].arguments]
    if tape.nodes[product].operation == "twice":
        factors.append(ir.constant(2.0))
    a, b = factors * (2 // len(factors))
    subtracts = tape.nodes[number].operation == "sub"
    if product == first:
        other = values[second]
        return ir.fma(a, b, ir.neg(other) if subtracts else other)
    return ir.fma(ir.neg(a) if subtracts else a, b, values[first])


LARGEST_CHAIN = 8
"""Whole powers up to this one are products."""


def constant_power(ir: VectorIR, base: str, exponent: str, known: float) -> str:
    """Return base to a constant power."""
    if not 1 <= abs(known) <= LARGEST_CHAIN or known != int(known):
        return emit_operation(ir, "pow", [base, exponent])
    product, square, left = "", base, int(abs(known))
    while left:
        if left & 1:
            product = ir.mul(product, square) if product else square
        left >>= 1
        if left:
            square = ir.mul(square, square)
    return ir.div(ir.constant(1.0), product) if known < 0 else product


LIBRARY = {"hypot": "hypot", "remainder": "remainder"}
"""Operations that are called in the C library, lane by lane."""

C_FUNCTIONS = ("sin", "cos", "pow", "fmod", *LIBRARY.values())
"""Functions of the C library that the machine code may call."""

INTRINSICS = {
    "sqrt": "sqrt",
    "floor": "floor",
    "ceil": "ceil",
    "fabs": "fabs",
    "copysign": "copysign",
    "fmin": "minnum",
    "fmax": "maxnum",
}
ARITHMETIC = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
COMPARISONS = {"lt": "olt", "le": "ole", "eq": "oeq", "ne": "une"}


def emit_operation(ir: VectorIR, name: str, arguments: Sequence[str]) -> str:
    """Emit one operation that depends on its arguments' values only."""
    if name in ARITHMETIC:
        return ir.binary(ARITHMETIC[name], *arguments)
    if name in COMPARISONS:
        return ir.flag(ir.compare(COMPARISONS[name], *arguments))
    if name in INTRINSICS:
        return ir.intrinsic(INTRINSICS[name], *arguments)
    if name in LIBRARY:
        return ir.lane_by_lane(LIBRARY[name], *arguments)
    if name in ELEMENTARY:
        make = ELEMENTARY[name]
        return ir.beside(f"vector_{name}", lambda *given: [make(*given)], *arguments)[0]
    if name in SPECIAL:
        return SPECIAL[name](ir, *arguments)
    raise UnknownOperationError(f"the operation {name} is not compiled", name)


def _sin_and_cos(ir: VectorIR, x: str) -> tuple[str, str]:
    sine, cosine = ir.beside("vector_sin_and_cos", sin_and_cos, x)
    return sine, cosine


def _true(ir: VectorIR, value: str) -> str:
    """Return the mask of lanes that count as true: all but zero, NaN included."""
    return ir.compare("une", value, ir.constant(0.0))


def _both(ir: VectorIR, a: str, b: str) -> str:
    return ir.flag(ir.mask_op("and", _true(ir, a), _true(ir, b)))


def _either(ir: VectorIR, a: str, b: str) -> str:
    return ir.flag(ir.mask_op("or", _true(ir, a), _true(ir, b)))


def _not(ir: VectorIR, a: str) -> str:
    return ir.flag(ir.compare("oeq", a, ir.constant(0.0)))


def _if_else_zero(ir: VectorIR, condition: str, value: str) -> str:
    """Select, not multiply: a dead branch may be infinite."""
    return ir.select(_true(ir, condition), value, ir.constant(0.0))


def _sign(ir: VectorIR, a: str) -> str:
    """Return -1, 1, or the zero or NaN itself."""
    zero = ir.constant(0.0)
    positive = ir.select(ir.compare("ogt", a, zero), ir.constant(1.0), a)
    return ir.select(ir.compare("olt", a, zero), ir.constant(-1.0), positive)


def _of_angle(make: Callable[[VectorIR, str, str], str]) -> Callable[..., str]:
    return lambda ir, angle: make(ir, *_sin_and_cos(ir, angle))


OF_ANGLES: dict[str, Callable[[VectorIR, str, str], str]] = {
    "sin": lambda _, sine, cosine: sine,
    "cos": lambda _, sine, cosine: cosine,
    "tan": tan,
}
"""Functions of an angle, computed from its sine and cosine, which are found once."""

SPECIAL: dict[str, Callable[..., str]] = {
    "neg": lambda ir, a: ir.neg(a),
    "sq": lambda ir, a: ir.mul(a, a),
    "twice": lambda ir, a: ir.add(a, a),
    "inv": lambda ir, a: ir.div(ir.constant(1.0), a),
    "not": _not,
    "and": _both,
    "or": _either,
    "if_else_zero": _if_else_zero,
    "sign": _sign,
    **{name: _of_angle(made) for name, made in OF_ANGLES.items()},
}

ELEMENTARY: dict[str, Callable[..., str]] = {
    "exp": exp,
    "log": log,
    "expm1": expm1,
    "log1p": log1p,
    "sinh": sinh,
    "cosh": cosh,
    "tanh": tanh,
    "asinh": asinh,
    "acosh": acosh,
    "atanh": atanh,
    "erf": erf,
    "asin": asin,
    "acos": acos,
    "atan": atan,
    "atan2": atan2,
    "fmod": fmod,
    "pow": power,
}
"""Functions that are written once in a module, and called: as fast as a copy at each
use, and made several times sooner."""
