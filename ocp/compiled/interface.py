"""The one interface behind which populations are evaluated."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swarmstart.heuristics import Pointers

Array = NDArray[np.float64]


class BoundEvaluator(Protocol):
    """An evaluator whose shared arguments are fixed."""

    def __call__(self, population: Array) -> Array:
        """Return all outputs in a new array, shape (rows of all outputs, size).

        Args:
            population: Shape (dim, size), one column an individual; not kept.
        """

    def attach(self, population: Array, outputs: Sequence[Array]) -> Pointers | None:
        """Bind to buffers, for a caller that is compiled itself.

        Args:
            population: Shape (dim, size), contiguous doubles.
            outputs: One for each output, rows * size doubles, contiguous.

        Returns:
            The addresses, valid as long as this object and the buffers live; None
            where only the call from Python works.
        """


class BatchEvaluator(Protocol):
    """A `casadi.Function` applied to every individual of a population.

    The function's first argument differs per individual, the others are shared by all.
    """

    @property
    def backend(self) -> str:
        """What evaluates, as recorded with a run."""

    def bind(self, shared: tuple[Array, ...]) -> BoundEvaluator:
        """Return population -> outputs, for fixed other arguments.

        Args:
            shared: The other arguments, flattened column by column; copied.
        """
