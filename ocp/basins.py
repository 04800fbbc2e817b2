"""The best distinct basins that a search has met, each polished; the best is kept.

A search's best point need not lie in the basin of the best local optimum: the search's
archive (`heuristics/archive.py`) keeps the best points that are apart in the box, and
each is a guess for the NLP solver.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.heuristics import SearchResult
from swarmstart.ocp.fitness import Known
from swarmstart.ocp.polish import Polished, Polisher, is_better
from swarmstart.ocp.search_space import Start

Array = NDArray[np.float64]


def points(result: SearchResult) -> list[Array]:
    """Return a search's best point and its other basins, each (dim,), the best first.

    Args:
        result: What a search found.
    """
    others = [
        basin.x for basin in result.basins if not np.array_equal(basin.x, result.x)
    ]
    return [result.x, *others]


def polish_basins(
    polisher: Polisher,
    starts: Sequence[Start],
    x0: ArrayLike,
    known: Known,
    *,
    tolerance: float,
    near: bool,
) -> tuple[Polished, int]:
    """Polish from each start; return the best, and the evaluations of all.

    Args:
        polisher: The polisher.
        starts: At least one; of equals the first is kept.
        x0: Initial state, shape (nx,).
        known: Parameters and signals.
        tolerance: Largest violation that counts as none.
        near: Whether the starts are answers, worth staying near; see Polisher.
    """
    best, *others = (
        polisher(
            start.controls,
            x0,
            known,
            states=start.states,
            near=near and start.states is None,
        )
        for start in starts
    )
    evaluations = best.evaluations
    for one in others:
        evaluations += one.evaluations
        found, so_far = ((p.cost, p.violation) for p in (one, best))
        if is_better(found, so_far, tolerance=tolerance):
            best = one
    return best, evaluations
