"""The searches that benchmarks/search.py compares, and how each is timed."""

import itertools
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from swarmstart import heuristics
from swarmstart.arrays import Array
from swarmstart.benchmarks.generation import (
    Draws,
    Shape,
    draw_call,
    evaluate,
    evolution_draws,
    swarm_draws,
)
from swarmstart.benchmarks.problems import Instance, formation, one_uav
from swarmstart.benchmarks.search_rivals import (
    WEIGHT,
    Found,
    Search,
    Task,
    has_pygmo,
    pygmo_de,
    pygmo_pso,
    scipy_de,
)
from swarmstart.benchmarks.timing import Timing, timings
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.heuristics import (
    Algorithm,
    Box,
    Budget,
    ChaoticPSO,
    DifferentialEvolution,
    minimize,
    static_penalty,
)
from swarmstart.ocp import Plan, Planner, SearchSettings
from swarmstart.ocp.nlp.polish_options import IpoptOptions, PolishStatus
from swarmstart.ocp.rollout.fitness import Fitness, Known, Objective

SCENARIO = "formation_v"
OURS = "ours"
IN_PYTHON = "ours, the loop in Python"
SCIPY = "SciPy"
PYGMO = "pygmo"
IPOPT = "IPOPT, cold"


class Effort(NamedTuple):
    """Extent of the measurements.

    Attributes:
        rounds: Turns of each contestant before the clock.
        seeds: Searches of each contestant that its best cost is the median of.
    """

    rounds: int
    seeds: int


FULL, SHORT = Effort(41, 21), Effort(5, 5)


class Case(NamedTuple):
    """One search by several contestants.

    Attributes:
        title: What the tables call it.
        algorithm: Our settings.
        task: What is searched.
        rivals: Name -> search, besides ours.
        bars: Rival -> how many times faster than it ours must be.
    """

    title: str
    algorithm: Algorithm
    task: Task
    rivals: Mapping[str, Search]
    bars: Mapping[str, float]


class Row(NamedTuple):
    """One contestant's line.

    Attributes:
        timing: Seconds of a search.
        cost: Median of the best costs found.
        evaluations: Evaluations of a search.
    """

    timing: Timing
    cost: float
    evaluations: int


class Parts(NamedTuple):
    """Seconds of our search, of its rollouts alone, of its random numbers alone."""

    total: Timing
    rollouts: Timing
    draws: Timing


def shorter_uav(steps: int) -> Instance:
    """Return one UAV that plans fewer steps ahead."""
    uav = one_uav()
    problem = replace(uav.problem, horizon=float(steps), intervals=steps)
    known = Known(signals=np.asarray(uav.known.signals)[:, : steps + 1])
    return Instance(f"one UAV, {steps} steps", problem, uav.x0, known)


def task_of(instance: Instance, size: int, generations: int) -> Task:
    """Return an instance compiled for its search."""
    objective = Fitness(instance.problem).objective(instance.x0, instance.known)
    return Task(instance, objective, size, generations)


def evolution_case(name: str, task: Task) -> Case:
    """Return differential evolution with the same settings for all."""
    settings = DifferentialEvolution(size=task.size, F=0.7, CR=0.7)
    rivals = {SCIPY: scipy_de(task, settings)}
    if has_pygmo():
        rivals[PYGMO] = pygmo_de(task, settings)
    title = f"{name} Differential evolution, {_extent(task)}"
    return Case(title, settings, task, rivals, {SCIPY: 20, PYGMO: 5})


def swarm_case(name: str, task: Task, swarm: Algorithm) -> Case:
    """Return the formation's swarm; pygmo's PSO is another algorithm, no rival."""
    rivals = {}
    if has_pygmo():
        rivals["pygmo's PSO"] = pygmo_pso(task, in_generations=False)
        rivals["pygmo's PSO, our evaluator"] = pygmo_pso(task, in_generations=True)
    title = f"{name} Chaotic particle swarm, {_extent(task)}"
    return Case(title, swarm, task, rivals, {})


def _extent(task: Task) -> str:
    instance = task.instance
    return (
        f"{task.size} x {task.generations}, {instance.dim} variables ({instance.name})"
    )


def box_of(instance: Instance) -> Box:
    """Return the box of an instance's control sequences."""
    problem = instance.problem
    lower, upper = (np.tile(v, problem.intervals) for v in problem.control_limits)
    return Box(lower=lower, upper=upper, per_step=problem.model.nu)


def our_search(case: Case, *, in_python: bool = False) -> Search:
    """Return our search of a case.

    Args:
        case: The case.
        in_python: Whether the objective hides that it is compiled, so that the loop
            over generations runs in Python.
    """
    task = case.task
    box = box_of(task.instance)
    budget, order = (
        Budget(evaluations=task.size * task.generations),
        static_penalty(WEIGHT),
    )
    objective = _hidden(task.objective) if in_python else task.objective

    def search(seed: int) -> Found:
        result = minimize(
            objective,
            box,
            algorithm=case.algorithm,
            budget=budget,
            order=order,
            rng=np.random.default_rng(seed),
        )
        return Found(result.cost + WEIGHT * result.violation, result.evaluations)

    return search


def _hidden(objective: Objective) -> heuristics.Objective:
    """Return the objective as a plain function, which has no `attach`."""

    def plain(population: Array) -> tuple[Array, Array]:
        return objective(population)

    return plain


def draws_of(algorithm: Algorithm, task: Task) -> Draws:
    """Return how many random numbers a search draws, on average.

    The initial population takes one for each coordinate; then each generation has its
    own. The chaotic swarm starts with a seed of the logistic map and a velocity for
    each coordinate, smooth velocities being normal numbers.
    """
    shape, flights = Shape(task.size, task.instance.dim), task.generations - 1
    first = task.size * task.instance.dim
    if isinstance(algorithm, DifferentialEvolution):
        return Draws(first + flights * evolution_draws(shape).uniforms)
    if isinstance(algorithm, ChaoticPSO):
        flown = flights * swarm_draws(shape).uniforms
        if algorithm.initial_velocity == "smooth":
            return Draws(flown + 2 * first, normals=first)
        return Draws(flown + 3 * first)
    raise TypeError(f"the draws of {type(algorithm).__name__} are not counted")


def part_calls(case: Case) -> dict[str, Callable[[], object]]:
    """Return what a search calls its evaluator and its generator for, each alone."""
    task, rng = case.task, np.random.default_rng(0)
    buffers = task.instance.population(task.size, rng), *np.empty((2, task.size))
    pointers = task.objective.attach(*buffers)
    if pointers is None:
        raise RuntimeError(
            "no machine code can be made here: there is no compiled loop"
        )
    draws = draws_of(case.algorithm, task)
    a_generation = Draws(*(number / task.generations for number in draws))

    def rollouts() -> tuple[Array, ...]:
        evaluate(pointers, task.size, task.generations)
        return buffers  # Kept alive by this.

    draw = draw_call(a_generation, task.generations)
    return {"rollouts": rollouts, "draws": draw}


def measure_case(case: Case, effort: Effort) -> tuple[dict[str, Row], Parts]:
    """Return each contestant's line, and the parts of our search."""
    searches = {
        OURS: our_search(case),
        IN_PYTHON: our_search(case, in_python=True),
        **case.rivals,
    }
    calls = {name: _over_seeds(search) for name, search in searches.items()}
    measured = timings(calls | part_calls(case), rounds=effort.rounds)
    rows = {}
    for name, search in searches.items():
        found = [search(seed) for seed in range(effort.seeds)]
        cost = statistics.median(f.cost for f in found)
        rows[name] = Row(measured[name], cost, max(f.evaluations for f in found))
    return rows, Parts(measured[OURS], measured["rollouts"], measured["draws"])


def _over_seeds(search: Callable[[int], object]) -> Callable[[], object]:
    """Return a call that takes the next seed each time."""
    seeds = itertools.count()
    return lambda: search(next(seeds))


class Step(NamedTuple):
    """Plans of one step by one kind of planner.

    Attributes:
        timing: Seconds.
        cost: Sum of the plans' costs, median over the seeds.
        violation: Sum of their violations, likewise.
        feasible: How many are feasible, mean over the seeds.
        statuses: How IPOPT ended; empty for a search.
    """

    timing: Timing
    cost: float
    violation: float
    feasible: float
    statuses: Sequence[PolishStatus]


def measure_step(settings: SearchSettings, effort: Effort) -> dict[str, Step]:
    """Return the first step of the formation, planned by our search and by IPOPT."""
    instances, polish = formation(SCENARIO), IpoptOptions()
    planners = {
        OURS: [Planner(i.problem, search=settings) for i in instances],
        IPOPT: [Planner(i.problem, search=None, polish=polish) for i in instances],
    }
    steps = {name: partial(_planned, p, instances) for name, p in planners.items()}
    measured = timings(
        {name: _over_seeds(step) for name, step in steps.items()}, rounds=effort.rounds
    )
    found = {}
    for name, step in steps.items():
        plans = [step(seed) for seed in range(effort.seeds)]
        sums = [
            [sum(p.cost for p in five), sum(p.violation for p in five)]
            for five in plans
        ]
        cost, violation = np.median(sums, axis=0).tolist()
        found[name] = Step(
            measured[name],
            cost,
            violation,
            feasible=statistics.fmean(sum(p.feasible for p in five) for five in plans),
            statuses=[p.polish_status for p in plans[0] if p.polish_status],
        )
    return found


def _planned(
    planners: Sequence[Planner], instances: Sequence[Instance], seed: int
) -> list[Plan]:
    rng = np.random.default_rng(seed)
    return [
        planner.plan(instance.x0, known=instance.known, rng=rng)
        for planner, instance in zip(planners, instances, strict=True)
    ]


def scenario_search() -> SearchSettings:
    """Return how the formation's planners search."""
    scenario = resolve(read_document(SCENARIO)).scenario
    settings = (
        scenario.search_settings() if isinstance(scenario, FormationScenario) else None
    )
    if settings is None:
        raise TypeError(f"{SCENARIO} searches nothing")
    return settings
