"""The algorithms and orders that every law is tested on; a compiled objective."""

import ctypes
from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    CMAES,
    LSHADE,
    Algorithm,
    Box,
    ChaoticPSO,
    DifferentialEvolution,
    GeneticAlgorithm,
    Kernels,
    Order,
    ParticleSwarm,
    RandomSearch,
    SelfAdaptiveDE,
    epsilon_level,
    feasibility_first,
    static_penalty,
)
from swarmstart.heuristics.laws.algorithm import take_generation
from swarmstart.heuristics.laws.order import RunningOrder
from swarmstart.heuristics.searches.random_search import (
    RandomSearchSettings,
    RandomSearchState,
)
from swarmstart.machine_code import Pointers

Values = Callable[[Array], tuple[Array, Array]]
SIZE = 9  # odd: the last child of the genetic algorithm has no twin


def _propose(rng, settings, state, asked):  # type: ignore[no-untyped-def]
    dim, size = asked.shape
    for i in range(size):
        for d in range(dim):
            width = settings.upper[d] - settings.lower[d]
            asked[d, i] = settings.lower[d] + width * rng.random()
    if state.generation[0] == 0:
        asked[:] = state.population


def _accept(settings, state, asked, cost, violation):  # type: ignore[no-untyped-def]
    take_generation(settings.order, state, asked, cost, violation)
    state.size[0] = 3 + (5 * state.generation[0]) % 13


BREATHING = Kernels(propose=numba.njit(_propose), accept=numba.njit(_accept))


@dataclass(frozen=True, kw_only=True, slots=True)
class Breathing:
    """Random search with generations of 3 to 15, the first as the budget says."""

    @property
    def kernels(self) -> Kernels:
        return BREATHING

    def first_size(self, box: Box, evaluations: int | None) -> int:
        return 5 if evaluations is None else 8

    def kernel_settings(self, box: Box, order: RunningOrder) -> RandomSearchSettings:
        return RandomSearch().kernel_settings(box, order)

    def start(
        self, box: Box, population: Array, *, rng: np.random.Generator
    ) -> RandomSearchState:
        return RandomSearch().start(box, population, rng=rng)


# Every algorithm of the library must be here: test_laws.py checks it.
ALGORITHMS: tuple[Algorithm, ...] = (
    ChaoticPSO(size=SIZE),
    ParticleSwarm(size=SIZE),
    DifferentialEvolution(size=SIZE),
    GeneticAlgorithm(size=SIZE),
    RandomSearch(size=SIZE),
    SelfAdaptiveDE(size=SIZE),
    LSHADE(size=SIZE),
    CMAES(size=SIZE),
    Breathing(),
)
ORDERS = (feasibility_first(), static_penalty(2.0), epsilon_level(0.125, quantile=0.9))


@pytest.fixture(
    scope="session", params=ALGORITHMS, ids=lambda algorithm: type(algorithm).__name__
)
def algorithm(request: pytest.FixtureRequest) -> Algorithm:
    """Each algorithm in turn."""
    chosen: Algorithm = request.param
    return chosen


@pytest.fixture(scope="session")
def algorithms() -> tuple[Algorithm, ...]:
    """All of them."""
    return ALGORITHMS


@pytest.fixture(
    scope="session", params=ORDERS, ids=("feasibility_first", "penalty", "epsilon")
)
def order(request: pytest.FixtureRequest) -> Order:
    """Each rule in turn."""
    chosen: Order = request.param
    return chosen


KERNEL = ctypes.CFUNCTYPE(
    None,
    ctypes.POINTER(ctypes.POINTER(ctypes.c_double)),
    ctypes.POINTER(ctypes.POINTER(ctypes.c_double)),
    ctypes.c_int64,
)


class Compiled:
    """An objective whose machine code, here a callback, works on raw memory."""

    def __init__(self, values: Values, dim: int) -> None:
        self.calls_from_python = 0
        self._values, self._dim = values, dim
        self._function = KERNEL(self._evaluate)

    def __call__(self, population: Array) -> tuple[Array, Array]:
        self.calls_from_python += 1
        return self._values(population)

    def attach(self, asked: Array, cost: Array, violation: Array) -> Pointers | None:
        double = ctypes.POINTER(ctypes.c_double)
        self._in = (double * 1)(asked.ctypes.data_as(double))
        self._out = (double * 2)(*(a.ctypes.data_as(double) for a in (cost, violation)))
        address = ctypes.cast(self._function, ctypes.c_void_p).value
        return Pointers(
            address or 0, ctypes.addressof(self._in), ctypes.addressof(self._out)
        )

    def _evaluate(self, inputs, outputs, size: int) -> None:  # type: ignore[no-untyped-def]
        population = np.ctypeslib.as_array(inputs[0], (self._dim, size))
        cost, violation = self._values(population)
        np.ctypeslib.as_array(outputs[0], (size,))[:] = cost
        np.ctypeslib.as_array(outputs[1], (size,))[:] = violation


class Refusing(Compiled):
    """A compiled objective that can be called from Python only."""

    def attach(self, asked: Array, cost: Array, violation: Array) -> None:
        return None


@pytest.fixture(scope="session")
def compiled() -> type[Compiled]:
    """The class of compiled objectives: from values and the number of variables."""
    return Compiled


@pytest.fixture(scope="session")
def refusing() -> type[Refusing]:
    """The class of compiled objectives that cannot attach."""
    return Refusing
