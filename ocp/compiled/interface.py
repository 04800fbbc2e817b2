"""The one interface behind which populations are evaluated."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class BatchEvaluator(Protocol):
    """A `casadi.Function` applied to every individual of a population.

    The function's first argument differs per individual, the others are shared by all.
    """

    @property
    def backend(self) -> str:
        """What evaluates, as recorded with a run."""

    def __call__(self, population: Array, shared: tuple[Array, ...]) -> list[Array]:
        """Return the outputs of the whole population.

        Args:
            population: Shape (dim, size), one column an individual; not kept.
            shared: The other arguments, flattened column by column; not kept.

        Returns:
            For each output an array of its own, shape (rows, size).
        """
