"""Assignment of targets to starts with the least sum of squared distances.

The common position of the targets does not matter: moving all of them by c adds

    n |c|^2 - 2 c' sum_i (s_i - q_a(i)),

which is the same for every assignment a.

Source: Kuhn (1955), The Hungarian method for the assignment problem; squared distances
as in Turpin, Michael and Kumar (2014), CAPT.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from swarmstart.arrays import Array


def shortest_assignment(starts: Array, targets: Array) -> NDArray[np.int64]:
    """Return the number of the target of each start, shape (n,).

    Args:
        starts: Shape (n, 2) [m].
        targets: Same number, shape (n, 2) [m].
    """
    squared = np.sum((starts[:, None] - targets[None]) ** 2, axis=2)
    _, columns = linear_sum_assignment(squared)
    return np.asarray(columns, dtype=np.int64)
