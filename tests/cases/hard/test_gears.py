"""Gears: the best sequence by enumeration is the best known value."""

from itertools import product

import numpy as np
import pytest

from swarmstart.benchmarks.hard.enumeration import all_costs, car
from swarmstart.cases.format.scenario import read_document
from swarmstart.cases.hard.best_known import best_known


def values(name: str, count: int) -> np.ndarray:
    """Return the values of all sequences of a shipped problem, shape (3, ..., 3)."""
    data = read_document(f"hard/{name}").data["constants"]
    assert isinstance(data, dict)
    return -all_costs(car({n: float(str(v)) for n, v in data.items()}), count)


@pytest.mark.parametrize("count", [6, 8, 10])
def test_the_best_known_value_is_the_best_of_all_sequences(count: int) -> None:
    every = values(f"gears_{count}", count)
    best = best_known()[f"hard/gears_{count}"]
    assert best.known_by == "exact" and best.cost is not None
    assert abs(every.max() - best.cost) < 1e-6 * every.max()


def test_several_sequences_are_best_among_those_with_one_other_gear() -> None:
    cube = values("gears_8", 8)
    best = np.ones(cube.shape, dtype=bool)
    for axis, turn in product(range(8), (1, 2)):
        best &= cube >= np.roll(cube, turn, axis=axis)
    assert best.sum() >= 5
