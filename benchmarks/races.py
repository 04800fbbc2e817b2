"""Races between all ways to evaluate a population.

Every contestant's values are compared with those of CasADi's map before it is timed.
"""

import sys
from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.benchmarks import rivals
from swarmstart.benchmarks.problems import Instance
from swarmstart.benchmarks.rivals import Contestant
from swarmstart.benchmarks.timing import Timing, timings
from swarmstart.ocp.compiled.engine import SIGNATURE
from swarmstart.ocp.compiled.vectors.vector_ir import Precision
from swarmstart.ocp.rollout.fitness import Fitness


def prepared(
    instance: Instance, population: Array, precision: Precision = "double"
) -> Contestant:
    """Return our machine code, called by its address on fixed buffers."""
    size = population.shape[1]
    fitness = Fitness(instance.problem, backend="llvm", precision=precision)
    objective = fitness.objective(instance.x0, instance.known)
    outputs = np.empty(size), np.empty(size)
    pointers = objective.attach(population, *outputs)
    if pointers is None:
        raise RuntimeError(f"no machine code for {size} individuals here")
    run = partial(SIGNATURE(pointers.function), pointers.inputs, pointers.outputs, size)
    return Contestant(run, outputs, (objective, population))


def from_python(instance: Instance, population: Array) -> Contestant:
    """Return our objective, called from Python as a user calls it."""
    objective = Fitness(instance.problem, backend="llvm").objective(
        instance.x0, instance.known
    )
    return Contestant(partial(objective, population))


class Way(NamedTuple):
    """Way to make a contestant, and the demands on its values.

    Attributes:
        make: (instance, population) -> the contestant; None if it is missing.
        tolerance: Largest deviation from the map's values, relative to 1 + |value|.
    """

    make: Callable[[Instance, Array], Contestant | None]
    tolerance: float = 1e-9


MAP, POINTER, PYTHON = "CasADi map", "ours, prepared", "ours, from Python"
SINGLE = "ours, prepared, single precision"
HAND, GENERATED, NUMPY = "SIMD C by hand", "CasADi C code", "NumPy by hand"
CONTESTANTS: Mapping[str, Way] = {
    MAP: Way(rivals.serial_map),
    NUMPY: Way(rivals.numpy_by_hand),
    GENERATED: Way(rivals.generated_c),
    HAND: Way(rivals.hand_written_c),
    PYTHON: Way(from_python),
    POINTER: Way(prepared),
    SINGLE: Way(partial(prepared, precision="single"), tolerance=1e-4),
}


class Race(NamedTuple):
    """Measurements on one problem with one population size.

    Attributes:
        problem: The problem's name.
        size: Individuals.
        seconds: Contestant -> time of one call.
    """

    problem: str
    size: int
    seconds: Mapping[str, Timing]

    def ns(self, contestant: str) -> Timing:
        """Return nanoseconds per rollout."""
        return Timing(*(s / self.size * 1e9 for s in self.seconds[contestant]))

    def ratio(self, contestant: str, to: str = MAP) -> Timing:
        """Return the speed of a contestant relative to another.

        The quartiles are the contestant's, against the other's median.
        """
        other, own = self.seconds[to].median, self.seconds[contestant]
        return Timing(other / own.median, other / own.upper, other / own.lower)


def race(instance: Instance, size: int, *, rounds: int) -> Race:
    """Time all contestants on one population, side by side.

    Raises:
        ArithmeticError: If a contestant's values are not those of CasADi's map.
    """
    print(f"{instance.name}: {size} individuals", file=sys.stderr)
    population = instance.population(size, np.random.default_rng(0))
    made = {name: way.make(instance, population) for name, way in CONTESTANTS.items()}
    racing = {name: one for name, one in made.items() if one is not None}
    right = racing[MAP].values()
    for name, contestant in racing.items():
        tolerance = CONTESTANTS[name].tolerance
        for value, expected in zip(contestant.values(), right, strict=True):
            if not np.allclose(value, expected, tolerance, tolerance, equal_nan=True):
                worst = np.max(np.abs(value - expected) / (1 + np.abs(expected)))
                raise ArithmeticError(f"{name}, {instance.name}: off by {worst:.1e}")
    calls = {name: contestant.run for name, contestant in racing.items()}
    return Race(instance.name, size, timings(calls, rounds=rounds))
