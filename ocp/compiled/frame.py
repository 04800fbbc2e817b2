"""The frame of a kernel: its reading and writing, block after block of individuals.

    void kernel(double **in, double **out, int64 n)
    void part(double **in, double **out, int64 n, int64 first, int64 last)

`part` evaluates the individuals from `first`, which is the first of a block, up to
`last` exclusive, which is n or the first of another block. in[i] is an argument:
(rows, n), row after row, if it differs per individual; (rows,) if all share it. out[j]
is an output, (rows, n).

A block is one, two or four vectors; each number of a vector (a lane) belongs to one
individual. Lanes of the last block that are beyond n are masked: neither read nor
written. A processor starts two vector operations per cycle but has each result only
some cycles later. If every operation of a tape waits for the one before it, as in an
integrator of one equation, the processor idles; more vectors fill the gaps. If a tape
has many independent operations, more vectors only crowd the registers.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from swarmstart.ocp.compiled.engine import machine
from swarmstart.ocp.compiled.vectors.vector_ir import (
    DOUBLE,
    FORMATS,
    WEIGHTS,
    Format,
    Module,
    Precision,
    VectorIR,
)
from swarmstart.tape import Tape


@dataclass(frozen=True, kw_only=True, slots=True)
class Target:
    """The processor and precision that code is emitted for.

    Attributes:
        lanes: Numbers in a vector, a power of two.
        precision: Precision of the arithmetic; arguments and outputs are doubles.
        register_bits: Length of a vector register.
        has_scale: See `vector_ir.Module`.
    """

    lanes: int
    precision: Precision = "double"
    register_bits: int = 512
    has_scale: bool = False

    @property
    def form(self) -> Format:
        """The format of the arithmetic."""
        return FORMATS[self.precision]


def target_of(
    tapes: Iterable[Tape], precision: Precision, *, at_least: int = 1
) -> Target:
    """Return the target of code for this machine.

    Args:
        tapes: Tapes that the kernel computes, one after the other.
        precision: Precision of the arithmetic.
        at_least: Least number of vectors in a block.
    """
    here, bits = machine(), FORMATS[precision].bits
    lanes = here.lanes * DOUBLE.bits // bits
    registers = here.lanes * DOUBLE.bits // here.register_bits
    return Target(
        lanes=lanes * max(at_least, side_by_side(tapes, registers=registers)),
        precision=precision,
        register_bits=here.register_bits,
        has_scale=here.has_scale,
    )


# (instructions, cycles until the result is there): round numbers chosen here for recent
# x86 cores. A division keeps its unit busy as long as this many instructions take.
SIMPLE = (1, 4)
COSTS = {
    "div": (24, 24),
    "inv": (24, 24),
    "sqrt": (32, 30),
    "sin": (15, 70),
    "cos": (15, 70),
    "exp": (22, 75),
    "log": (50, 100),
    "tan": (40, 95),
    "expm1": (45, 110),
    "log1p": (85, 150),
    "sinh": (75, 150),
    "cosh": (60, 130),
    "tanh": (85, 160),
    "asinh": (170, 270),
    "acosh": (160, 250),
    "atanh": (120, 200),
    "erf": (110, 170),
    "asin": (65, 110),
    "acos": (65, 110),
    "atan": (75, 110),
    "atan2": (110, 140),
    "fmod": (45, 60),
    "pow": (140, 330),
    "constpow": (140, 330),
}
FREE = ("constant", "input", "neg", "twice")
STARTED_A_CYCLE = 2
LOOK_AHEAD = 1.7
"""Speed of a core by itself, relative to one operation after the other."""
MOST = 4


def side_by_side(tapes: Iterable[Tape], *, registers: int) -> int:
    """Return the number of vectors that a block should have: 1, 2 or 4.

    Args:
        tapes: Tapes that the kernel computes, one after the other.
        registers: Number of registers that one vector needs.
    """
    tapes = tuple(tapes)
    busy = sum(_work(tape) for tape in tapes) * registers / STARTED_A_CYCLE
    waiting = sum(_depth(tape) for tape in tapes)
    times = 1
    while times < MOST and waiting > LOOK_AHEAD * times * busy:
        times *= 2
    return times


def _cost(operation: str) -> tuple[int, int]:
    return (0, 0) if operation in FREE else COSTS.get(operation, SIMPLE)


def _work(tape: Tape) -> int:
    return sum(_cost(node.operation)[0] for node in tape.nodes)


def _depth(tape: Tape) -> int:
    """Return the cycles of the longest chain of operations."""
    ready: list[int] = []
    for node in tape.nodes:
        known = () if node.operation == "input" else node.arguments
        begin = max((ready[a] for a in known), default=0)
        ready.append(begin + _cost(node.operation)[1])
    return max(ready, default=0)


_AHEAD = 16
"""Individuals that are fetched ahead; two cache lines of doubles."""


class Frame:
    """One block of individuals, which a function reads and writes.

    Attributes:
        ir: Writer of the function's body.
        inside: Mask of the lanes that belong to an individual; the last block may have
            more lanes than individuals are left.
    """

    def __init__(self, ir: VectorIR, *, inputs: int, outputs: int) -> None:
        """Emit the addresses of the arguments and outputs, and the mask of the lanes.

        Args:
            ir: Writer of a body in which %in, %out, %n and %start are defined.
            inputs: Number of arguments.
            outputs: Number of outputs.
        """
        self.ir = ir
        self._inputs = self._pointers("in", inputs)
        self._outputs = self._pointers("out", outputs)
        self.inside = self._lanes_inside()

    def _pointers(self, array: str, count: int) -> list[str]:
        pointers = []
        for number in range(count):
            place = self.ir.emit(f"getelementptr ptr, ptr %{array}, i64 {number}")
            pointers.append(self.ir.emit(f"load ptr, ptr {place}"))
        return pointers

    def _lanes_inside(self) -> str:
        """Return the mask of the lanes before the end of the population."""
        ir = self.ir
        vector = f"<{ir.lanes} x i64>"
        left = ir.emit("sub i64 %n, %start")
        first = ir.emit(f"insertelement {vector} poison, i64 {left}, i64 0")
        zeros = f"<{ir.lanes} x i32> zeroinitializer"
        all_left = ir.emit(f"shufflevector {vector} {first}, {vector} poison, {zeros}")
        numbers = ", ".join(f"i64 {lane}" for lane in range(ir.lanes))
        return ir.emit(f"icmp ult {vector} <{numbers}>, {all_left}")

    def _row(self, pointer: str, row: str) -> str:
        """Return the address of this block's individuals in a row."""
        offset = self.ir.emit(f"mul i64 {row}, %n")
        place = self.ir.emit(f"add i64 {offset}, %start")
        return self.ir.emit(f"getelementptr double, ptr {pointer}, i64 {place}")

    def load_row(self, argument: int, row: str) -> str:
        """Return a row of an argument that differs per individual."""
        ir = self.ir
        doubles = f"<{ir.lanes} x double>"
        function = f"@llvm.masked.load.v{ir.lanes}f64.p0"
        ir.module.declarations.add(
            f"declare {doubles} {function}(ptr, i32, {ir.mask}, {doubles})"
        )
        address = self._row(self._inputs[argument], row)
        self._fetch(address)
        loaded = ir.emit(
            f"call {doubles} {function}(ptr {address}, i32 8, "
            f"{ir.mask} {self.inside}, {doubles} zeroinitializer)"
        )
        return ir.converted(loaded, DOUBLE, ir.form)

    def _fetch(self, address: str) -> None:
        """Prefetch memory that a later block of the same row reads.

        A population too large for the caches is read in as many places at once as it
        has rows, which is more than processors prefetch by themselves.
        """
        ir = self.ir
        ir.module.declarations.add("declare void @llvm.prefetch.p0(ptr, i32, i32, i32)")
        later = ir.emit(f"getelementptr double, ptr {address}, i64 {_AHEAD}")
        ir.line(f"call void @llvm.prefetch.p0(ptr {later}, i32 0, i32 3, i32 1)")

    def load_shared(self, argument: int, entry: str) -> str:
        """Return an entry of an argument that all individuals share."""
        ir, pointer = self.ir, self._inputs[argument]
        address = ir.emit(f"getelementptr double, ptr {pointer}, i64 {entry}")
        value = ir.emit(f"load double, ptr {address}, align 8")
        if ir.form != DOUBLE:
            value = ir.emit(f"fptrunc double {value} to {ir.form.name}")
        return ir.broadcast(value)

    def store_row(self, output: int, row: int | str, value: str) -> None:
        """Write a row of an output."""
        ir = self.ir
        doubles = f"<{ir.lanes} x double>"
        function = f"@llvm.masked.store.v{ir.lanes}f64.p0"
        ir.module.declarations.add(
            f"declare void {function}({doubles}, ptr, i32, {ir.mask})"
        )
        value = ir.converted(value, ir.form, DOUBLE)
        address = self._row(self._outputs[output], str(row))
        ir.line(
            f"call void {function}({doubles} {value}, ptr {address}, i32 8, "
            f"{ir.mask} {self.inside})"
        )


def module_of(
    body: Callable[[Frame], None], target: Target, *, inputs: int, outputs: int
) -> str:
    """Return the module whose kernel runs `body` for each block of individuals."""
    module = Module(has_scale=target.has_scale)
    ir = VectorIR(target.lanes, target.form, module=module)
    frame = Frame(ir, inputs=inputs, outputs=outputs)
    body(frame)
    width = target.register_bits
    return "\n".join(
        [
            "define void @kernel(ptr noalias %in, ptr noalias %out, i64 %n) #0 {",
            "  call void @part(ptr %in, ptr %out, i64 %n, i64 0, i64 %n)",
            "  ret void",
            "}",
            "",
            "define void @part(ptr noalias %in, ptr noalias %out, i64 %n, i64 %first, "
            "i64 %last) #0 {",
            "entry:",
            "  br label %blocks",
            "blocks:",
            "  %start = phi i64 [ %first, %entry ], [ %following, %next_block ]",
            "  %more = icmp ult i64 %start, %last",
            "  br i1 %more, label %block, label %end",
            "block:",
            *ir.body.lines,
            "  br label %next_block",
            "next_block:",
            f"  %following = add i64 %start, {target.lanes}",
            "  br label %blocks",
            "end:",
            "  ret void",
            "}",
            "",
            *(function.text for function in module.functions.values()),
            *sorted(module.declarations),
            # Aligned, so that no vector on the stack lies across two cache lines.
            f'attributes #0 = {{ nounwind "stackrealign" '
            f'"prefer-vector-width"="{width}" "min-legal-vector-width"="{width}" }}',
            WEIGHTS,
            "",
        ]
    )
