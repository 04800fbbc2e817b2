"""Reports of a search: after a generation, at its end, when it is interrupted."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.errors import Sendable
from swarmstart.heuristics.running.search import Individual, Snapshot


class StopReason(enum.Enum):
    """Reason for the end of a search."""

    EVALUATIONS = "the budget of evaluations is used up"
    SECONDS = "the budget of wall time is used up"
    TARGET = "a feasible point has reached the target"
    STAGNATION = "no better point was found for too long"
    FOUND = "little is left to be found"
    CALLBACK = "on_generation stopped the search"
    INTERRUPTED = "Ctrl-C stopped the search"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class GenerationEvent:
    """A report for `on_generation` after each generation; arrays are read-only.

    Attributes:
        generation: Number of the generation; the initial population is 0.
        evaluations: Number of individuals evaluated so far.
        progress: Fraction of the budget used, in [0, 1].
        best_x: Best point so far, shape (dim,).
        best_cost: Cost of `best_x`.
        best_violation: Violation of `best_x`.
        population: Individuals of the generation as columns, shape (dim, size).
        cost: Costs of these individuals, shape (size,).
        violation: Violations of these individuals, shape (size,).
    """

    generation: int
    evaluations: int
    progress: float
    best_x: Array
    best_cost: float
    best_violation: float
    population: Array
    cost: Array
    violation: Array


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SearchResult:
    """The outcome of a search; arrays are read-only.

    Attributes:
        x: Best point, shape (dim,), in the units of the variables.
        cost: Cost of `x`; infinity if no individual was finite.
        violation: Violation of `x`; 0 = feasible.
        evaluations: Number of individuals evaluated, those before a continuation
            included.
        generations: Number of generations evaluated, the initial population included.
        stopped: Reason for the end of the search.
        history_cost: Cost of the best point after each generation of this call, shape
            (generations of this call,). It may rise while the violation falls.
        history_violation: Violation of the same points, same shape.
        history_evaluations: Evaluations after each generation, those before a
            continuation included, same shape.
        nonfinite: Number of individuals whose cost or violation was not finite.
        basins: The best distinct basins met, the best first; see `archive`.
        seconds: Wall time of this call, without that of loading and compiling machine
            code [s].
        compile_seconds: Wall time of loading and compiling machine code [s].
        snapshot: The whole state of the search at its end; `Search` continues from it.
            The snapshot of an interrupted search has the finished generations only. If
            a generation was interrupted, a continued search draws another one in its
            place.
    """

    x: Array
    cost: float
    violation: float
    evaluations: int
    generations: int
    stopped: StopReason
    history_cost: Array
    history_violation: Array
    history_evaluations: Array
    nonfinite: int
    basins: tuple[Individual, ...]
    seconds: float
    snapshot: Snapshot
    compile_seconds: float = 0.0


class SearchInterrupted(Sendable, KeyboardInterrupt):
    """Ctrl-C ended a search of which at least one generation was finished.

    Attributes:
        partial: The result so far; its `stopped` is INTERRUPTED.

    Example:
        try:
            result = minimize(objective, box, budget=1_000_000, seed=0)
        except SearchInterrupted as interrupted:
            result = interrupted.partial
    """

    def __init__(self, partial: SearchResult) -> None:
        """Store the message and the result."""
        super().__init__(
            f"search interrupted after {partial.evaluations} evaluations, "
            f"best cost {partial.cost:g}"
        )
        self.partial = partial


def locked(values: ArrayLike) -> Array:
    """Return a read-only copy of an array."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array
