"""Populations evaluated by machine code made for the function and this processor."""

import ctypes
import hashlib
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.heuristics import Pointers
from swarmstart.ocp.compiled import cache as code_cache
from swarmstart.ocp.compiled.emitter import Roll, emit_flat, emit_rollout
from swarmstart.ocp.compiled.engine import Compiled, link, machine, translate
from swarmstart.ocp.compiled.tape import read_tape
from swarmstart.ocp.errors import InvalidProblemError

Array = NDArray[np.float64]


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


class SimdBatch:
    """A BatchEvaluator in machine code; see interface.py.

    Attributes:
        call: void kernel(double **in, double **out, int64 n), n at least `lanes`.
        address: Its address.
        shape: What it reads and writes.
        lanes: Individuals in a vector.
    """

    backend = "llvm"

    def __init__(self, compiled: Compiled, shape: Shape) -> None:
        """Take a compiled kernel.

        Args:
            compiled: The kernel.
            shape: What it reads and writes; the first argument differs per individual.
        """
        self.call = compiled.call
        self.address = compiled.address
        self.shape = shape
        self.lanes = machine().lanes
        self._keeps_alive = compiled

    def bind(self, shared: tuple[Array, ...]) -> "Bound":
        """Return population -> outputs, the other arguments fixed and copied."""
        return Bound(self, shared)

    def evaluate(self, arguments: Sequence[Array]) -> list[Array]:
        """Return the outputs for all arguments, each output (rows, size).

        Args:
            arguments: In the function's order, (rows, size), or (rows,) where shared;
                copied only where they are no contiguous doubles.
        """
        _require(self.shape.inputs, tuple(len(a) for a in arguments))
        differs = self.shape.per_individual
        size = arguments[differs.index(True)].shape[1]
        padded = max(size, self.lanes) if size else 0
        given = [
            _filled(a, padded) if own else np.ascontiguousarray(a, dtype=np.float64)
            for a, own in zip(arguments, differs, strict=True)
        ]
        outputs = [np.empty((rows, padded)) for rows in self.shape.outputs]
        if padded:
            self.call(addresses(given), addresses(outputs), padded)
        return [output[:, :size] for output in outputs]


class Bound:
    """A kernel whose first argument differs per individual, the others fixed.

    Nothing is allocated in a call but its outputs; the array of pointers is used again,
    so one object must not be called from two threads at once.
    """

    def __init__(self, kernel: SimdBatch, shared: tuple[Array, ...]) -> None:
        """Copy the shared arguments.

        Args:
            kernel: The kernel.
            shared: Its other arguments, flattened column by column.

        Raises:
            InvalidProblemError: If they are not what the kernel reads.
        """
        first, *others = kernel.shape.per_individual
        if not first or any(others):
            raise InvalidProblemError(
                "only the first argument may differ per individual, "
                f"got {kernel.shape.per_individual}"
            )
        self._kernel = kernel
        self._shared = [np.array(values, dtype=np.float64) for values in shared]
        _require(kernel.shape.inputs[1:], tuple(a.size for a in self._shared))
        self._inputs = addresses([np.empty(0), *self._shared])
        self._results = addresses([np.empty(0)] * len(kernel.shape.outputs))
        self._attached: list[object] = []

    def __call__(self, population: Array) -> list[Array]:
        """Return the outputs of a population (dim, size), each (rows, size).

        Raises:
            InvalidProblemError: If the kernel reads another number of rows.
        """
        _require(self._kernel.shape.inputs[:1], population.shape[:1])
        size = population.shape[1]
        padded = max(size, self._kernel.lanes) if size else 0
        given = _filled(population, padded)
        outputs = [np.empty((rows, padded)) for rows in self._kernel.shape.outputs]
        if padded:
            self._inputs[0] = given.ctypes.data
            for number, output in enumerate(outputs):
                self._results[number] = output.ctypes.data
            self._kernel.call(self._inputs, self._results, padded)
        return outputs if padded == size else [output[:, :size] for output in outputs]

    def attach(self, population: Array, outputs: Sequence[Array]) -> Pointers | None:
        """Bind to buffers, for a caller that is compiled itself.

        Args:
            population: Shape (dim, size), contiguous doubles.
            outputs: One for each output, rows * size doubles, contiguous.

        Returns:
            The addresses, valid as long as this object and the buffers live; None for
            fewer individuals than a vector has lanes.

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
        if size < self._kernel.lanes:
            return None
        # Of its own, which no later call overwrites.
        inputs, results = addresses([population, *self._shared]), addresses(outputs)
        self._attached.append((inputs, results))
        return Pointers(
            self._kernel.address, ctypes.addressof(inputs), ctypes.addressof(results)
        )


def _filled(population: Array, size: int) -> Array:
    """Return contiguous doubles, the last individual repeated up to a size."""
    missing = size - population.shape[1]
    if missing > 0:
        population = np.pad(population, ((0, 0), (0, missing)), mode="edge")
    return np.ascontiguousarray(population, dtype=np.float64)


def _require(expected: tuple[int, ...], given: tuple[int, ...]) -> None:
    """Refuse what would be read beyond its end."""
    if given != expected:
        raise InvalidProblemError(
            f"arguments must have {expected} entries, got {given}"
        )


def addresses(arrays: Sequence[Array]) -> ctypes.Array[ctypes.c_void_p]:
    """Return a table of the addresses of arrays, as a kernel takes it."""
    pointers = [array.ctypes.data for array in arrays]
    return (ctypes.c_void_p * len(pointers))(*pointers)


def compile_flat(function: ca.Function, per_individual: tuple[bool, ...]) -> SimdBatch:
    """Return an evaluator of an SX function.

    Args:
        function: An SX function.
        per_individual: For each argument whether it differs per individual; one does.

    Raises:
        UnknownOperationError: If it has an operation that is not compiled.
        NoCompilerError: If machine code cannot be made here.
    """
    lanes = machine().lanes

    def emit() -> str:
        tape = read_tape(function)
        return emit_flat(tape, per_individual=per_individual, lanes=lanes)

    key = _key([function], per_individual)
    shape = Shape(
        per_individual,
        tuple(function.numel_in(i) for i in range(function.n_in())),
        tuple(function.numel_out(i) for i in range(function.n_out())),
    )
    return SimdBatch(_cached(key, emit), shape)


def compile_rollout(
    stage: ca.Function,
    end: ca.Function,
    *,
    intervals: int,
    signals_per_interval: int,
) -> SimdBatch:
    """Return an evaluator of (controls, x0, p, signals) -> (cost, violation).

    Args:
        stage: (x, u, p, s) -> (x after, cost, violation) over one interval.
        end: (x, p, s) -> (cost, violation) at the end.
        intervals: Number of intervals.
        signals_per_interval: ns * checks.

    Raises:
        UnknownOperationError: If a function has an operation that is not compiled.
        NoCompilerError: If machine code cannot be made here.
    """
    lanes = machine().lanes

    def emit() -> str:
        roll = Roll(
            stage=read_tape(stage),
            end=read_tape(end),
            intervals=intervals,
            signals_per_interval=signals_per_interval,
        )
        return emit_rollout(roll, lanes=lanes)

    nx, nu, np_ = (stage.numel_in(i) for i in range(3))
    nodes = intervals * signals_per_interval + end.numel_in(2)
    shape = Shape((True, False, False, False), (nu * intervals, nx, np_, nodes), (1, 1))
    key = _key([stage, end], (intervals, signals_per_interval))
    return SimdBatch(_cached(key, emit), shape)


def _cached(key: str, emit: Callable[[], str]) -> Compiled:
    """Return machine code from the cache, or make it and keep it."""
    code = code_cache.load(key)
    if code is None:
        code = translate(emit())
        code_cache.store(key, code)
    return link(code)


def _key(functions: Sequence[ca.Function], settings: tuple[object, ...]) -> str:
    """Return the hash of all that determines the machine code."""
    digest = hashlib.sha256(_sources())
    for part in (*(f.serialize() for f in functions), settings, machine()):
        digest.update(repr(part).encode())
    return digest.hexdigest()


@cache
def _sources() -> bytes:
    """Return the hash of the modules that make the code: they are its version."""
    digest = hashlib.sha256()
    for name in ("tape", "vector_ir", "elementary", "emitter", "engine"):
        digest.update(Path(__file__).with_name(f"{name}.py").read_bytes())
    return digest.digest()
