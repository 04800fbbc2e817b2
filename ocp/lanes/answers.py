"""Results of lanes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LaneAnswers:
    """Results of lanes, in the order of their starts.

    Attributes:
        controls: Shape (nu, N, n), within their bounds.
        starts: Decisions about the start, shape (ny, n).
        states: At the beginning of each interval and at the end, divided by their
            sizes, shape (nx, N + 1, n).
        cost: Cost of the problem's core, shape (n,); infinite if a lane broke down.
        violation: The worst excess in the NLP's scaled numbers, shape (n,).
        iterations: Number of steps, shape (n,).
    """

    controls: Array
    starts: Array
    states: Array
    cost: Array
    violation: Array
    iterations: NDArray[np.int64]
