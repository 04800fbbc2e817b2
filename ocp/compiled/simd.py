"""Populations evaluated by machine code made for the function and this processor."""

import ctypes
import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from itertools import accumulate
from typing import NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.machine_code import (
    Pointers,
    compiling,
    load_code,
    source,
    sources,
    store_code,
)
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.compiled.emitter import (
    Roll,
    Ticks,
    emit_flat,
    emit_rollout,
    simplified,
    with_inverses,
)
from swarmstart.ocp.compiled.engine import (
    Compiled,
    NoCompilerError,
    link,
    machine,
    require_short,
    translate,
)
from swarmstart.ocp.compiled.frame import target_of
from swarmstart.ocp.compiled.threads import Later, code_of, in_parts
from swarmstart.ocp.compiled.vectors.vector_ir import Precision
from swarmstart.ocp.interpolation.interpolants import without_interpolants
from swarmstart.tape import read_tape

Shapes = tuple[tuple[int, ...], ...]
Table = ctypes.Array[ctypes.c_void_p]
"""Addresses of arguments or outputs, as a kernel takes them."""

_COPIED = 4096
"""Arguments of up to this many numbers are copied into fixed buffers: to look up the
address of an array takes longer."""

MOST_INSTRUCTIONS = 20_000
"""Largest number of instructions of the functions in a kernel: LLVM would take too long
for more."""

_WITHOUT_CONVERSION = ctypes.CFUNCTYPE(None)
"""Type of functions whose arguments are ctypes objects already."""


class Shape(NamedTuple):
    """Rows of a kernel's arguments and outputs.

    Attributes:
        per_individual: For each argument whether it differs per individual.
        inputs: Entries of each argument.
        outputs: Entries of each output.
    """

    per_individual: tuple[bool, ...]
    inputs: tuple[int, ...]
    outputs: tuple[int, ...]

    def of_arguments(self, size: int) -> Shapes:
        """Return each argument's shape for a number of individuals."""
        return tuple(
            (rows, size) if own else (rows,)
            for rows, own in zip(self.inputs, self.per_individual, strict=True)
        )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Prepared:
    """A kernel bound to fixed buffers: fill, call, read; nothing is allocated.

    Attributes:
        arguments: Buffers to fill in place: (rows, n), or (rows,) if shared.
        outputs: Buffers to read after the call, each (rows, n).
        results: The same memory as one array, (all rows, n).
        pointers: Addresses of a function and of its two arguments, for a caller that is
            compiled itself: void f(double **in, double **out, int64 n).
        size: n, the third argument.
        run: Function that evaluates the arguments into the outputs, as a call does.
        rows: Number of rows of each output.
    """

    arguments: tuple[Array, ...]
    outputs: tuple[Array, ...]
    results: Array
    pointers: Pointers
    size: int
    run: Callable[[], None]
    rows: tuple[int, ...]
    _keeps_alive: object

    def __call__(self) -> None:
        """Evaluate the arguments into the outputs."""
        self.run()

    def split(self, results: Array) -> tuple[Array, ...]:
        """Return each output's part of an array (all rows, n); views."""
        return split(results, self.rows)


class SimdBatch:
    """A BatchEvaluator in machine code.

    Attributes:
        shape: Rows of its arguments and outputs.
        threads: Largest number of threads for a population.
        instructions: Number of instructions of the function for one interval, before
            simplification; 0 if they were not counted.
    """

    backend = "llvm"

    def __init__(
        self,
        compiled: Compiled | Later,
        shape: Shape,
        threads: int = 1,
        *,
        instructions: int = 0,
    ) -> None:
        """Wrap a compiled kernel.

        Args:
            compiled: The kernel, or a kernel that is being made; its first use then
                waits for it, and may raise NoCompilerError.
            shape: Rows of the kernel's arguments and outputs; at least one argument
                differs per individual.
            threads: Largest number of threads for a population, at least 1.
            instructions: Number of instructions of the function for one interval; 0 if
                they were not counted.
        """
        self.instructions = instructions
        self.shape, self.threads = shape, threads
        self._made = compiled

    @property
    def address(self) -> int:
        """Address of void kernel(double **in, double **out, int64 n)."""
        return self._compiled.address

    @property
    def part_address(self) -> int:
        """Address of the kernel's function `part`; see frame.py."""
        return self._compiled.part_address

    @property
    def _compiled(self) -> Compiled:
        made = self._made
        return made.compiled if isinstance(made, Later) else made

    def with_threads(self, threads: int) -> "SimdBatch":
        """Return the same kernel with another number of threads."""
        return SimdBatch(
            self._made, self.shape, threads, instructions=self.instructions
        )

    def bind(self, shared: tuple[Array, ...]) -> "Bound":
        """Return a function population -> outputs; the other arguments are copied."""
        return Bound(self, shared)

    def prepare(self, size: int) -> Prepared:
        """Return the kernel bound to fresh buffers for a number of individuals."""
        arguments = tuple(map(np.empty, self.shape.of_arguments(size)))
        results = np.empty((sum(self.shape.outputs), size))
        outputs = split(results, self.shape.outputs)
        tables = addresses(arguments), addresses(outputs)
        places = tuple(map(ctypes.addressof, tables))
        return Prepared(
            arguments=arguments,
            outputs=outputs,
            results=results,
            pointers=Pointers(self.address, *places),
            size=size,
            run=self.caller(tables, size),
            rows=self.shape.outputs,
            _keeps_alive=(tables, self),
        )

    def caller(self, tables: tuple[Table, Table], size: int) -> Callable[[], None]:
        """Return a function that runs the kernel on the buffers that tables point to.

        Args:
            tables: Addresses of the arguments, and of the outputs, read at each call.
            size: Number of individuals.
        """
        if self.threads > 1:
            part = partial(self._compiled.part, *tables, size)
            return partial(in_parts, part, size, self.threads)
        places = (ctypes.c_void_p(ctypes.addressof(table)) for table in tables)
        return partial(self._unconverted, *places, ctypes.c_int64(size))

    @cached_property
    def _unconverted(self) -> Callable[..., None]:
        """The kernel as a function of ctypes that takes objects of ctypes only."""
        return _WITHOUT_CONVERSION(self.address)

    def evaluate(self, arguments: Sequence[Array]) -> tuple[Array, ...]:
        """Return the outputs for all arguments, each output (rows, size).

        Args:
            arguments: In the function's order, (rows, size), or (rows,) if shared.

        Raises:
            InvalidProblemError: If the kernel reads other shapes.
        """
        size = arguments[self.shape.per_individual.index(True)].shape[1]
        self._require(tuple(a.shape for a in arguments), size)
        return split(InPlace(self, size)(arguments), self.shape.outputs)

    def is_small(self, arguments: Sequence[Array]) -> bool:
        """Return whether arguments are so small that copying them is the faster way."""
        return sum(a.size for a in arguments) <= _COPIED

    def _require(self, shapes: Shapes, size: int) -> None:
        """Validate shapes, since the kernel reads without checks."""
        expected = self.shape.of_arguments(size)
        if shapes != expected:
            raise InvalidProblemError(
                f"arguments must have shapes {expected}, got {shapes}"
            )


class InPlace:
    """A kernel for one number of individuals that reads its arguments in place.

    Tables are reused, so one object must not be called from two threads at once.
    """

    def __init__(self, kernel: SimdBatch, size: int) -> None:
        """Make the tables of addresses.

        Args:
            kernel: The kernel.
            size: Number of individuals.
        """
        shape = kernel.shape
        self._inputs: Table = (ctypes.c_void_p * len(shape.inputs))()
        self._outputs: Table = (ctypes.c_void_p * len(shape.outputs))()
        self._results = sum(shape.outputs), size
        before = accumulate(shape.outputs[:-1], initial=0)
        self._offsets = [
            rows * size * ctypes.sizeof(ctypes.c_double) for rows in before
        ]
        self._run = kernel.caller((self._inputs, self._outputs), size)

    def __call__(self, arguments: Sequence[Array]) -> Array:
        """Return all outputs, (all rows, size).

        Args:
            arguments: Arguments of the right shapes, which are not checked; copied only
                if they are not contiguous doubles.
        """
        given = [np.ascontiguousarray(a, dtype=np.float64) for a in arguments]
        results = np.empty(self._results)
        for number, array in enumerate(given):
            self._inputs[number] = address_of(array)
        first = address_of(results)
        for number, offset in enumerate(self._offsets):
            self._outputs[number] = first + offset
        self._run()
        return results


class Bound:
    """A kernel whose first argument differs per individual, the others fixed.

    Buffers are reused, so one object must not be called from two threads at once.
    """

    def __init__(self, kernel: SimdBatch, shared: tuple[Array, ...]) -> None:
        """Copy the shared arguments.

        Args:
            kernel: The kernel.
            shared: Other arguments of the kernel, flattened column by column.

        Raises:
            InvalidProblemError: If these arguments do not fit the kernel.
        """
        first, *others = kernel.shape.per_individual
        if not first or any(others):
            raise InvalidProblemError(
                "only the first argument may differ per individual, "
                f"got {kernel.shape.per_individual}"
            )
        self._kernel = kernel
        self._dim = kernel.shape.inputs[0]
        self._shared = [np.array(values, dtype=np.float64) for values in shared]
        _require(kernel.shape.inputs[1:], tuple(a.size for a in self._shared))
        self._prepared: dict[tuple[int, ...], Prepared] = {}
        self._in_place: dict[tuple[int, ...], InPlace] = {}
        self._attached: list[object] = []

    def __call__(self, population: Array) -> Array:
        """Return all outputs of a population (dim, size), shape (all rows, size).

        Raises:
            InvalidProblemError: If the kernel reads another number of rows.
        """
        large = self._in_place.get(population.shape)
        if large is not None:
            return large([population, *self._shared])
        prepared = self._prepared.get(population.shape)
        if prepared is None:
            _require((self._dim,), population.shape[:1])
            if population.size > _COPIED:
                large = InPlace(self._kernel, population.shape[1])
                self._in_place[population.shape] = large
                return large([population, *self._shared])
            prepared = self._buffers(population.shape)
        prepared.arguments[0][...] = population
        prepared.run()
        return prepared.results.copy()

    def _buffers(self, shape: tuple[int, ...]) -> Prepared:
        """Return own buffers, in which shared arguments stay."""
        prepared = self._kernel.prepare(shape[1])
        for buffer, values in zip(prepared.arguments[1:], self._shared, strict=True):
            buffer[...] = values
        self._prepared[shape] = prepared
        return prepared

    def attach(self, population: Array, outputs: Sequence[Array]) -> Pointers:
        """Bind the kernel to buffers, for a caller that is compiled itself.

        Args:
            population: Individuals, shape (dim, size), contiguous doubles.
            outputs: A buffer for each output, rows * size contiguous doubles.

        Returns:
            The addresses, valid as long as this object and the buffers live.

        Raises:
            InvalidProblemError: If the buffers are not as above.
        """
        shape, size = self._kernel.shape, population.shape[1]
        _require(shape.inputs[:1], population.shape[:1])
        _require(
            tuple(rows * size for rows in shape.outputs), tuple(a.size for a in outputs)
        )
        for buffer in (population, *outputs):
            if not buffer.flags.c_contiguous or buffer.dtype != np.float64:
                raise InvalidProblemError("buffers must be contiguous doubles")
        # Own buffers, which no later call overwrites.
        inputs, results = addresses([population, *self._shared]), addresses(outputs)
        self._attached.append((inputs, results))
        return Pointers(
            self._kernel.address, ctypes.addressof(inputs), ctypes.addressof(results)
        )


def _require(expected: tuple[int, ...], given: tuple[int, ...]) -> None:
    """Validate shapes, since the kernel reads without checks."""
    if given != expected:
        raise InvalidProblemError(
            f"arguments must have {expected} entries, got {given}"
        )


def split(results: Array, rows: Sequence[int]) -> tuple[Array, ...]:
    """Return each output's part of an array (all rows, n); views."""
    parts, first = [], 0
    for count in rows:
        parts.append(results[first : first + count])
        first += count
    return tuple(parts)


def addresses(arrays: Sequence[Array]) -> Table:
    """Return a table of the addresses of arrays, as a kernel takes it."""
    return (ctypes.c_void_p * len(arrays))(*map(address_of, arrays))


def address_of(array: Array) -> int:
    """Return the address of an array's first entry."""
    # array.ctypes.data takes ten times as long.
    if array.size and array.flags.writeable:
        # NumPy calls a writeable array a buffer from Python 3.12 on only.
        return ctypes.addressof(ctypes.c_char.from_buffer(array))  # type: ignore[arg-type]
    address: int = array.__array_interface__["data"][0]
    return address


def compile_flat(
    function: ca.Function,
    per_individual: tuple[bool, ...],
    *,
    precision: Precision = "double",
    threads: int = 1,
    nonzeros: bool = False,
    quickly: bool = False,
) -> SimdBatch:
    """Return an evaluator of an SX function.

    Args:
        function: An SX function; its interpolants become expressions if possible.
        per_individual: For each argument whether it differs per individual; at least
            one does.
        precision: Precision of the arithmetic; arguments and outputs are doubles.
        threads: Largest number of threads for a population.
        nonzeros: Whether the outputs are their nonzeros, in CasADi's order.
        quickly: Whether the code is compiled ten times as fast, but runs half as fast.

    Raises:
        UnknownOperationError: If the function has an operation that is not compiled.
        NoCompilerError: If machine code cannot be made here.
    """
    function = without_interpolants(function)

    def emit() -> str:
        tape = simplified(read_tape(function, nonzeros=nonzeros))
        return emit_flat(
            tape, per_individual=per_individual, target=target_of([tape], precision)
        )

    entries = function.nnz_out if nonzeros else function.numel_out
    shape = Shape(
        per_individual,
        tuple(function.numel_in(i) for i in range(function.n_in())),
        tuple(entries(i) for i in range(function.n_out())),
    )
    key = key_of([function], (per_individual, precision, nonzeros, quickly))
    return SimdBatch(cached(key, emit, quickly=quickly), shape, threads)


@dataclass(frozen=True, kw_only=True, slots=True)
class Ticking:
    """Steps of adaptive length in an interval; a tick tries one (integration/rodas.py).

    Attributes:
        tick: Function (z, u, p, s) -> z after one trial step, with controls u,
            parameters p, and signals s at two checks. z is (y, largest |y| so far, time
            left, step size h), with y the states and the integrals; time left and h are
            fractions of the time between two checks.
        checks: Number of checks in an interval.
        first: Step size h at the beginning of an interval.
        most: Largest number of trial steps between two checks.
    """

    tick: ca.Function
    checks: int
    first: float
    most: int


def compile_rollout(  # noqa: PLR0913 - a rollout's parts
    stage: ca.Function,
    end: ca.Function,
    *,
    intervals: int,
    signals_per_interval: int,
    decided: Sequence[int | None] = (),
    begin: ca.Function | None = None,
    ticking: Ticking | None = None,
    precision: Precision = "double",
    threads: int = 1,
) -> SimdBatch:
    """Return an evaluator of (decisions, x0, p, signals) -> (cost, violation).

    The decisions are the controls, interval after interval, then the decided initial
    states.

    Args:
        stage: Function (x, u, p, s) -> (x after, cost, violation) over one interval,
            with states x, controls u, parameters p and signals s. With adaptive steps
            it has two more arguments: the states that the steps reach at each check,
            shape (nx, checks), and the integrals.
        end: (x, p, s) -> (cost, violation) at the end.
        intervals: Number of intervals.
        signals_per_interval: Number of signals times number of checks in an interval.
        decided: For each state the number of the decision that it starts at, counted
            after the controls; None if it starts at x0. Empty if all states start at
            x0.
        begin: (x, p, s) -> (cost, violation) at the start; None if nothing is added.
        ticking: The adaptive steps of an interval; None if steps are in the stage.
        precision: Precision of the arithmetic; arguments and outputs are doubles.
        threads: Largest number of threads for a population.

    Raises:
        UnknownOperationError: If a function has an operation that is not compiled.
        NoCompilerError: If machine code cannot be made here.
    """
    nx, nu, np_ = (stage.numel_in(i) for i in range(3))
    places = tuple(decided) or (None,) * nx
    stage, end = without_interpolants(stage), without_interpolants(end)
    begin = None if begin is None else without_interpolants(begin)

    tick = None if ticking is None else without_interpolants(ticking.tick)

    def emit() -> str:
        ticks = None
        if ticking is not None and tick is not None:
            ticks = Ticks(
                tick=simplified(with_inverses(read_tape(tick))),
                checks=ticking.checks,
                first=ticking.first,
                most=ticking.most,
            )
        roll = Roll(
            stage=simplified(read_tape(stage)),
            end=simplified(read_tape(end)),
            intervals=intervals,
            signals_per_interval=signals_per_interval,
            decided=places,
            begin=None if begin is None else simplified(read_tape(begin)),
            ticks=ticks,
        )
        longest, at_least = roll.stage, 1
        if ticks is not None:
            # No tick begins before the previous one is done and judged.
            longest, at_least = ticks.tick, 2
        target = target_of([longest], precision, at_least=at_least)
        return emit_rollout(roll, target=target)

    instructions = stage.n_instructions() + end.n_instructions()
    if ticking is not None and tick is not None:
        instructions += ticking.checks * tick.n_instructions()
    if instructions > MOST_INSTRUCTIONS:
        raise NoCompilerError(
            f"expected at most {MOST_INSTRUCTIONS} instructions in an interval, found "
            f"{instructions}"
        )
    nodes = intervals * signals_per_interval + end.numel_in(2)
    # States may share a decision, so the largest number counts.
    free = 1 + max((row for row in places if row is not None), default=-1)
    rows = (nu * intervals + free, nx, np_, nodes)
    shape = Shape((True, False, False, False), rows, (1, 1))
    functions = [stage, end] if begin is None else [stage, end, begin]
    settings: tuple[object, ...] = (intervals, signals_per_interval, precision, places)
    if ticking is not None and tick is not None:
        functions.append(tick)
        settings += (ticking.checks, ticking.first, ticking.most)
    return SimdBatch(cached(key_of(functions, settings), emit), shape, threads)


def cached(
    key: str, emit: Callable[[], str], *, quickly: bool = False
) -> Compiled | Later:
    """Return machine code from the cache, or make and store it; see `aside`.

    Args:
        key: Hash of the code; see `key_of`.
        emit: Function that returns the LLVM IR of the code.
        quickly: As in `translate`.
    """
    with compiling():
        code = load_code(key)
        if code is not None:
            return link(code)
        ir = emit()
        require_short(ir)

        def make() -> bytes:
            made = translate(ir, quickly=quickly)
            store_code(key, made)
            return made

        made = code_of(make)
        return link(made) if isinstance(made, bytes) else Later(made)


def key_of(
    functions: Sequence[ca.Function],
    settings: tuple[object, ...],
    maker: str = __name__,
) -> str:
    """Return the hash of everything that determines the machine code.

    Args:
        functions: Functions that the code evaluates.
        settings: Other settings that determine the code.
        maker: Name of the module that makes the code, in addition to MAKERS.
    """
    digest = hashlib.sha256(_sources(maker).encode())
    # The processor counts too: machines may share a cache.
    for part in (*(f.serialize() for f in functions), settings, machine()):
        digest.update(repr(part).encode())
    return digest.hexdigest()


HERE = "swarmstart.ocp.compiled"
MAKERS = ("emitter", "engine")
"""The modules that make the code; its version is the hash of their text, imports
included."""


@cache
def _sources(maker: str) -> str:
    """Return the hash of the modules that make the code."""
    makers = sources(*(f"{HERE}.{name}" for name in MAKERS))
    return hashlib.sha256(source(maker) + makers.encode()).hexdigest()
