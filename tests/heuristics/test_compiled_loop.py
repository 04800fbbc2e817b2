"""The loop in compiled code: the same bits as the loop in Python."""

import ctypes
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.heuristics import (
    Algorithm,
    AskTellError,
    Box,
    Budget,
    ChaoticPSO,
    DifferentialEvolution,
    GeneticAlgorithm,
    ParticleSwarm,
    Pointers,
    RandomSearch,
    Search,
    StopReason,
    minimize,
    static_penalty,
)
from swarmstart.heuristics.compiled_loop import CHUNK

Array = NDArray[np.float64]
DIM, SIZE = 6, 12
BOX = Box(lower=np.full(DIM, -3.0), upper=np.full(DIM, 2.0))
ALGORITHMS: tuple[Algorithm, ...] = (
    ChaoticPSO(size=SIZE),
    ParticleSwarm(size=SIZE),
    DifferentialEvolution(size=SIZE),
    GeneticAlgorithm(size=SIZE),
    RandomSearch(size=SIZE),
)
KERNEL = ctypes.CFUNCTYPE(
    None,
    ctypes.POINTER(ctypes.POINTER(ctypes.c_double)),
    ctypes.POINTER(ctypes.POINTER(ctypes.c_double)),
    ctypes.c_int64,
)


def values(population: Array) -> tuple[Array, Array]:
    return (population**2).sum(axis=0), np.maximum(1.0 - population[0], 0.0)


class Compiled:
    """An objective whose machine code, here a callback, works on raw memory."""

    def __init__(self) -> None:
        self.calls_from_python = 0
        self._function = KERNEL(self._evaluate)

    def __call__(self, population: Array) -> tuple[Array, Array]:
        self.calls_from_python += 1
        return values(population)

    def attach(self, asked: Array, cost: Array, violation: Array) -> Pointers | None:
        double = ctypes.POINTER(ctypes.c_double)
        self._in = (double * 1)(asked.ctypes.data_as(double))
        self._out = (double * 2)(*(a.ctypes.data_as(double) for a in (cost, violation)))
        address = ctypes.cast(self._function, ctypes.c_void_p).value
        return Pointers(
            address or 0, ctypes.addressof(self._in), ctypes.addressof(self._out)
        )

    def _evaluate(self, inputs, outputs, size: int) -> None:  # type: ignore[no-untyped-def]
        population = np.ctypeslib.as_array(inputs[0], (DIM, size))
        cost, violation = values(population)
        np.ctypeslib.as_array(outputs[0], (size,))[:] = cost
        np.ctypeslib.as_array(outputs[1], (size,))[:] = violation


class Refusing(Compiled):
    def attach(self, asked: Array, cost: Array, violation: Array) -> None:
        return None


@pytest.mark.parametrize("algorithm", ALGORITHMS, ids=lambda a: type(a).__name__)
def test_both_loops_give_the_same_bits(algorithm: Algorithm) -> None:
    # Not a whole number of chunks, and a budget that no whole generation fills.
    budget = Budget(evaluations=(CHUNK + 7) * SIZE + 5)
    compiled = Compiled()
    results = [
        minimize(
            objective,
            BOX,
            algorithm=algorithm,
            budget=budget,
            order=static_penalty(10.0),
            rng=np.random.default_rng(3),
        )
        for objective in (values, compiled)
    ]
    assert compiled.calls_from_python == 0
    python, loop = results
    np.testing.assert_array_equal(python.x, loop.x)
    np.testing.assert_array_equal(python.history_cost, loop.history_cost)
    np.testing.assert_array_equal(python.history_violation, loop.history_violation)
    assert python.generations == loop.generations == CHUNK + 7
    assert loop.stopped is StopReason.EVALUATIONS
    states = cast(tuple[Array, ...], python.state), cast(tuple[Array, ...], loop.state)
    for one, other in zip(*states, strict=True):
        np.testing.assert_array_equal(one, other)


def test_an_objective_that_cannot_attach_is_called_from_python() -> None:
    refusing = Refusing()
    budget = Budget(evaluations=5 * SIZE)
    result = minimize(
        refusing,
        BOX,
        algorithm=ParticleSwarm(size=SIZE),
        budget=budget,
        rng=np.random.default_rng(4),
    )
    assert refusing.calls_from_python == result.generations == 5


def test_a_callback_is_called_after_every_generation_of_a_compiled_objective() -> None:
    seen: list[int] = []
    minimize(
        Compiled(),
        BOX,
        algorithm=ParticleSwarm(size=SIZE),
        budget=Budget(evaluations=4 * SIZE),
        on_generation=lambda event: seen.append(event.generation),
        rng=np.random.default_rng(5),
    )
    assert seen == [0, 1, 2, 3]


def test_seconds_end_a_compiled_search_after_its_chunk() -> None:
    result = minimize(
        Compiled(),
        BOX,
        algorithm=ParticleSwarm(size=SIZE),
        budget=Budget(evaluations=10**7, seconds=1e-9),
        rng=np.random.default_rng(6),
    )
    assert result.stopped is StopReason.SECONDS
    assert result.generations == CHUNK


def test_loop_before_tell_is_refused() -> None:
    search = Search(ParticleSwarm(size=SIZE), BOX, rng=np.random.default_rng(7))
    search.ask()
    with pytest.raises(AskTellError, match="before tell"):
        search.loop(Compiled(), generations=1, last=0)
