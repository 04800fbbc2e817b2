"""Common parts of the tests of jDE and L-SHADE: an objective, and two laws."""

import ctypes
from pathlib import Path

import numpy as np

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    Algorithm,
    Box,
    Budget,
    Order,
    Search,
    SearchResult,
    minimize,
)
from swarmstart.machine_code import Pointers

DIM = 6
BOX = Box(lower=np.full(DIM, -3.0), upper=np.full(DIM, 2.0))
EVALUATIONS = 1500
DOUBLES = ctypes.POINTER(ctypes.c_double)
KERNEL = ctypes.CFUNCTYPE(
    None, ctypes.POINTER(DOUBLES), ctypes.POINTER(DOUBLES), ctypes.c_int64
)


def values(points: Array) -> tuple[Array, Array]:
    """Rippled, constrained, and not finite in a corner."""
    cost = (points**2).sum(axis=0) + np.cos(5.0 * points).sum(axis=0)
    cost = np.where(points[1] > 1.5, np.nan, cost)
    return cost, np.maximum(1.0 - points[0], 0.0)


class Compiled:
    """The same, called from the compiled loop."""

    def __init__(self) -> None:
        self._function = KERNEL(self._evaluate)

    def __call__(self, population: Array) -> tuple[Array, Array]:
        raise AssertionError("called from Python")

    def attach(self, asked: Array, cost: Array, violation: Array) -> Pointers | None:
        self._in = (DOUBLES * 1)(asked.ctypes.data_as(DOUBLES))
        outputs = (array.ctypes.data_as(DOUBLES) for array in (cost, violation))
        self._out = (DOUBLES * 2)(*outputs)
        address = ctypes.cast(self._function, ctypes.c_void_p).value or 0
        return Pointers(
            address, ctypes.addressof(self._in), ctypes.addressof(self._out)
        )

    def _evaluate(self, inputs, outputs, size: int) -> None:  # type: ignore[no-untyped-def]
        results = values(np.ctypeslib.as_array(inputs[0], (DIM, size)))
        for k, result in enumerate(results):
            np.ctypeslib.as_array(outputs[k], (size,))[:] = result


def assert_same(one: SearchResult, other: SearchResult) -> None:
    assert one.generations == other.generations
    assert set(one.snapshot) == set(other.snapshot)
    for name, array in one.snapshot.items():
        np.testing.assert_array_equal(array, other.snapshot[name], err_msg=name)


def assert_both_loops_give_the_same_bits(algorithm: Algorithm, order: Order) -> None:
    results = [
        minimize(
            objective,
            BOX,
            algorithm=algorithm,
            budget=Budget(evaluations=EVALUATIONS),
            order=order,
            rng=np.random.default_rng(3),
        )
        for objective in (values, Compiled())
    ]
    assert_same(*results)
    np.testing.assert_array_equal(results[0].history_cost, results[1].history_cost)


def assert_resumes_bit_for_bit(algorithm: Algorithm, folder: Path) -> None:
    def search(seed: int, **more: object) -> Search:
        rng = np.random.default_rng(seed)
        return Search(algorithm, BOX, rng=rng, evaluations=EVALUATIONS, **more)  # type: ignore[arg-type]

    def advance(searched: Search, generations: int) -> None:
        for _ in range(generations):
            progress = min(searched.evaluations / EVALUATIONS, 1.0)
            searched.tell(*values(searched.ask(progress=progress)))

    whole, first = search(5), search(5)
    advance(whole, 25)
    advance(first, 9)
    np.savez(folder / "snapshot.npz", **first.snapshot())  # type: ignore[arg-type]
    with np.load(folder / "snapshot.npz") as snapshot:
        second = search(6, snapshot=dict(snapshot))
    advance(second, 16)
    expected, found = whole.snapshot(), second.snapshot()
    assert set(expected) == set(found)
    for name, array in expected.items():
        np.testing.assert_array_equal(array, found[name], err_msg=name)
