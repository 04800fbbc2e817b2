"""The best distinct basins that a search has met, each polished; the best is kept.

A search's best point need not lie in the basin of the best local optimum: the search's
archive (`heuristics/archive.py`) keeps the best points that are apart in the box, and
each is a guess for the NLP solver.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.heuristics import SearchResult
from swarmstart.ocp.fitness import Known, unflatten
from swarmstart.ocp.polish import Polished, Polisher, is_better

Array = NDArray[np.float64]


def guesses(result: SearchResult, nu: int) -> list[Array]:
    """Return the controls of a search's best point and of its other basins.

    Args:
        result: What a search found.
        nu: Number of controls.

    Returns:
        Each of shape (nu, N), the best point first.
    """
    others = [
        basin.x for basin in result.basins if not np.array_equal(basin.x, result.x)
    ]
    return [unflatten(x, nu) for x in (result.x, *others)]


def polish_basins(
    polisher: Polisher,
    starts: Sequence[Array],
    x0: ArrayLike,
    known: Known,
    *,
    tolerance: float,
) -> tuple[Polished, int]:
    """Polish from each start; return the best, and the evaluations of all.

    Args:
        polisher: The polisher.
        starts: Controls, each (nu, N), at least one; of equals the first is kept.
        x0: Initial state, shape (nx,).
        known: Parameters and signals.
        tolerance: Largest violation that counts as none.
    """
    best, *others = (polisher(controls, x0, known) for controls in starts)
    evaluations = best.evaluations
    for one in others:
        evaluations += one.evaluations
        found, so_far = ((p.cost, p.violation) for p in (one, best))
        if is_better(found, so_far, tolerance=tolerance):
            best = one
    return best, evaluations
