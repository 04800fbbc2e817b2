"""Cost of a generation without the objective, against drawing its random numbers.

python benchmarks/generation.py [--short] [--write docs/measured/generation_speed.md]
"""

import ctypes
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numba
import numpy as np

from swarmstart.arrays import Array
from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.benchmarks.timing import timings
from swarmstart.heuristics import (
    LSHADE,
    Algorithm,
    Box,
    DifferentialEvolution,
    ParticleSwarm,
    Pointers,
    SelfAdaptiveDE,
)
from swarmstart.heuristics.running.budget import UNLIMITED, Limits
from swarmstart.heuristics.running.compiled_loop import Work, new_work
from swarmstart.heuristics.running.search import Search
from swarmstart.heuristics.searches.jde import TAU_1, TAU_2
from swarmstart.heuristics.searches.trials import FIRST_MEMORY, SPREAD
from swarmstart.machine_code import call_code
from swarmstart.machine_code.numba_kernels import kernel

carray = numba.carray  # type: ignore[attr-defined]

BAR = 4.0
"""Largest cost of a generation, relative to drawing its random numbers."""

GENERATIONS = 400
"""Generations of a measurement; few enough that the swarm does not come to rest."""

UNBOUNDED = Limits(evaluations=UNLIMITED, target=-math.inf, stagnation=0)
"""The budget is never used up: the population of L-SHADE stays as large as it was."""


class Shape(NamedTuple):
    """Number of individuals, and of variables."""

    size: int
    dim: int


SHAPES = (Shape(20, 16), Shape(100, 10), Shape(100, 80))


class Draws(NamedTuple):
    """Random numbers of a generation, on average.

    Attributes:
        uniforms: In [0, 1).
        normals: Standard normal.
        cauchys: Standard Cauchy, made of a uniform one by a tangent.
    """

    uniforms: float
    normals: float = 0.0
    cauchys: float = 0.0


def swarm_draws(shape: Shape) -> Draws:
    """Return r1 and r2 for each coordinate; reflection draws nothing."""
    return Draws(2.0 * shape.size * shape.dim)


def evolution_draws(shape: Shape) -> Draws:
    """DE/rand/1/bin, for each individual: donors, coordinates.

    Three others by rejection (`trials.draw_three_others`), in the mean s / (s - 1),
    s / (s - 2), s / (s - 3) tries of s; the coordinate that is crossed in any case, and
    one number for each coordinate (`trials.cross_binomially`). Midpoint repair draws
    nothing.
    """
    s = shape.size
    others = sum(s / (s - k) for k in (1, 2, 3))
    return Draws(s * (others + 1.0 + shape.dim))


def adaptive_draws(shape: Shape) -> Draws:
    """Return the draws of DE, and those of the new F and CR of some individuals."""
    own = 2.0 + TAU_1 + TAU_2
    return Draws(evolution_draws(shape).uniforms + shape.size * own)


def history_draws(shape: Shape) -> Draws:
    """L-SHADE, for each individual: parameters, donors, coordinates.

    A slot of the memory, a normal number for CR, Cauchy numbers until F > 0
    (`trials.draw_parameters`), taken for M_F = 0.5 as at the beginning; a
    leader and two others without rejection; those of the crossover as in DE. What a
    full archive draws to delete members, at most one for each individual, is left out.
    """
    refused = 0.5 - math.atan(FIRST_MEMORY / SPREAD) / math.pi
    return Draws(
        shape.size * (1.0 + 1.0 + 2.0 + 1.0 + shape.dim),
        normals=shape.size,
        cauchys=shape.size / (1.0 - refused),
    )


class Kind(NamedTuple):
    """An algorithm.

    Attributes:
        name: What the table calls it.
        settings: From the number of individuals; all else as by default.
        draws: What a generation draws.
        bar: Whether the bar is for it.
    """

    name: str
    settings: Callable[[int], Algorithm]
    draws: Callable[[Shape], Draws]
    bar: bool = True


KINDS = (
    Kind("PSO", lambda size: ParticleSwarm(size=size), swarm_draws),
    Kind(
        "PSO on a ring of 4",
        lambda size: ParticleSwarm(size=size, neighbours=4),
        swarm_draws,
    ),
    Kind("DE", lambda size: DifferentialEvolution(size=size), evolution_draws),
    Kind("jDE", lambda size: SelfAdaptiveDE(size=size), adaptive_draws),
    Kind("L-SHADE", lambda size: LSHADE(size=size), history_draws),
)


def sphere_kernel(dim: int) -> Any:
    """Compile a sum of squares, no violation, as the loop calls it."""
    pointer = numba.types.CPointer
    doubles = pointer(pointer(numba.types.float64))  # type: ignore[no-untyped-call]

    @numba.cfunc(numba.types.void(doubles, doubles, numba.types.int64))
    def evaluate(inputs: Any, outputs: Any, size: int) -> None:
        x = carray(inputs[0], (dim, size))
        cost = carray(outputs[0], (size,))
        violation = carray(outputs[1], (size,))
        cost[:] = 0.0
        violation[:] = 0.0
        for d in range(dim):
            for i in range(size):
                cost[i] += x[d, i] * x[d, i]

    return evaluate


class Sphere:
    """A compiled objective, about as cheap as one that reads its points can be."""

    def __init__(self, dim: int) -> None:
        """Compile it."""
        self._kernel = sphere_kernel(dim)

    def __call__(self, population: Array) -> tuple[Array, Array]:
        """Return cost and violation of a population (dim, size)."""
        return (population**2).sum(axis=0), np.zeros(population.shape[1])

    def attach(self, asked: Array, cost: Array, violation: Array) -> Pointers:
        """Bind to buffers; see `CompiledObjective`."""
        double = ctypes.POINTER(ctypes.c_double)
        self._buffers = asked, cost, violation
        self._in = (double * 1)(asked.ctypes.data_as(double))
        self._out = (double * 2)(*(a.ctypes.data_as(double) for a in (cost, violation)))
        first, second = ctypes.addressof(self._in), ctypes.addressof(self._out)
        return Pointers(self._kernel.address, first, second)


@kernel
def draw(
    rng: np.random.Generator, counts: tuple[int, int, int], numbers: Array, times: int
) -> None:
    """Draw the numbers of a generation into an array, several times.

    They are stored, not summed: to carry a sum through calls of the generator takes
    longer than the calls.

    Args:
        rng: Source of the numbers.
        counts: Number of uniform, normal and Cauchy numbers.
        numbers: Array that they are stored in, shape (at least their sum,).
        times: Number of generations.
    """
    uniforms, normals, cauchys = counts
    for _ in range(times):
        for k in range(uniforms):
            numbers[k] = rng.random()
        for k in range(uniforms, uniforms + normals):
            numbers[k] = rng.standard_normal()
        for k in range(uniforms + normals, uniforms + normals + cauchys):
            numbers[k] = math.tan(math.pi * (rng.random() - 0.5))


@kernel
def evaluate(pointers: Pointers, size: int, generations: int) -> None:
    """Evaluate some generations, with nothing in between."""
    for _ in range(generations):
        call_code(pointers.function, pointers.inputs, pointers.outputs, (size,))


class Row(NamedTuple):
    """A line of the table.

    Attributes:
        kind: The algorithm.
        shape: Individuals and variables.
        generation: Seconds of a generation apart from the objective.
        objective: Seconds of the objective.
        draws: Seconds of the draws.
    """

    kind: Kind
    shape: Shape
    generation: float
    objective: float
    draws: float

    @property
    def ratio(self) -> float:
        """A generation by its draws."""
        return self.generation / self.draws

    @property
    def is_missed(self) -> bool:
        """Return whether the bar applies and is not reached."""
        return self.kind.bar and not self.ratio <= BAR


def measure(rounds: int) -> Iterator[Row]:
    """Measure all algorithms of a shape side by side."""
    for shape in SHAPES:
        objective = Sphere(shape.dim)
        box = Box(lower=np.full(shape.dim, -1.0), upper=np.full(shape.dim, 2.0))
        work = new_work(shape.dim, shape.size, 1)
        work.asked[:] = np.random.default_rng(0).random(work.asked.shape)
        alone = Sphere(shape.dim)
        pointers = alone.attach(work.asked, work.cost, work.violation)
        calls: dict[str, Callable[[], object]] = {
            "objective": partial(evaluate, pointers, shape.size, GENERATIONS)
        }
        for kind in KINDS:
            run = partial(searched, kind.settings(shape.size), box, objective)
            calls[f"{kind.name}, long"] = partial(run, 1 + GENERATIONS)
            calls[f"{kind.name}, short"] = partial(run, 1)
            calls[f"{kind.name}, draws"] = draw_call(kind.draws(shape), GENERATIONS)
        seconds = {n: t.median for n, t in timings(calls, rounds=rounds).items()}
        spent = seconds["objective"] / GENERATIONS
        for kind in KINDS:
            long, short = seconds[f"{kind.name}, long"], seconds[f"{kind.name}, short"]
            yield Row(
                kind,
                shape,
                generation=(long - short) / GENERATIONS - spent,
                objective=spent,
                draws=seconds[f"{kind.name}, draws"] / GENERATIONS,
            )


def draw_call(draws: Draws, generations: int) -> Callable[[], object]:
    """Return a call that draws the numbers of so many generations."""
    uniforms, normals, cauchys = (round(n) for n in draws)
    counts, numbers = (uniforms, normals, cauchys), np.empty(round(sum(draws)) + 3)
    return partial(draw, np.random.default_rng(0), counts, numbers, generations)


def searched(
    algorithm: Algorithm, box: Box, objective: Sphere, generations: int
) -> Work | None:
    """Begin a search and run so many generations of it in the compiled loop."""
    search = Search(algorithm, box, rng=np.random.default_rng(0))
    return search.loop(
        objective, generations=generations, limits=UNBOUNDED, progress=0.0
    )


def table(rows: Sequence[Row]) -> list[str]:
    """Return the lines of the table."""
    lines = head(
        "algorithm", "individuals x variables", "us a generation", "us of its draws",
        "ratio", "at most", "reached", "us of the objective, subtracted",
    )  # fmt: skip
    for one in rows:
        bar = (f"{BAR:g}", "no" if one.is_missed else "yes")
        cells = (
            one.kind.name,
            f"{one.shape.size} x {one.shape.dim}",
            f"{1e6 * one.generation:.3g}",
            f"{1e6 * one.draws:.3g}",
            f"{one.ratio:.2f}",
            *(bar if one.kind.bar else ("-", "-")),
            f"{1e6 * one.objective:.2g}",
        )
        lines.append(row(*cells))
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, and write it where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--short", action="store_true", help="fewer rounds")
    options = parser.parse_args(arguments)
    rounds = 5 if options.short else 41
    rows = list(measure(rounds))
    above = _HEAD.format(rounds=rounds, generations=GENERATIONS, bar=BAR)
    publish(table(rows), options, above)
    return 3 if any(row.is_missed for row in rows) else 0


_HEAD = """# What a generation costs

Made by `python benchmarks/generation.py`. One core, one process. The bar: apart from
the objective, a generation of PSO, DE, jDE or L-SHADE in the compiled loop costs at
most {bar:g} times as much as drawing its random numbers in compiled code. PSO has two
neighbourhoods here, the whole swarm and a ring.

All calls of one size (individuals x variables) take turns of about 10 ms, {rounds}
rounds; numbers are medians. The time of a generation is that of a search with
1 + {generations} generations minus that of one with 1, both in the compiled loop of
`Search`, divided by {generations}. The objective, a compiled sum of squares, is
measured alone on as many generations and subtracted. Settings are the defaults, the box
is [-1, 2] in each variable. The budget is without end, so that the population of
L-SHADE does not shrink: all its generations have the size given.

The draws are compiled code that draws into an array, with the same kind of generator,
as many uniform, normal and Cauchy numbers (a tangent of a uniform one) as a generation
does on average. The counts are derived from the kernels. L-SHADE draws about 2 % more:
the draws that delete members of a full archive are left out, and the memory of its
parameters keeps its first values. The numbers are stored and not added up: a sum
carried through the calls of the generator makes them take twice as long, and the ratios
half as large.

"""

if __name__ == "__main__":
    sys.exit(main())
