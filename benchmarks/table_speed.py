"""Time of a table in machine code, compared with CasADi's interpolants in its map.

python benchmarks/table_speed.py [--short] [--write docs/measured/table_speed.md]
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Literal, NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.benchmarks.tables import (
    Bar,
    bar_table,
    head,
    page_options,
    publish,
    row,
)
from swarmstart.benchmarks.timing import timings
from swarmstart.ocp import (
    Bounds,
    Fitness,
    Model,
    OptimalControlProblem,
    Table,
    compile_batch,
    table,
)

Method = Literal["linear", "bspline"]
Contestants = dict[str, Callable[[], object]]
POPULATION = 1000
FLOOR = 10.0
"""Least speed of a table of up to 100 values, relative to the map."""
CLOSE = 1e-9
"""Largest difference of the contestants' values, relative to the largest value."""


class Row(NamedTuple):
    """One table, or one problem.

    Attributes:
        what: Words.
        map: CasADi's interpolant by its map [s].
        read: The same interpolant, read and compiled [s].
        ours: `swarmstart.table`, compiled [s].
    """

    what: str
    map: float
    read: float
    ours: float


def interpolant(made: Table) -> ca.Function:
    """Return CasADi's interpolant of a table's numbers."""
    values = made.values.ravel(order="F")
    return ca.interpolant("known", made.method, [*made.breakpoints], values)


def random_table(sizes: Sequence[int], method: Method, seed: int) -> Table:
    """Return a table on [0, 1] with breakpoints that are not even."""
    rng = np.random.default_rng(seed)
    steps = [rng.uniform(0.5, 1.5, size - 1) for size in sizes]
    at = [np.concatenate([[0], np.cumsum(s) / s.sum()]) for s in steps]
    x = at[0] if len(at) == 1 else at
    return table(x, rng.normal(size=tuple(sizes)), method)


def single(made: Table, seed: int) -> Contestants:
    """Return one evaluation of a table for a population."""
    n = len(made.breakpoints)
    x = ca.SX.sym("x", n)
    ours = ca.Function("ours", [x], [made(*(x[i] for i in range(n)))])
    theirs = ca.Function("theirs", [x], [interpolant(made)(x)])
    points = np.random.default_rng(seed).uniform(size=(n, POPULATION))
    return _bound(
        compile_batch(theirs, backend="casadi"),
        compile_batch(theirs, backend="llvm"),
        compile_batch(ours, backend="llvm"),
        points,
    )


def rollout(made: Table, seed: int) -> Contestants:
    """Return rollouts of 50 intervals: a mass with a force by table of its speed."""
    v, u = ca.SX.sym("v"), ca.SX.sym("u")

    def fitness(force: ca.SX, backend: str) -> Callable[[Array], object]:
        problem = OptimalControlProblem(
            Model(states=v, controls=u, ode=u - v + 0.1 * force),
            horizon=5.0,
            intervals=50,
            stage_cost=(v - 0.5) ** 2 + u**2,
            bounds=Bounds(controls=(0.2, 0.8)),
        )
        return Fitness(problem, backend=backend).objective([0.5])

    theirs = interpolant(made)(v)
    points = np.random.default_rng(seed).uniform(0.2, 0.8, (50, POPULATION))
    return _bound(
        fitness(theirs, "casadi"),
        fitness(theirs, "llvm"),
        fitness(made(v), "llvm"),
        points,
    )


def _bound(
    by_map: Callable[[Array], object],
    read: Callable[[Array], object],
    ours: Callable[[Array], object],
    points: Array,
) -> Contestants:
    """Return the calls, after a look at whether they agree."""
    calls = {"map": by_map, "read": read, "ours": ours}
    values = {name: np.asarray(call(points)) for name, call in calls.items()}
    size = np.abs(values["map"]).max()
    for name, found in values.items():
        if not np.abs(found - values["map"]).max() <= CLOSE * size:
            raise ValueError(f"{name} has other values than CasADi's map")
    return {name: lambda call=call: call(points) for name, call in calls.items()}  # type: ignore[misc]


def measure(*, short: bool) -> Iterator[Row]:
    """Yield the time of each table and each problem for one individual."""
    rounds = 5 if short else 25
    methods: tuple[Method, ...] = ("linear", "bspline")
    sizes: list[tuple[int, ...]] = (
        [(10,), (100,)] if short else [(10,), (21,), (50,), (100,)]
    )
    sizes += [(10, 10)] if short else [(5, 5), (10, 10), (20, 20)]
    for method in methods:
        for size in sizes:
            said = " x ".join(map(str, size))
            made = random_table(size, method, seed=1)
            yield _timed(f"{method}, {said}", single(made, seed=2), rounds)
        made = random_table((21,), method, seed=1)
        what = f"{method}, 21, rollout of 50 intervals"
        yield _timed(what, rollout(made, seed=2), rounds)


def _timed(what: str, calls: Contestants, rounds: int) -> Row:
    found = timings(calls, rounds=rounds)
    return Row(what, *(found[n].median / POPULATION for n in ("map", "read", "ours")))


def report(rows: Sequence[Row]) -> list[str]:
    """Return the table of all rows, and the bar."""
    columns = ("map [ns]", "interpolant, read [ns]", "`table` [ns]", "map / `table`")
    lines = head("method, breakpoints", *columns)
    for one in rows:
        times = [f"{seconds * 1e9:,.1f}" for seconds in (one.map, one.read, one.ours)]
        lines.append(row(one.what, *times, f"{one.map / one.ours:.0f}"))
    return [*lines, "", *bar_table([bar(rows)])]


def bar(rows: Sequence[Row]) -> Bar:
    """Return the floor under all ratios."""
    slowest = min(one.map / min(one.ours, one.read) for one in rows)
    return Bar("times as fast as the map, at least", ">=", FLOOR, slowest)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, and write it where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--short", action="store_true", help="some seconds")
    options = parser.parse_args(arguments)
    rows = list(measure(short=options.short))
    publish(report(rows), options, _HEAD)
    return 3 if bar(rows).is_missed else 0


_HEAD = f"""# How fast tables are evaluated

Made by `python benchmarks/table_speed.py --write docs/measured/table_speed.md`. One
thread, {POPULATION} individuals, times for one of them; the three contestants of a row
have the same points and take turns of some 10 ms, numbers are medians. Ratios of one
run can be compared, nanoseconds of different runs cannot. Before the timing, the values
of the three are compared. "map" is `casadi.interpolant` in an SX function, evaluated by
CasADi's map; "read" is the same function in machine code, which reads the table from
the serialised interpolant; `table` is `swarmstart.table`. All are called from Python. A
rollout takes four substeps of RK4 in each interval, so about 800 evaluations of the
table.

"""


if __name__ == "__main__":
    sys.exit(main())
