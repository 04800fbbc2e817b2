"""What lanes end with."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LaneAnswers:
    """What lanes ended with, in the order of their starts.

    Attributes:
        controls: Shape (nu, N, n), within their bounds.
        starts: What is decided about the start, shape (ny, n).
        states: As intervals begin and in the end, divided by their sizes, shape
            (nx, N + 1, n).
        cost: Of the problem's core, shape (n,); infinite where a lane broke down.
        violation: The worst excess in the NLP's numbers near one, shape (n,).
        iterations: Steps, shape (n,).
    """

    controls: Array
    starts: Array
    states: Array
    cost: Array
    violation: Array
    iterations: NDArray[np.int64]
