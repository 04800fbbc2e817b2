"""An interpreter: one kernel that reads the instructions of any function.

    void kernel(double **in, double **out, int64 n)

LLVM takes longer to compile a roll-out of hundreds of intervals than a whole search
takes to run. This kernel is compiled once on a machine and cached. It reads a
function's instructions from a table and applies each to a block of individuals, so that
reading takes little time compared with the arithmetic.

An instruction is (operation, target, first, second), the last three being places in a
work vector, as CasADi numbers them. in[0] is the argument that differs per individual,
in[1] the shared numbers, constants among them, in[2] the table, in[3] the number of
instructions, in[4] the work vector; out[0] has all outputs.
"""

import hashlib
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.machine_code import compiling, load_code, sources, store_code
from swarmstart.ocp.compiled.backend import BoundMap, CasadiMap
from swarmstart.ocp.compiled.engine import (
    Compiled,
    NoCompilerError,
    link,
    machine,
    translate,
)
from swarmstart.ocp.compiled.frame import Frame, Target, module_of
from swarmstart.ocp.compiled.simd import addresses
from swarmstart.ocp.compiled.vectors.operations import constant_power, emit_operation
from swarmstart.ocp.compiled.vectors.vector_ir import VectorIR
from swarmstart.tape import OPERATIONS, UnknownOperationError

Count = NDArray[np.int64]

VECTORS = 4
"""Vectors of individuals in a block: one instruction is read for all of them."""
_BYTES = 64
"""Length of a cache line, to which a block's vectors are aligned."""
POWERS = range(2, 9)
"""Constant whole powers with an operation of their own."""
NAMES = (
    "row",
    "shared",
    "output",
    *sorted({*OPERATIONS.values()} - {"assign", "lift", "constpow"}),
    *(f"power {k}" for k in POWERS),
)
"""The operations; an operation's code is its place here."""
CODES = {name: code for code, name in enumerate(NAMES)}
_ROW, _SHARED, _OUTPUT = (CODES[name] for name in ("row", "shared", "output"))
_OF_CASADI = {code: CODES[name] for code, name in OPERATIONS.items() if name in CODES}


class Program(NamedTuple):
    """A function as the kernel reads it.

    Attributes:
        table: Instructions, int64, shape (instructions, 4).
        constants: The function's constants, which follow the shared arguments in the
            kernel's array of shared numbers, shape (constants,).
        slots: Length of the work vector.
        rows: Number of rows of all outputs.
    """

    table: Count
    constants: Array
    slots: int
    rows: int


def program_of(function: ca.Function) -> Program:
    """Return an SX function as a table.

    Args:
        function: SX function; its first argument differs per individual, the others are
            shared.

    Raises:
        UnknownOperationError: If the function has an operation that the kernel lacks.
    """
    places_in = [function.sparsity_in(i).find() for i in range(function.n_in())]
    places_out = [function.sparsity_out(i).find() for i in range(function.n_out())]
    shared = np.cumsum(
        [0, 0, *(function.numel_in(i) for i in range(1, function.n_in()))]
    )
    rows = np.cumsum([0, *(function.numel_out(i) for i in range(function.n_out()))])
    table: list[tuple[int, ...]] = []
    constants: list[float] = []
    known: dict[int, float] = {}
    for k in range(function.n_instructions()):
        code, to = function.instruction_id(k), function.instruction_output(k)
        if code == ca.OP_CONST:
            known[to[0]] = value = function.instruction_constant(k)
            at = int(shared[-1]) + len(constants)
            constants.append(value)
            table.append((_SHARED, to[0], at, 0))
            continue
        given = function.instruction_input(k)
        if code == ca.OP_OUTPUT:
            row = int(rows[to[0]]) + places_out[to[0]][to[1]]
            table.append((_OUTPUT, row, given[0], 0))
            continue
        if code == ca.OP_INPUT:
            argument, entry = given
            at = int(shared[argument]) + places_in[argument][entry]
            table.append((_SHARED if argument else _ROW, to[0], at, 0))
        else:
            number = _OF_CASADI.get(code)
            if number is None:
                number = _power(code, known.get(given[-1]))
            table.append((number, to[0], given[0], given[-1]))
        known.pop(to[0], None)  # The place has another value now.
    return Program(
        np.array(table, dtype=np.int64),
        np.array(constants),
        function.sz_w(),
        int(rows[-1]),
    )


def _power(code: int, exponent: float | None) -> int:
    """Return the operation of a constant power; small whole powers have their own."""
    if OPERATIONS.get(code) != "constpow":
        name = OPERATIONS.get(code, f"number {code}")
        raise UnknownOperationError(f"the operation {name} is not interpreted", name)
    whole = exponent is not None and exponent in POWERS
    return CODES[f"power {exponent:.0f}" if whole else "pow"]


class Interpreted:
    """A BatchEvaluator that reads a function's instructions."""

    backend = "llvm"

    def __init__(self, function: ca.Function) -> None:
        """Read a function.

        Args:
            function: An SX function; its first argument differs per individual.

        Raises:
            UnknownOperationError: If the function has an operation that the kernel
                lacks.
            NoCompilerError: If machine code cannot be made here.
        """
        self._kernel = _kernel()
        self._program = program_of(function)
        self._dim = function.numel_in(0)
        self._count = np.array([len(self._program.table)], dtype=np.int64)
        self._work = _aligned(self._program.slots * _lanes())

    def bind(self, shared: tuple[Array, ...]) -> "BoundInterpreted":
        """Return a function population -> outputs; see BatchEvaluator."""
        return BoundInterpreted(self, shared)

    def evaluate(self, population: Array, shared: Array) -> Array:
        """Return all outputs, (rows, size)."""
        given = np.ascontiguousarray(population, dtype=np.float64)
        results = np.empty((self._program.rows, given.shape[1]))
        arguments = [given, shared, self._program.table, self._count, self._work]
        inputs = addresses(arguments)  # type: ignore[arg-type]
        self._kernel.call(inputs, addresses([results]), given.shape[1])
        return results

    def require(self, population: Array) -> None:
        """Validate the population's rows, since the kernel reads without checks."""
        if population.shape[0] != self._dim:
            raise ValueError(
                f"a population must have {self._dim} rows, got {population.shape[0]}"
            )

    @property
    def constants(self) -> Array:
        """The constants, which follow the shared arguments."""
        return self._program.constants


class BoundInterpreted:
    """A function whose shared arguments are fixed; see BoundEvaluator."""

    def __init__(self, function: Interpreted, shared: tuple[Array, ...]) -> None:
        """Copy the shared arguments."""
        self._function = function
        flat = [
            np.array(values, dtype=np.float64).ravel(order="F") for values in shared
        ]
        self._shared = np.concatenate([*flat, function.constants])

    def __call__(self, population: Array) -> Array:
        """Return all outputs, (rows of all outputs, size)."""
        self._function.require(population)
        return self._function.evaluate(population, self._shared)

    def attach(self, population: Array, outputs: Sequence[Array]) -> None:
        """Return None: the function is called from Python only."""


def interpreted(function: ca.Function) -> Interpreted | CasadiMap:
    """Return a function of populations; CasADi's map if no code can be made."""
    try:
        return Interpreted(function)
    except (NoCompilerError, UnknownOperationError):
        return CasadiMap(function)


Bound = BoundInterpreted | BoundMap


def _lanes() -> int:
    return machine().lanes * VECTORS


def _aligned(size: int) -> Array:
    """Return an array that begins at a cache line."""
    raw = np.zeros(size + _BYTES // 8)
    first = -(raw.ctypes.data // 8) % (_BYTES // 8)
    return raw[first : first + size]


@cache
def _kernel() -> Compiled:
    """Return the kernel, from the cache of machine code or made anew."""
    here = machine()
    makers = sources(f"{__name__}", "swarmstart.ocp.compiled.engine")
    key = hashlib.sha256(repr((makers, here, VECTORS)).encode()).hexdigest()
    with compiling():
        code = load_code(key)
        if code is None:
            target = Target(
                lanes=_lanes(),
                register_bits=here.register_bits,
                has_scale=here.has_scale,
            )
            code = translate(module_of(_emit, target, inputs=5, outputs=1))
            store_code(key, code)
        return link(code)


def _emit(frame: Frame) -> None:
    """Emit the loop over the instructions: load one, jump to its operation, return."""
    ir = frame.ir
    table, count, work = (_pointer(ir, number) for number in (2, 3, 4))
    total = ir.emit(f"load i64, ptr {count}, align 8")
    before, head, latch = ir.body.block, ir.name("head"), ir.name("latch")
    done, pc, following = ir.name("done"), ir.name("pc"), ir.name("following")
    ir.line(f"br label {head}")
    ir.label(head)
    ir.line(f"{pc} = phi i64 [ 0, {before} ], [ {following}, {latch} ]")
    fields = ir.emit(f"getelementptr [4 x i64], ptr {table}, i64 {pc}")
    code, to, first, second = (_field(ir, fields, number) for number in range(4))
    labels = [ir.name("operation") for _ in NAMES]
    cases = " ".join(
        f"i64 {number}, label {label}" for number, label in enumerate(labels)
    )
    ir.line(f"switch i64 {code}, label {latch} [ {cases} ]")
    for name, label in zip(NAMES, labels, strict=True):
        ir.label(label)
        _emit_instruction(frame, name, work, (to, first, second))
        ir.line(f"br label {latch}")
    ir.label(latch)
    ir.line(f"{following} = add i64 {pc}, 1")
    more = ir.emit(f"icmp ult i64 {following}, {total}")
    ir.line(f"br i1 {more}, label {head}, label {done}")
    ir.label(done)


def _emit_instruction(
    frame: Frame, name: str, work: str, places: tuple[str, str, str]
) -> None:
    """Emit one operation on the work vector."""
    ir = frame.ir
    to, first, second = places
    if name == "row":
        _store(ir, work, to, frame.load_row(0, first))
    elif name == "shared":
        _store(ir, work, to, frame.load_shared(1, first))
    elif name == "output":
        frame.store_row(0, to, _load(ir, work, first))
    else:
        _store(ir, work, to, _value(ir, name, work, first, second))


def _value(ir: VectorIR, name: str, work: str, first: str, second: str) -> str:
    """Return the value of an operation."""
    a = _load(ir, work, first)
    if name.startswith("power "):
        return constant_power(ir, a, "", float(name.split()[1]))
    if name in BINARY:
        return emit_operation(ir, name, [a, _load(ir, work, second)])
    return emit_operation(ir, name, [a])


BINARY = frozenset(
    "add sub mul div pow lt le eq ne and or fmod copysign if_else_zero fmin fmax atan2 "
    "hypot remainder".split()
)


def _pointer(ir: VectorIR, number: int) -> str:
    place = ir.emit(f"getelementptr ptr, ptr %in, i64 {number}")
    return ir.emit(f"load ptr, ptr {place}")


def _field(ir: VectorIR, fields: str, number: int) -> str:
    place = ir.emit(f"getelementptr i64, ptr {fields}, i64 {number}")
    return ir.emit(f"load i64, ptr {place}, align 8")


def _slot(ir: VectorIR, work: str, place: str) -> str:
    return ir.emit(f"getelementptr {ir.vector}, ptr {work}, i64 {place}")


def _load(ir: VectorIR, work: str, place: str) -> str:
    slot = _slot(ir, work, place)
    return ir.emit(f"load {ir.vector}, ptr {slot}, align {_BYTES}")


def _store(ir: VectorIR, work: str, place: str, value: str) -> None:
    slot = _slot(ir, work, place)
    ir.line(f"store {ir.vector} {value}, ptr {slot}, align {_BYTES}")
