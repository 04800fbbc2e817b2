"""Gears: the best sequence by enumeration is the best known value."""

from itertools import product

import numpy as np
import pytest

from swarmstart.cases.format.scenario import read_document
from swarmstart.cases.hard.best_known import best_known
from swarmstart.cases.hard.gears import SHIFT

STEPS = 20


def values(sequences: np.ndarray, constants: dict[str, float]) -> np.ndarray:
    """Return the value of sequences (count, N), by the classical Runge-Kutta method."""
    c, count = constants, len(sequences)
    state = np.stack([np.zeros(count), np.ones(count)])
    shifts = np.diff(np.hstack([np.ones((count, 1)), sequences]), axis=1)

    def rate(state: np.ndarray, gear: np.ndarray) -> np.ndarray:
        x, v = state
        ratio = 0.6 ** (gear - 1)
        pull = ratio * np.exp(-(((ratio * v - 1) / c["width"]) ** 2))
        slope = c["hill"] * np.sin(2 * np.pi * x / c["length"] + c["phase"])
        return np.stack([v, pull - c["drag"] * v - slope])

    h = 1 / STEPS
    for gear in sequences.T:
        for _ in range(STEPS):
            a = rate(state, gear)
            b = rate(state + h / 2 * a, gear)
            d = rate(state + h / 2 * b, gear)
            e = rate(state + h * d, gear)
            state = state + h / 6 * (a + 2 * b + 2 * d + e)
    x, v = state
    return np.asarray(x + v**2 / 2 - SHIFT * (shifts**2).sum(axis=1))


@pytest.mark.parametrize("count", [6, 8, 10])
def test_the_best_known_value_is_the_best_of_all_sequences(count: int) -> None:
    name = f"hard/gears_{count}"
    data = read_document(name).data["constants"]
    assert isinstance(data, dict)
    sequences = np.array([*product((1.0, 2.0, 3.0), repeat=count)])
    every = values(sequences, {n: float(str(v)) for n, v in data.items()})
    best = best_known()[name]
    assert best.known_by == "exact" and best.cost is not None
    assert abs(every.max() - best.cost) < 1e-6 * every.max()


def test_several_sequences_are_best_among_those_with_one_other_gear() -> None:
    data = read_document("hard/gears_8").data["constants"]
    assert isinstance(data, dict)
    sequences = np.array([*product((1.0, 2.0, 3.0), repeat=8)])
    every = values(sequences, {n: float(str(v)) for n, v in data.items()})
    cube = every.reshape((3,) * 8)
    best = np.ones(cube.shape, dtype=bool)
    for axis, turn in product(range(8), (1, 2)):
        best &= cube >= np.roll(cube, turn, axis=axis)
    assert best.sum() >= 5
