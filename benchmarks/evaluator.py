"""Speed of evaluating populations: ours against CasADi and others, in one run.

    python benchmarks/evaluator.py --write docs/measured/evaluator_speed.md \
        --plot docs/measured/evaluator_speed.png

Every contestant's values are compared with those of CasADi's map before it is timed.
"""

import argparse
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from swarmstart.benchmarks import elementary, rivals, scaling
from swarmstart.benchmarks.problems import (
    Instance,
    bicycle,
    five_uavs,
    formation,
    one_uav,
    reactor,
    van_der_pol,
    wingman,
)
from swarmstart.benchmarks.races import (
    CONTESTANTS,
    HAND,
    MAP,
    POINTER,
    PYTHON,
    Race,
    prepared,
    race,
)
from swarmstart.benchmarks.tables import (
    Bar,
    bar_table,
    head,
    page_options,
    publish,
    row,
)
from swarmstart.benchmarks.timing import Timing
from swarmstart.ocp.compiled.engine import Machine, machine

LARGE, SMALL = 1000, 20
"""Individuals in a population."""


_WITH_TANGENTS = 25
"""Least speed of the bicycle relative to the map, on any machine."""


class Measured(NamedTuple):
    """Measurements of one run."""

    races: Sequence[Race]
    builds: Sequence[scaling.Build]
    populations: Sequence[scaling.Series]
    horizon: scaling.Series
    functions: Sequence[elementary.Timed]

    def race(self, problem: str, size: int) -> Race:
        """Return one race."""
        found = {(race.problem, race.size): race for race in self.races}
        return found[problem, size]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and write them where asked."""
    parser = page_options(__doc__, plots=True)
    parser.add_argument("--short", action="store_true", help="some 30 seconds")
    parser.add_argument("--check", action="store_true", help="fail below the floors")
    options = parser.parse_args(arguments)

    measured = measure(short=options.short)
    if options.plot:
        scaling.plot(measured.populations, measured.horizon, options.plot)
    publish(report(measured), options, _HEAD + _picture(options))
    missed = [bar for bar in floors(measured) if options.check and bar.is_missed]
    if missed:
        print("\n".join(["floors missed", *bar_table(missed)]), file=sys.stderr)
    return 3 if missed else 0


def measure(*, short: bool) -> Measured:
    """Measure everything, or what fits into half a minute."""
    rounds = 7 if short else 15
    races = [
        race(instance, size, rounds=rounds)
        for instance in instances(short=short)
        for size in (LARGE, SMALL)
    ]
    return Measured(
        races,
        scaling.build_times(builds=5 if short else 15, reloads=50),
        scaling.over_populations(prepared, LARGE if short else 100_000, rounds),
        scaling.over_horizons(prepared, rounds),
        elementary.timed(rounds=rounds),
    )


def instances(*, short: bool) -> list[Instance]:
    """Return the problems, in the tables' order."""
    if short:
        return [five_uavs(), one_uav(), formation("formation_v")[0]]
    own = [five_uavs(), five_uavs(4), one_uav(), reactor(), van_der_pol(), bicycle()]
    flights = [*formation("formation_v"), *formation("formation_obstacle")]
    return [*own, *flights, wingman("close_formation")]


def floors(measured: Measured) -> list[Bar]:
    """Return the bars for any machine."""
    large, small = (measured.race(five_uavs().name, size) for size in (LARGE, SMALL))
    return [
        _ratio_bar(large, POINTER, 15),
        _ratio_bar(small, PYTHON, 5),
    ]


def bars(measured: Measured) -> list[Bar]:
    """Return the bars of the project."""
    main_problem, single = five_uavs().name, one_uav().name
    wanted = 80 if _has_avx512(machine()) else 40
    found = []
    for one in measured.races:
        if one.size == LARGE:
            bound = wanted if one.problem == main_problem else wanted / 2
            bound = _WITH_TANGENTS if one.problem == bicycle().name else bound
            found.append(_ratio_bar(one, POINTER, bound))
        if one.size == LARGE and HAND in one.seconds:
            found.append(_ratio_bar(one, POINTER, 0.9, to=HAND))
    return [
        *found,
        _ratio_bar(measured.race(main_problem, SMALL), PYTHON, 20),
        _ratio_bar(measured.race(single, SMALL), PYTHON, 10),
        _ratio_bar(measured.race(main_problem, SMALL), POINTER, 50),
        *_build_bars(measured.builds),
    ]


def _ratio_bar(race: Race, contestant: str, bound: float, to: str = MAP) -> Bar:
    text = f"{race.problem}, {race.size} individuals: {contestant} / {to}"
    return Bar(text, ">=", bound, race.ratio(contestant, to).median)


def _build_bars(builds: Iterable[scaling.Build]) -> list[Bar]:
    found, times = [], {}
    for build in builds:
        times[build.name] = build.built.median
        if not build.name.startswith("reactor"):
            made = build.built.median
            found.append(Bar(f"{build.name}: built [s]", "<=", 0.1, made))
        read = build.reloaded.median
        found.append(Bar(f"{build.name}: reloaded [s]", "<=", 0.005, read))
    shortest, longest = (times[f"reactor, N = {N}"] for N in (10, 1000))
    text = "reactor: built with N = 1000 / N = 10"
    return [*found, Bar(text, "<=", 2, longest / shortest)]


def report(measured: Measured) -> list[str]:
    """Return all tables."""
    lines = [f"Machine: {_machine_text()}.", ""]
    if rivals.compiler() is None:
        lines += ["The two contestants in C are left out: no C compiler is here.", ""]
    for size in (LARGE, SMALL):
        races = [race for race in measured.races if race.size == size]
        lines += [f"## {size} individuals, ns per rollout", ""]
        lines += _race_table(races, Race.ns)
        lines += [f"## {size} individuals, times as fast as the map", ""]
        lines += _race_table(races, Race.ratio)
    lines += _function_table(measured.functions)
    lines += _build_table(measured.builds)
    lines += _growth_tables(measured)
    lines += bar_table(bars(measured))
    by_hand = measured.race(five_uavs().name, LARGE)
    if HAND in by_hand.seconds:
        ratio = by_hand.ratio(HAND).median
        lines += [
            f"The C code with vectors, written by hand, is {ratio:.0f} times as fast",
            "as the map here: a higher [bar](../glossary.md#bar) can be met only on a",
            "processor that starts more vector operations a cycle.",
        ]
    return lines


def _race_table(
    races: Iterable[Race], value: Callable[[Race, str], Timing]
) -> list[str]:
    rows = [["problem", *CONTESTANTS]]
    for one in races:
        cells = (
            _spread(value(one, name)) if name in one.seconds else "-"
            for name in CONTESTANTS
        )
        rows.append([one.problem, *cells])
    return _table(rows)


def _function_table(functions: Iterable[elementary.Timed]) -> list[str]:
    rows = [["function", elementary.OURS, elementary.NUMPY, "times as fast"]]
    for one in functions:
        times = (one.ns[who] for who in (elementary.OURS, elementary.NUMPY))
        rows.append([one.name, *map(_spread, times), _number(one.ratio)])
    title = f"## Elementary functions of {elementary.VALUES} values, ns per value"
    return [title, "", *_table(rows)]


def _build_table(builds: Iterable[scaling.Build]) -> list[str]:
    rows = [["problem", "built, cache empty [ms]", "read from the cache [ms]"]]
    for build in builds:
        times = (
            Timing(*(1e3 * second for second in timing))
            for timing in (build.built, build.reloaded)
        )
        rows.append([build.name, *map(_spread, times)])
    return ["## Machine code: made and read again", "", *_table(rows)]


def _growth_tables(measured: Measured) -> list[str]:
    lines = ["## Growth with the population", ""]
    first, *_ = measured.populations
    rows = [["ns per rollout", *map(str, first.seconds), "slope from 100 on"]]
    rows += [_growth_row(series, smallest=100) for series in measured.populations]
    lines += [*_table(rows), "## Growth with the horizon", ""]
    horizon = measured.horizon
    text = f"{scaling.INDIVIDUALS} individuals, ns per rollout"
    rows = [[text, *(f"N = {N}" for N in horizon.seconds), "slope"]]
    return lines + _table([*rows, _growth_row(horizon, smallest=1)])


def _growth_row(series: scaling.Series, *, smallest: int) -> list[str]:
    cells = [
        _number(1e9 * timing.median / series.rollouts(size))
        for size, timing in series.seconds.items()
    ]
    return [series.name, *cells, f"{series.slope(smallest):.3f}"]


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return a table whose first row is its head."""
    return [*head(*rows[0]), *(row(*cells) for cells in rows[1:]), ""]


def _spread(timing: Timing) -> str:
    """Return the median and, in brackets, the quartiles."""
    return f"{_number(timing.median)} ({_number(timing.lower)}-{_number(timing.upper)})"


def _number(value: float) -> str:
    """Return three digits, or all before the point."""
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def _has_avx512(target: Machine) -> bool:
    return "+avx512f" in target.features.split(",")


def _machine_text() -> str:
    target = machine()
    width = "AVX-512" if _has_avx512(target) else "AVX2"
    if not target.triple.startswith("x86_64"):
        width = target.triple.split("-")[0]
    parts = [
        f"{target.cpu} ({width}), {target.lanes} doubles side by side",
        f"LLVM {target.llvm}",
        f"Python {platform.python_version()}",
        f"NumPy {version('numpy')}",
        f"CasADi {version('casadi')}",
    ]
    return ", ".join([*parts, *_compiler_version()])


def _compiler_version() -> list[str]:
    command = rivals.compiler()
    if command is None:
        return []
    asked = [command, "--version"]
    said = subprocess.run(asked, check=True, capture_output=True, text=True).stdout
    return [f"C compiler {said.splitlines()[0]}"]


def _picture(options: argparse.Namespace) -> str:
    if not (options.plot and options.write):
        return ""
    link = Path(os.path.relpath(options.plot, options.write.parent)).as_posix()
    return f"![Time of a call over population size and intervals]({link})\n\n"


_HEAD = """# How fast populations are evaluated

Made by `python benchmarks/evaluator.py`. A rollout is the computation of cost and
violation of one control sequence. One thread is used. All contestants of a problem have
the same population, uniform in the bounds, and take turns of about 10 ms. Numbers are
medians over the rounds with quartiles in brackets; those of a ratio are relative to the
map's median. Ratios from one run can be compared, nanoseconds of different runs cannot.
The position of a process in memory changes the times of our machine code by up to a
quarter, which the quartiles do not show. Before the timing, every contestant's values
are compared with the map's.

"CasADi map" is CasADi's own map, serial, with buffers allocated in advance. "Prepared"
calls our machine code by its address on fixed buffers; "from Python" allocates and
checks, as usual calls do. CasADi's C code is compiled with `-O3 -march=native` and
called in a loop in C. "By hand" is written for the UAVs alone, in NumPy over the whole
population, or in C with vectors of individuals (`benchmarks/five_uavs.c`).

"""


if __name__ == "__main__":
    sys.exit(main())
