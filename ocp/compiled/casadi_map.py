"""A population evaluated by CasADi's own serial map, through its buffer interface.

Calling a CasADi function costs some 25 microseconds in conversions; with buffers of
fixed size, a call writes and reads plain memory.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from swarmstart.arrays import Array


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Buffers:
    """A mapped function and the memory it reads and writes, for one population size."""

    run: Callable[[], None]
    arguments: list[Array]
    results: list[Array]
    keeps_alive: object


class CasadiMap:
    """A BatchEvaluator on `casadi.Function.map`; see interface.py.

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
        self._buffers: dict[int, _Buffers] = {}

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
            buffers = self._buffers[size] = _allocate(self._function, size)
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


def _allocate(function: ca.Function, size: int) -> _Buffers:
    """Return the function mapped over `size` individuals, bound to fresh memory."""
    shared = list(range(1, function.n_in()))
    mapped = function.map(f"{function.name()}_{size}", "serial", size, shared, [])
    buffer, run = mapped.buffer()
    # CasADi stores column by column: (rows, size) there is (size, rows) here.
    arguments: list[Array] = [np.empty((size, function.numel_in(0)))]
    arguments += [np.empty(function.numel_in(i)) for i in shared]
    results = [np.empty((size, function.numel_out(i))) for i in range(function.n_out())]
    for i, array in enumerate(arguments):
        if array.size:
            buffer.set_arg(i, array.data)  # type: ignore[call-arg]
    for i, array in enumerate(results):
        buffer.set_res(i, array.data)  # type: ignore[call-arg]
    return _Buffers(
        run=run, arguments=arguments, results=results, keeps_alive=(mapped, buffer)
    )
