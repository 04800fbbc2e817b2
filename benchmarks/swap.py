"""The antipodal swap: results of IPOPT from several kinds of starts.

    python benchmarks/swap.py --write docs/measured/swap.md

Starts: the initial state at every node; the straight lines on which all meet in the
centre, with and without noise; members of the family drawn at random; and the answer of
a search in the family. A start is where IPOPT begins, states included; all are the same
problem on the same solver.
"""

import statistics
import sys
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import flight_of
from swarmstart.cases.kinds.planar import POSITION
from swarmstart.cases.kinds.transfer.pose import TransferFlight, pose
from swarmstart.cases.kinds.transfer.scenario import TransferScenario
from swarmstart.ocp import Fitness, IpoptOptions, Known, Polisher, zero_controls
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.search.search_space import FamilySpace

NOISES_M = (1e-3, 1.0)
BEST = {"swap_5": 0.390, "swap_8": 1.51}
SEEDS = {"swap_5": 10, "swap_8": 5}
SEARCHES = {
    "L-SHADE": (),
    "DE, F = 0.6, CR = 0.8": ("search={name: de, size: 40, F: 0.6, CR: 0.8}",),
    "chaotic PSO": ("search={name: cpso, size: 40}",),
    "GA": ("search={name: ga, size: 40}",),
}


class Tried(NamedTuple):
    """One way to a plan, from one seed."""

    cost: float
    feasible: bool
    iterations: int | None
    seconds: float


def scenario_of(name: str, *sets: str) -> TransferScenario:
    """Return a shipped transfer with settings changed."""
    scenario = resolve(read_document(name), assignments=sets).scenario
    if not isinstance(scenario, TransferScenario):
        raise TypeError(f"{name} must be a transfer, got {scenario.kind}")
    return scenario


def flight_of_name(name: str, *sets: str) -> TransferFlight:
    """Return the flight of a shipped transfer with settings changed."""
    scenario = scenario_of(name, *sets)
    return flight_of(pose(scenario), scenario)


def straight(space: FamilySpace, x0: Array) -> Start:
    """Return the member without bumps: straight lines."""
    return space.decoded(np.zeros(space.box.dim), x0, Known())


def noisy(start: Start, noise: float, rng: np.random.Generator) -> Start:
    """Return a start with noise on all positions after the first node [m]."""
    if start.states is None:
        return start
    states = start.states.copy()
    for row_ in POSITION:
        states[row_::4, 1:] += noise * rng.normal(size=states[row_::4, 1:].shape)
    return Start(start.controls, states)


def starts_of(
    flight: TransferFlight,
) -> dict[str, tuple[int, Callable[[np.random.Generator], Start]]]:
    """Return the starts without a search: name -> (seeds at most, how one is made)."""
    problem, x0 = flight.loop.planner.problem, flight.x0
    family = flight.posed.agents[0].family
    if family is None:
        raise TypeError("a transfer must search a family of paths")
    space = FamilySpace(flight.loop.planner.fitness, family)
    box, lines = space.box, straight(space, x0)

    def drawn(rng: np.random.Generator) -> Start:
        x = box.lower + box.width * rng.random(box.dim)
        return space.decoded(x, x0, Known())

    def shaken(noise: float) -> Callable[[np.random.Generator], Start]:
        return lambda rng: noisy(lines, noise, rng)

    still = np.repeat(x0[:, None], problem.nodes, axis=1)
    return {
        "zero controls, rolled out": (
            1,
            lambda rng: Start(zero_controls(problem)),
        ),
        "the initial state throughout": (
            1,
            lambda rng: Start(zero_controls(problem), still),
        ),
        "straight lines": (1, lambda rng: lines),
        **{
            f"straight lines, {noise:g} m of noise": (99, shaken(noise))
            for noise in NOISES_M
        },
        "random paths": (99, drawn),
    }


def polished(polish: Polisher, start: Start, x0: Array) -> Tried:
    """Return IPOPT's result from a start."""
    began = time.perf_counter()
    found = polish(start.controls, x0, states=start.states)
    seconds = time.perf_counter() - began
    return Tried(found.cost, found.violation <= 1e-4, found.iterations, seconds)


def searched(name: str, sets: Sequence[str], seeds: int) -> list[Tried]:
    """Return the results of a search followed by IPOPT, for each seed."""
    flight = flight_of_name(name, *sets)
    tried = []
    for seed in range(seeds):
        began = time.perf_counter()
        plan = flight.loop.planner.plan(flight.x0, rng=np.random.default_rng(seed))
        seconds = time.perf_counter() - began
        tried.append(Tried(plan.cost, plan.feasible, None, seconds))
    return tried


def table(name: str, seeds: int) -> list[str]:
    """Return one swap's table as lines of Markdown."""
    flight = flight_of_name(name)
    problem = flight.loop.planner.problem
    polish = Polisher(Fitness(problem), IpoptOptions(max_iterations=400))
    lines = [
        f"## {name}",
        "",
        *head(
            "start", "feasible", f"cost <= {BEST[name]:g}", "cost", "iterations", "s"
        ),
    ]
    for title, (most, made) in starts_of(flight).items():
        tried = [
            polished(polish, made(np.random.default_rng(seed)), flight.x0)
            for seed in range(min(seeds, most))
        ]
        lines.append(_line(title, tried, BEST[name]))
    for title, sets in SEARCHES.items():
        tried = searched(name, sets, seeds)
        lines.append(_line(f"{title}, then IPOPT", tried, BEST[name]))
    return [*lines, ""]


def _line(title: str, tried: Sequence[Tried], best: float) -> str:
    count = len(tried)
    feasible = [t for t in tried if t.feasible]
    costs = sorted(t.cost for t in feasible)
    said = "-"
    if costs:
        low, middle, high = costs[0], statistics.median(costs), costs[-1]
        said = f"{low:.3f} / {middle:.3f} / {high:.3f}"
    iterations = [t.iterations for t in tried if t.iterations is not None]
    return row(
        title,
        f"{len(feasible)} of {count}",
        f"{sum(cost <= best for cost in costs)} of {count}",
        said,
        f"{min(iterations)} to {max(iterations)}" if iterations else "-",
        f"{statistics.median(t.seconds for t in tried):.2f}",
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Solve all, print the tables, and write them where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    options = parser.parse_args(arguments)
    lines = [
        line
        for name, seeds in SEEDS.items()
        for line in table(name, min(seeds, options.seeds))
    ]
    publish(lines[:-1], options, _HEAD)
    return 0


_HEAD = """# The antipodal swap

Made by `python benchmarks/swap.py --write docs/measured/swap.md`; seeds from 0, cost
lowest / median / highest of the feasible ones, seconds the median of one start. A
deterministic start is tried once.

UAVs on a circle of 25 m, headed for its centre, change places in 10 s: the integral of
(a / 2 m/s^2)^2 + (phi / 30 degrees)^2 is the cost, 5 m the least distance. The
scenarios `swap_5` and `swap_8` are solved as one problem by IPOPT from several starts.
The tables keep the distance at 40 checks and repair nothing.

"""


if __name__ == "__main__":
    sys.exit(main())
