"""A tape as LLVM IR: the population as vectors, the horizon as a loop.

    void kernel(double **in, double **out, int64 n)

in[i] is an argument: (rows, n), row after row, where it differs per individual; (rows,)
where all share it. out[j] is an output, (rows, n). n is at least the number of lanes;
the last block of individuals is moved back to end at n, so that no lane needs a mask.

A function is emitted flat, or rolled: one stage, looped over the intervals of a horizon
inside the compiled code, so that neither code nor build time grow with the horizon.
"""

from collections.abc import Callable
from dataclasses import dataclass

from swarmstart.ocp.compiled.elementary import UNARY, atan2, sin_and_cos
from swarmstart.ocp.compiled.tape import Tape, UnknownOperationError
from swarmstart.ocp.compiled.vector_ir import VectorIR

Read = Callable[[int, int], str]
"""(argument, dense entry) -> its value."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Roll:
    """A rollout: a stage applied N times, then what is added at the end.

    Attributes:
        stage: (x, u, p, s) -> (x after, cost, violation), s flat over the nodes of one
            interval.
        end: (x, p, s) -> (cost, violation), s at the last node.
        intervals: N.
        signals_per_interval: How far the signals of the next interval are, ns * checks.
    """

    stage: Tape
    end: Tape
    intervals: int
    signals_per_interval: int


def emit_flat(tape: Tape, *, per_individual: tuple[bool, ...], lanes: int) -> str:
    """Return the IR module of a function applied to a population.

    Args:
        tape: The function.
        per_individual: For each argument whether it differs per individual.
        lanes: Doubles in a vector.

    Raises:
        UnknownOperationError: If the tape has an operation that cannot be emitted.
    """
    kernel = _Kernel(lanes, inputs=len(tape.inputs), outputs=len(tape.outputs))

    def read(argument: int, entry: int) -> str:
        if per_individual[argument]:
            return kernel.load_row(argument, str(entry))
        return kernel.load_shared(argument, str(entry))

    outputs = emit_tape(kernel.ir, tape, read)
    for number, values in enumerate(outputs):
        for row, value in enumerate(values):
            kernel.store_row(number, row, value)
    return kernel.finished()


def emit_rollout(roll: Roll, *, lanes: int) -> str:
    """Return the IR module of (controls, x0, p, signals) -> (cost, violation).

    Args:
        roll: The rollout; only the controls differ per individual.
        lanes: Doubles in a vector.

    Raises:
        UnknownOperationError: If a tape has an operation that cannot be emitted.
    """
    kernel = _Kernel(lanes, inputs=4, outputs=2)
    ir = kernel.ir
    nx, nu = roll.stage.inputs[:2]
    initial = [kernel.load_shared(1, str(i)) for i in range(nx)]
    zero = ir.constant(0.0)
    before, loop = ir.block, ir.name("interval")
    ir.lines.append(f"  br label {loop}")
    ir.label(loop)
    k, following = ir.name("k"), ir.name("following")
    carried = [ir.name("carried") for _ in range(nx + 2)]
    head = len(ir.lines)

    u_row = ir.emit(f"mul i64 {k}, {nu}")
    s_first = ir.emit(f"mul i64 {k}, {roll.signals_per_interval}")

    def read(argument: int, entry: int) -> str:
        if argument == 0:
            return carried[entry]
        if argument == 1:
            return kernel.load_row(0, ir.emit(f"add i64 {u_row}, {entry}"))
        if argument == 2:  # noqa: PLR2004 - x, u, p, s
            return kernel.load_shared(2, str(entry))
        return kernel.load_shared(3, ir.emit(f"add i64 {s_first}, {entry}"))

    after, (cost,), (violation,) = emit_tape(ir, roll.stage, read)
    updated = [*after, ir.add(carried[nx], cost), ir.add(carried[nx + 1], violation)]
    ir.lines.append(f"  {following} = add i64 {k}, 1")
    more = ir.emit(f"icmp ult i64 {following}, {roll.intervals}")
    latch, done = ir.block, ir.name("done")
    ir.lines.append(f"  br i1 {more}, label {loop}, label {done}")
    ir.lines[head:head] = [
        f"  {k} = phi i64 [ 0, {before} ], [ {following}, {latch} ]",
        *(
            f"  {name} = phi {ir.vector} [ {first}, {before} ], [ {value}, {latch} ]"
            for name, first, value in zip(
                carried, [*initial, zero, zero], updated, strict=True
            )
        ),
    ]
    ir.label(done)
    last = roll.intervals * roll.signals_per_interval

    def read_end(argument: int, entry: int) -> str:
        if argument == 0:
            return updated[entry]
        if argument == 1:
            return kernel.load_shared(2, str(entry))
        return kernel.load_shared(3, str(last + entry))

    (end_cost,), (end_violation,) = emit_tape(ir, roll.end, read_end)
    kernel.store_row(0, 0, ir.add(updated[nx], end_cost))
    kernel.store_row(1, 0, ir.add(updated[nx + 1], end_violation))
    return kernel.finished()


class _Kernel:
    """The frame of a kernel: its pointers and the loop over blocks of individuals."""

    def __init__(self, lanes: int, *, inputs: int, outputs: int) -> None:
        self.ir = ir = VectorIR(lanes)
        self._inputs = self._pointers("in", inputs)
        self._outputs = self._pointers("out", outputs)
        last = ir.emit(f"sub i64 %n, {lanes}")
        ir.lines.append("  br label %block")
        ir.label("%block")
        self._head = len(ir.lines)
        inside = ir.emit(f"icmp ult i64 %start, {last}")
        self._first = ir.emit(f"select i1 {inside}, i64 %start, i64 {last}")

    def _pointers(self, array: str, count: int) -> list[str]:
        pointers = []
        for number in range(count):
            place = self.ir.emit(f"getelementptr ptr, ptr %{array}, i64 {number}")
            pointers.append(self.ir.emit(f"load ptr, ptr {place}"))
        return pointers

    def _row(self, pointer: str, row: str) -> str:
        """Return the address of this block's individuals in a row."""
        offset = self.ir.emit(f"mul i64 {row}, %n")
        place = self.ir.emit(f"add i64 {offset}, {self._first}")
        return self.ir.emit(f"getelementptr double, ptr {pointer}, i64 {place}")

    def load_row(self, argument: int, row: str) -> str:
        """Return a row of an argument that differs per individual."""
        address = self._row(self._inputs[argument], row)
        return self.ir.emit(f"load {self.ir.vector}, ptr {address}, align 8")

    def load_shared(self, argument: int, entry: str) -> str:
        """Return an entry of an argument that all individuals share."""
        pointer = self._inputs[argument]
        address = self.ir.emit(f"getelementptr double, ptr {pointer}, i64 {entry}")
        return self.ir.broadcast(self.ir.emit(f"load double, ptr {address}, align 8"))

    def store_row(self, output: int, row: int, value: str) -> None:
        """Store a row of an output."""
        address = self._row(self._outputs[output], str(row))
        self.ir.lines.append(
            f"  store {self.ir.vector} {value}, ptr {address}, align 8"
        )

    def finished(self) -> str:
        """Return the module: the loop closed, what is called declared."""
        ir = self.ir
        following = ir.emit(f"add i64 %start, {ir.lanes}")
        more = ir.emit(f"icmp ult i64 {following}, %n")
        latch = ir.block
        ir.lines.append(f"  br i1 {more}, label %block, label %end")
        ir.lines.insert(
            self._head, f"  %start = phi i64 [ 0, %entry ], [ {following}, {latch} ]"
        )
        width = ir.lanes * 64
        return "\n".join(
            [
                "define void @kernel(ptr noalias readonly %in, "
                "ptr noalias readonly %out, i64 %n) #0 {",
                "entry:",
                *ir.lines,
                "end:",
                "  ret void",
                "}",
                *sorted(ir.declarations),
                f'attributes #0 = {{ nounwind "prefer-vector-width"="{width}" '
                f'"min-legal-vector-width"="{width}" }}',
                "",
            ]
        )


def emit_tape(ir: VectorIR, tape: Tape, read: Read) -> list[list[str]]:
    """Emit every value of a tape; return the values of each output.

    Args:
        ir: Where to emit.
        tape: The tape.
        read: Emits the reading of an input.

    Raises:
        UnknownOperationError: If an operation cannot be emitted.
    """
    values: list[str] = []
    both: dict[int, tuple[str, str]] = {}
    for node in tape.nodes:
        if node.operation == "constant":
            values.append(ir.constant(node.value))
        elif node.operation == "input":
            values.append(read(*node.arguments))
        elif node.operation in ("sin", "cos"):
            (argument,) = node.arguments
            if argument not in both:
                both[argument] = sin_and_cos(ir, values[argument])
            values.append(both[argument][node.operation == "cos"])
        elif node.operation == "constpow":
            base, exponent = node.arguments
            known = tape.nodes[exponent].value
            values.append(constant_power(ir, values[base], values[exponent], known))
        else:
            arguments = [values[a] for a in node.arguments]
            values.append(_operation(ir, node.operation, arguments))
    return [[values[number] for number in output] for output in tape.outputs]


LARGEST_CHAIN = 8
"""Whole powers up to this one are products; larger ones the C library's pow."""


def constant_power(ir: VectorIR, base: str, exponent: str, known: float) -> str:
    """Return base to a constant power."""
    if not 1 <= abs(known) <= LARGEST_CHAIN or known != int(known):
        return ir.lane_by_lane("pow", base, exponent)
    power, square, left = "", base, int(abs(known))
    while left:
        if left & 1:
            power = ir.mul(power, square) if power else square
        left >>= 1
        if left:
            square = ir.mul(square, square)
    return ir.div(ir.constant(1.0), power) if known < 0 else power


LIBRARY = {
    name: name
    for name in (
        "tan asin acos sinh cosh asinh acosh atanh log1p expm1 erf pow fmod hypot "
        "remainder"
    ).split()
}
"""Operations that are called in the C library, lane by lane."""

C_FUNCTIONS = ("sin", "cos", *LIBRARY.values())
"""What the machine code may call."""

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


def _operation(ir: VectorIR, name: str, arguments: list[str]) -> str:
    """Emit one operation that needs no more than its arguments' values."""
    if name in ARITHMETIC:
        return ir.binary(ARITHMETIC[name], *arguments)
    if name in COMPARISONS:
        return ir.flag(ir.compare(COMPARISONS[name], *arguments))
    if name in INTRINSICS:
        return ir.intrinsic(INTRINSICS[name], *arguments)
    if name in UNARY:
        return UNARY[name](ir, *arguments)
    if name in LIBRARY:
        return ir.lane_by_lane(LIBRARY[name], *arguments)
    if name in SPECIAL:
        return SPECIAL[name](ir, *arguments)
    raise UnknownOperationError(f"the operation {name} is not compiled")


def _true(ir: VectorIR, value: str) -> str:
    """Return the mask of what counts as true: all but zero, NaN included."""
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
    "atan2": atan2,
}
