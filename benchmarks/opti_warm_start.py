"""Benefit of `warm_start` for an Opti: extra seconds, and how often it wins.

Two problems, at 100 and at 400 intervals: the race car of CasADi's documentation, and a
UAV's way through four discs whose states' start is left at 0. Prints the table of
docs/measured/opti_warm_start.md:

    python benchmarks/opti_warm_start.py [--seeds 10]

Extra seconds are those of `warm_start` and of `solve`, less those of the Opti's own
start, as wall and as processor time; the machine must be idle.
"""

import argparse
import contextlib
import os
import statistics
import time
from collections.abc import Callable

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

from swarmstart.ocp.foreign_nlp.opti import warm_start  # noqa: E402 - threads are set before
from swarmstart.tests.ocp.foreign_nlp.test_opti import (  # noqa: E402
    QUIET,
    Made,
    four_discs,
    race_car,
)

Make = Callable[[int], Made]

PROBLEMS: dict[str, tuple[Make, dict[int, float]]] = {
    "race car": (race_car, {100: 1.904634, 400: 1.904678}),
    "four discs": (four_discs, {100: 10.818205, 400: 10.818231}),
}
CAP = 60
"""Iterations after which the four discs' own start is stopped at 400 intervals: it ends
as infeasible, after some 230. The searched start takes some 20."""
SAME = 2e-6
"""Relative difference below which two costs are those of one optimum."""


def main() -> None:
    """Measure and print the table."""
    options = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    options.add_argument("--seeds", type=int, default=10)
    options.add_argument("--intervals", type=int, nargs="*", default=[100, 400])
    given = options.parse_args()
    print(
        "| problem | N | own start | best known | hits | on top, wall [s] | CPU [s] |"
    )
    print("|---|---|---|---|---|---|---|")
    for name, (make, best) in PROBLEMS.items():
        for intervals in given.intervals:
            own = own_seconds(make, intervals)
            runs = [measured(make, intervals, seed, own) for seed in range(given.seeds)]
            known = best[intervals]
            hits = sum(run[1] <= known + SAME * known for run in runs)
            wall, processor = [run[2] for run in runs], [run[3] for run in runs]
            print(
                f"| {name} | {intervals} | {runs[0][0]} | {known:.6f} | "
                f"{hits}/{len(runs)} | {spread(wall)} | {spread(processor)} |",
                flush=True,
            )


def spread(values: list[float]) -> str:
    """Return median and range."""
    middle = statistics.median(values)
    return f"{middle:.2f} ({min(values):.2f} to {max(values):.2f})"


def made(make: Make, intervals: int) -> Made:
    """Return a problem."""
    problem = make(intervals)
    if make is four_discs and intervals == max(PROBLEMS["four discs"][1]):
        problem[0].solver("ipopt", {**QUIET, "ipopt.max_iter": CAP})
    return problem


def own_seconds(make: Make, intervals: int) -> float:
    """Return the processor time of the Opti's own start [s]."""
    opti = made(make, intervals)[0]
    begin = time.process_time()
    with contextlib.suppress(RuntimeError):
        opti.solve()
    return time.process_time() - begin


def measured(
    make: Make, intervals: int, seed: int, own_cpu: float
) -> tuple[str, float, float, float]:
    """Return the own start's end, the cost, and seconds on top, wall and CPU."""
    opti, x, u, _ = made(make, intervals)
    begin, cpu = time.perf_counter(), time.process_time()
    warm = warm_start(opti, controls=[u], states=[x], seed=seed)
    built = time.perf_counter() - begin
    solution = warm.solve()
    on_top = time.process_time() - cpu - own_cpu
    report = warm.report
    if report is None:
        raise RuntimeError("expected a report after solve, found none")
    own = f"{report.own.cost:.6f}" if report.own.feasible else report.own.status
    return own, solution.value(opti.f), built + report.searched.seconds, on_top


if __name__ == "__main__":
    main()
