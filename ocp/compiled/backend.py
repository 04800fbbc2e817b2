"""The interface of population evaluators, and the choice of machine code or CasADi.

The choice is `backend`: "llvm", "casadi", or "auto" (None means the same). "auto" takes
the environment's SWARMSTART_BACKEND if it is set, else machine code if that is
possible. If machine code is not possible, CasADi's own serial map evaluates
(`CasadiMap`), and one warning says why.
"""

import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import casadi as ca
import numpy as np

from swarmstart.arguments import checked, optional, text
from swarmstart.arrays import Array
from swarmstart.errors import brief
from swarmstart.machine_code import Pointers
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.messages import Paragraph
from swarmstart.ocp.compiled.engine import NoCompilerError, machine
from swarmstart.tape import UnknownOperationError

Backend = Literal["auto", "llvm", "casadi"]
BACKENDS = get_args(Backend)
VARIABLE = "SWARMSTART_BACKEND"


class BoundEvaluator(Protocol):
    """An evaluator whose shared arguments are fixed."""

    def __call__(self, population: Array) -> Array:
        """Return all outputs in a new array, shape (rows of all outputs, size).

        Args:
            population: Shape (dim, size), a column for each individual; not kept.
        """

    def attach(self, population: Array, outputs: Sequence[Array]) -> Pointers | None:
        """Bind the evaluator to buffers, for a caller that is compiled itself.

        Args:
            population: Individuals, shape (dim, size), contiguous doubles.
            outputs: A buffer for each output, rows * size contiguous doubles.

        Returns:
            The addresses, valid as long as this object and the buffers live; None if
            the evaluator can be called from Python only.
        """


class BatchEvaluator(Protocol):
    """A `casadi.Function` applied to every individual of a population.

    The function's first argument differs per individual, the others are shared by all.
    """

    @property
    def backend(self) -> str:
        """Name of the backend, as recorded with a run."""

    def bind(self, shared: tuple[Array, ...]) -> BoundEvaluator:
        """Return a function population -> outputs, with the other arguments fixed.

        Args:
            shared: The other arguments, flattened column by column; copied.
        """


class BackendWarning(UserWarning):
    """A function is evaluated by CasADi, which is slower, instead of machine code."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class MappedBuffers:
    """A function that CasADi maps, and the memory that it reads and writes.

    Attributes:
        run: Function that evaluates the arguments into the results.
        arguments: Arguments, (size, entries), or (entries,) if all individuals share
            them.
        results: Nonzeros of the outputs, (size, nonzeros).
        keeps_alive: Objects that `run` calls but does not own.
    """

    run: Callable[[], None]
    arguments: list[Array]
    results: list[Array]
    keeps_alive: object


class CasadiMap:
    """A BatchEvaluator on `casadi.Function.map`, through its buffer interface.

    Calling a CasADi function costs some 25 microseconds in conversions; with buffers of
    fixed size, a call writes and reads plain memory.

    Keeps one set of buffers for each population size it has met, so one object must
    not be called from two threads at once.
    """

    backend = "casadi"

    def __init__(self, function: ca.Function) -> None:
        """Prepare the evaluation of a function.

        Args:
            function: Any function with at least one input; its first argument differs
                per individual.
        """
        self._function = function
        self._buffers: dict[int, MappedBuffers] = {}

    def bind(self, shared: tuple[Array, ...]) -> "BoundMap":
        """Return a function that computes the outputs of a population.

        See `BatchEvaluator.bind`.
        """
        return BoundMap(self, shared)

    def evaluate(self, population: Array, shared: list[Array]) -> Array:
        """Return all outputs, (rows of all outputs, size)."""
        size = population.shape[1]
        if size == 0:
            outputs = range(self._function.n_out())
            return np.empty((sum(self._function.numel_out(i) for i in outputs), 0))
        buffers = self._buffers.get(size)
        if buffers is None:
            others = range(1, self._function.n_in())
            buffers = mapped_buffers(self._function, size, others)
            self._buffers[size] = buffers
        np.copyto(buffers.arguments[0], population.T)
        for buffer, values in zip(buffers.arguments[1:], shared, strict=True):
            buffer[...] = values
        buffers.run()
        return np.concatenate([result.T for result in buffers.results])


class BoundMap:
    """A map whose shared arguments are fixed; see BoundEvaluator."""

    def __init__(self, mapped: CasadiMap, shared: tuple[Array, ...]) -> None:
        """Copy the shared arguments."""
        self._map = mapped
        self._shared = [np.array(values, dtype=np.float64) for values in shared]

    def __call__(self, population: Array) -> Array:
        """Return all outputs, (rows of all outputs, size)."""
        return self._map.evaluate(population, self._shared)

    def attach(self, population: Array, outputs: Sequence[Array]) -> None:
        """Return None: CasADi's map is called from Python only."""


def mapped_buffers(
    function: ca.Function, size: int, shared: Sequence[int]
) -> MappedBuffers:
    """Return a function mapped over individuals, bound to fresh memory.

    Args:
        function: The function, with dense arguments.
        size: Number of individuals, at least 1.
        shared: Numbers of the arguments that all individuals share.
    """
    mapped = function.map(f"{function.name()}_{size}", "serial", size, [*shared], [])
    buffer, run = mapped.buffer()
    # CasADi stores column by column: (rows, size) there is (size, rows) here.
    arguments = [
        np.empty(function.numel_in(i) if i in shared else (size, function.numel_in(i)))
        for i in range(function.n_in())
    ]
    results = [np.empty((size, function.nnz_out(i))) for i in range(function.n_out())]
    for i, array in enumerate(arguments):
        if array.size:
            buffer.set_arg(i, array.data)  # type: ignore[call-arg]
    for i, array in enumerate(results):
        if array.size:
            buffer.set_res(i, array.data)  # type: ignore[call-arg]
    return MappedBuffers(
        run=run, arguments=arguments, results=results, keeps_alive=(mapped, buffer)
    )


@checked(refused, backend=optional(text()))
def chosen_backend(backend: str | None = None) -> str:
    """Return the backend that will be tried first: "llvm" or "casadi".

    Args:
        backend: "llvm", "casadi", or "auto" or None, which read the environment.

    Raises:
        InvalidProblemError: If it is not one of these.
    """
    asked = backend or "auto"
    if asked == "auto":
        asked = os.environ.get(VARIABLE) or "auto"
    if asked not in BACKENDS:
        raise InvalidProblemError(
            f"backend (or {VARIABLE}) must be one of {', '.join(BACKENDS)}, "
            f"got {brief(asked)}"
        )
    if asked == "casadi":
        return asked
    try:
        machine()
    except NoCompilerError as error:
        warn_of_casadi(str(error))
        return "casadi"
    return "llvm"


def evaluator(
    compiled: Callable[[], BatchEvaluator],
    mapped: Callable[[], CasadiMap],
    backend: str | None = None,
) -> BatchEvaluator:
    """Return an evaluator: machine code if chosen and possible, else CasADi's map.

    Args:
        compiled: Function that returns the evaluator in machine code.
        mapped: Function that returns the evaluator by CasADi's map.
        backend: As in `chosen_backend`.
    """
    if chosen_backend(backend) == "casadi":
        return mapped()
    try:
        return compiled()
    except (NoCompilerError, UnknownOperationError) as error:
        warn_of_casadi(str(error))
        return mapped()


def warn_of_casadi(reason: str) -> None:
    """Warn that CasADi's map is used, with the reason."""
    warnings.warn(
        f"populations are evaluated by CasADi, not by machine code: {reason} "
        f"(more: {Paragraph.CASADI})",
        BackendWarning,
        stacklevel=3,
    )
