"""Searches of SciPy and pygmo on the benchmarks' problems, with a counted budget.

All minimise cost + 1e4 violation, the static penalty that our searches order by. SciPy
evaluates whole generations with our evaluator; pygmo one individual at a time with
CasADi's function, through its buffer interface.
"""

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import differential_evolution

from swarmstart.arrays import Array
from swarmstart.benchmarks.problems import Instance
from swarmstart.heuristics import DifferentialEvolution
from swarmstart.ocp.rollout.fitness import Objective, shared_arguments
from swarmstart.ocp.rollout.shooting import Shooting

WEIGHT = 1e4
"""Cost of a unit of violation."""


class Found(NamedTuple):
    """Answer of one search.

    Attributes:
        cost: Least cost + WEIGHT violation.
        evaluations: Individuals evaluated for it.
    """

    cost: float
    evaluations: int


Search = Callable[[int], Found]
"""Seed -> answer of the search."""


class Task(NamedTuple):
    """A problem to search, with its effort.

    Attributes:
        instance: The problem.
        objective: Our evaluator of it.
        size: Individuals in a generation.
        generations: Generations, the initial one included.
    """

    instance: Instance
    objective: Objective
    size: int
    generations: int

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the variables, each (dim,)."""
        problem = self.instance.problem
        lower, upper = problem.control_limits
        return np.tile(lower, problem.intervals), np.tile(upper, problem.intervals)


class _Counted:
    """Cost + WEIGHT violation of a population (dim, size); counts individuals."""

    def __init__(self, objective: Objective) -> None:
        self._objective = objective
        self.evaluations = 0

    def __call__(self, population: Array) -> Array:
        self.evaluations += population.shape[1]
        cost, violation = self._objective(population)
        return cost + WEIGHT * violation


def scipy_de(task: Task, settings: DifferentialEvolution) -> Search:
    """Return SciPy's DE/rand/1/bin, vectorised, without polish and early stop."""
    bounds = np.stack(task.bounds, axis=1)

    def search(seed: int) -> Found:
        rng = np.random.default_rng(seed)
        objective = _Counted(task.objective)
        found = differential_evolution(
            objective,
            bounds,
            strategy="rand1bin",
            maxiter=task.generations - 1,
            mutation=settings.F,
            recombination=settings.CR,
            init=task.instance.population(task.size, rng).T,
            rng=rng,
            tol=0.0,
            atol=0.0,
            polish=False,
            updating="deferred",
            vectorized=True,
        )
        return Found(float(found.fun), objective.evaluations)

    return search


def has_pygmo() -> bool:
    """Return whether pygmo, which nothing here needs, is installed."""
    return find_spec("pygmo") is not None


def pygmo_de(task: Task, settings: DifferentialEvolution) -> Search:
    """Return pygmo's DE/rand/1/bin, without early stop."""
    pygmo = import_module("pygmo")

    def algorithm(seed: int) -> Any:
        return pygmo.de(
            gen=task.generations - 1,
            F=settings.F,
            CR=settings.CR,
            variant=7,  # rand/1/bin
            ftol=0.0,
            xtol=0.0,
            seed=seed,
        )

    return _evolved(pygmo, task, _ByCasadi(task), algorithm)


def pygmo_pso(task: Task, *, in_generations: bool) -> Search:
    """Return pygmo's PSO with its own settings.

    Args:
        task: What to search.
        in_generations: Whether generations are evaluated at once by our evaluator,
            instead of individuals by CasADi.
    """
    pygmo = import_module("pygmo")

    def algorithm(seed: int) -> Any:
        swarm = pygmo.pso_gen(gen=task.generations - 1, seed=seed)
        if in_generations:
            swarm.set_bfe(pygmo.bfe())
        return swarm

    problem = _ByGeneration(task) if in_generations else _ByCasadi(task)
    return _evolved(pygmo, task, problem, algorithm)


def _evolved(
    pygmo: Any, task: Task, problem: "_ByCasadi", algorithm: Callable[[int], Any]
) -> Search:
    """Return the search of pygmo's that evolves a random population."""
    wrapped = pygmo.problem(problem)

    def search(seed: int) -> Found:
        population = pygmo.population(wrapped, task.size, seed=seed)
        population = pygmo.algorithm(algorithm(seed + 1)).evolve(population)
        return Found(float(population.champion_f[0]), population.problem.get_fevals())

    return search


class _ByCasadi:
    """A problem as pygmo takes it; CasADi reads and writes memory that stays."""

    def __init__(self, task: Task) -> None:
        instance = task.instance
        function = Shooting(instance.problem).rollout
        shared = shared_arguments(instance.problem, instance.x0, instance.known)
        arguments = [np.zeros(instance.dim), *shared]
        buffer, self._run = function.buffer()
        self._results = np.zeros(2)
        for i, values in enumerate(arguments):
            if values.size:
                buffer.set_arg(i, values.data)  # type: ignore[call-arg]
        for i in range(2):
            buffer.set_res(i, self._results[i : i + 1].data)  # type: ignore[call-arg]
        self._controls, self._bounds = arguments[0], task.bounds
        self._keeps_alive = (function, buffer, arguments)

    def fitness(self, controls: Array) -> tuple[float]:
        self._controls[:] = controls
        self._run()
        cost, violation = self._results.tolist()
        return (cost + WEIGHT * violation,)

    def get_bounds(self) -> tuple[Array, Array]:
        return self._bounds

    def __deepcopy__(self, memo: object) -> "_ByCasadi":
        """Stay one object: pygmo copies a problem for each population."""
        return self


class _ByGeneration(_ByCasadi):
    """The same with our evaluator for whole generations."""

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self._objective, self._dim = task.objective, task.instance.dim

    def batch_fitness(self, individuals: Array) -> Array:
        cost, violation = self._objective(individuals.reshape(-1, self._dim).T)
        return cost + WEIGHT * violation
