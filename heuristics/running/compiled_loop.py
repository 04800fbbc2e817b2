"""A loop over generations without Python, for objectives that are compiled themselves.

One compiled loop calls propose, evaluate and accept. It returns after a chunk of
generations, to look at the clock and for Ctrl-C. The kernels are those of ask and tell,
called with the same numbers in the same order, so this loop and the one in Python give
the same bits.

The loop calls the kernels at their addresses. So it compiles fast, and each kernel is
compiled only once for both loops.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from swarmstart.arrays import Array
from swarmstart.heuristics.laws.algorithm import Kernels, State
from swarmstart.heuristics.running.archive import Archive, collect
from swarmstart.heuristics.running.budget import (
    GOES_ON,
    UNLIMITED,
    Limits,
    finished,
    progress_of,
)
from swarmstart.machine_code import Count, call_at, call_code, kernel
from swarmstart.machine_code import Pointers as Pointers  # noqa: PLC0414 - public here

CHUNK = 1
"""Generations before the first look at the clock."""
CHUNK_S = 0.02
"""Approximate wall time between two looks at the clock [s]."""
LARGEST_CHUNK = 4096


def next_chunk(generations: int, seconds: float, *, left: float = np.inf) -> int:
    """Return the number of generations to run next.

    Args:
        generations: Number of generations of the last chunk, at least 1.
        seconds: Time that these generations took [s].
        left: Time that is left for the search [s].
    """
    wanted = min(CHUNK_S, max(left, 0.0))
    # The time may be below the clock's resolution.
    fitting = generations * wanted / max(seconds, CHUNK_S / LARGEST_CHUNK)
    return min(max(int(fitting), 1), LARGEST_CHUNK)


class CompiledObjective(Protocol):
    """An objective that can be called without Python."""

    def __call__(self, population: Array) -> tuple[Array, Array]:
        """Return cost and violation, each (size,), of a population (dim, size)."""
        ...

    def attach(self, asked: Array, cost: Array, violation: Array) -> Pointers | None:
        """Bind the objective to buffers, which live as long as the objective is used.

        Args:
            asked: Population to read, shape (dim, size), contiguous.
            cost: Buffer for costs, shape (size,).
            violation: Buffer for violations, shape (size,).

        Returns:
            The addresses; None if the objective can be called from Python only.
        """
        ...


class Work(NamedTuple):
    """Arrays that the compiled loop fills.

    Attributes:
        asked: Memory for the largest population, shape (dim, size). A generation of n
            individuals is stored in its first dim * n numbers, as (dim, n).
        cost: Costs of the individuals in `asked`, shape (size,).
        violation: Violations of the individuals in `asked`, shape (size,).
        best_cost: Best cost after each generation, shape (generations,).
        best_violation: Violation of the best point after each generation, same shape.
        evaluations: Evaluations of the whole search after each generation; int64, same
            shape.
        done: Number of generations run, and the reason to stop, a code of `budget`;
            int64, shape (2,).
    """

    asked: Array
    cost: Array
    violation: Array
    best_cost: Array
    best_violation: Array
    evaluations: Count
    done: Count


def new_work(dim: int, size: int, generations: int) -> Work:
    """Return new arrays for a number of generations of at most `size` individuals."""
    return Work(
        np.empty((dim, size)),
        np.empty(size),
        np.empty(size),
        np.empty(generations),
        np.empty(generations),
        np.empty(generations, dtype=np.int64),
        np.zeros(2, dtype=np.int64),
    )


def can_loop(objective: object) -> bool:
    """Return whether an objective may be called from the compiled loop."""
    import numba

    return hasattr(objective, "attach") and not numba.config.DISABLE_JIT  # type: ignore[attr-defined]


Call = tuple[Callable[..., None], tuple[object, ...]]
"""A kernel and its arguments."""


class Entries(NamedTuple):
    """Addresses of the machine code of an algorithm's kernels.

    Attributes:
        propose: Address of `propose`, for `call_at`.
        accept: Address of `accept`.
        collect: Address of `archive.collect`.
    """

    propose: int
    accept: int
    collect: int


def calls_of(
    kernels: Kernels,
    rng: np.random.Generator,
    settings: Any,
    searched: tuple[State, Archive],
) -> list[Call]:
    """Return the kernels that a generation calls, each with example arguments.

    Returns:
        `propose`, `accept` and `collect`, in the order of `Entries`.
    """
    state, archive = searched
    asked, values = np.empty((state.best.size, 0)), np.empty(0)  # Only types count.
    told = asked, values, values
    return [
        (kernels.propose, (rng, settings, state, asked)),
        (kernels.accept, (settings, state, *told)),
        (collect, (settings.order, archive, *told)),
    ]


@kernel
def loop(  # noqa: PLR0913, PLR0917 - compiled code takes no keywords
    rng: np.random.Generator,
    settings: Any,
    searched: tuple[State, Archive],
    entries: Entries,
    work: Work,
    pointers: Pointers,
    limits: Limits,
) -> None:
    """Run generations until `work` is full or a limit is reached."""
    state, archive = searched
    memory, dim = work.asked.reshape(work.asked.size), state.best.size
    work.done[0] = 0
    for k in range(work.best_cost.size):
        n = state.size[0]
        if n > work.cost.size or state.evaluations[0] + n > limits.evaluations:
            break
        if limits.evaluations < UNLIMITED:  # Else it follows from time, before a chunk.
            state.progress[0] = progress_of(state.evaluations[0], n, limits.evaluations)
        # Contiguous from the first address, to which the objective is bound.
        asked = memory[: dim * n].reshape((dim, n))
        cost, violation = work.cost[:n], work.violation[:n]
        call_at(entries.propose, (rng, settings, state, asked))
        call_code(pointers.function, pointers.inputs, pointers.outputs, (n,))
        call_at(entries.accept, (settings, state, asked, cost, violation))
        told = settings.order, archive, asked, cost, violation
        call_at(entries.collect, told)
        work.best_cost[k] = state.best_cost[0]
        work.best_violation[k] = state.best_violation[0]
        work.evaluations[k] = state.evaluations[0]
        work.done[0] = k + 1
        work.done[1] = finished(settings.order, state, limits)
        if work.done[1] != GOES_ON:
            break
