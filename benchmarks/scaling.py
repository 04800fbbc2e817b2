"""Growth of the evaluator's time: with the population, with the horizon, when built."""

import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from swarmstart.benchmarks.problems import (
    Instance,
    five_uavs,
    formation,
    one_uav,
    reactor,
)
from swarmstart.benchmarks.rivals import Contestant
from swarmstart.benchmarks.timing import Timing, timings
from swarmstart.ocp.compiled.simd import compile_rollout
from swarmstart.ocp.rollout.shooting import Shooting

SIZES = (20, 50, 100, 300, 1000, 3000, 10000, 30000, 100000)
HORIZONS = (10, 30, 100, 300, 1000)
INDIVIDUALS = 100
ANCHOR = 1000
"""Size at which the plot's straight lines meet the measurements."""

Prepare = Callable[[Instance, NDArray[np.float64]], Contestant]


class Series(NamedTuple):
    """Seconds of one call against a size.

    Attributes:
        name: Name of what is evaluated.
        seconds: Size -> time of one call.
        rollouts: Number of rollouts in a call of each size.
    """

    name: str
    seconds: Mapping[int, Timing]
    rollouts: Callable[[int], int]

    def slope(self, smallest: int) -> float:
        """Return the slope of log time on log size, from a size on."""
        sizes = [size for size in self.seconds if size >= smallest]
        medians = [self.seconds[size].median for size in sizes]
        return float(np.polyfit(np.log(sizes), np.log(medians), 1)[0])


class Build(NamedTuple):
    """Time to get one problem's machine code.

    Attributes:
        name: The problem.
        built: Made anew, the cache empty [s].
        reloaded: Read from the cache [s].
    """

    name: str
    built: Timing
    reloaded: Timing


def over_populations(prepare: Prepare, largest: int, rounds: int) -> list[Series]:
    """Return the time of one call over population sizes, for two problems."""
    sizes = [size for size in SIZES if size <= largest]
    found = []
    for instance in (one_uav(), five_uavs()):
        seconds = _timed(prepare, {size: (instance, size) for size in sizes}, rounds)
        found.append(Series(instance.name, seconds, lambda size: size))
    return found


def over_horizons(prepare: Prepare, rounds: int) -> Series:
    """Return the time of one call over the reactor's number of intervals."""
    sizes = {N: (reactor(N), INDIVIDUALS) for N in HORIZONS}
    seconds = _timed(prepare, sizes, rounds)
    return Series(reactor().name, seconds, lambda _: INDIVIDUALS)


def _timed(
    prepare: Prepare, sizes: Mapping[int, tuple[Instance, int]], rounds: int
) -> dict[int, Timing]:
    """Return the time of a call for each size: of a problem and a population."""
    contestants = {
        str(size): prepare(
            instance, instance.population(individuals, np.random.default_rng(0))
        )
        for size, (instance, individuals) in sizes.items()
    }
    calls = {size: contestant.run for size, contestant in contestants.items()}
    measured = timings(calls, rounds=rounds)
    return {int(size): timing for size, timing in measured.items()}


def build_times(*, builds: int, reloads: int) -> list[Build]:
    """Return the times to make machine code and to read it again."""
    instances = {
        "five UAVs": five_uavs(),
        "formation_v, first UAV": formation("formation_v")[0],
        "reactor, N = 10": reactor(10),
        "reactor, N = 1000": reactor(1000),
    }
    return [_build(name, i, builds, reloads) for name, i in instances.items()]


def plot(populations: Sequence[Series], horizon: Series, path: Path) -> None:
    """Draw the time of a call against population size and number of intervals."""
    figure = Figure(figsize=(10, 4), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    _panel(left, populations, "individuals in the population")
    _panel(right, [horizon], f"intervals of the horizon ({INDIVIDUALS} individuals)")
    figure.savefig(path, dpi=120)


def _panel(axes: Axes, series: Sequence[Series], label: str) -> None:
    for one in series:
        sizes = np.array(list(one.seconds))
        times = [timing.median for timing in one.seconds.values()]
        (line,) = axes.loglog(sizes, times, "o", label=one.name)
        straight = one.seconds[ANCHOR].median * sizes / ANCHOR
        axes.loglog(sizes, straight, "-", color=line.get_color(), linewidth=1)
    axes.plot([], [], "-", color="gray", label=f"slope 1 through {ANCHOR}")
    axes.set(xlabel=label, ylabel="time of one call [s]")
    axes.grid(alpha=0.3)
    axes.legend()


def _build(name: str, instance: Instance, builds: int, reloads: int) -> Build:
    problem = instance.problem
    shooting = Shooting(problem)
    functions = shooting.stage_without_path, shooting.terminal

    def compile_once() -> float:
        begin = time.perf_counter()
        compile_rollout(
            *functions,
            intervals=problem.intervals,
            signals_per_interval=problem.ns * problem.checks,
        )
        return time.perf_counter() - begin

    made = []
    for _ in range(builds):
        with _empty_cache():
            made.append(compile_once())
    with _empty_cache():
        compile_once()
        read = [compile_once() for _ in range(reloads)]
    return Build(name, _spread(made), _spread(read))


def _spread(seconds: Sequence[float]) -> Timing:
    lower, _, upper = statistics.quantiles(seconds, n=4)
    return Timing(statistics.median(seconds), lower, upper)


@contextmanager
def _empty_cache() -> Iterator[None]:
    """Let machine code be kept in a new folder for a while."""
    before = os.environ.get("XDG_CACHE_HOME")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        try:
            yield
        finally:
            if before is None:
                del os.environ["XDG_CACHE_HOME"]
            else:
                os.environ["XDG_CACHE_HOME"] = before
