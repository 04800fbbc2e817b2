"""Overhead of a cell: many cells without work, and with a small problem.

    python benchmarks/cells.py [--cells 10000] [--workers 2] [--solved 10000]

All work of a campaign counts: starting workers, folders, commits, scheduling, and
reading the cells again when the same command is repeated. `empty` cells return nothing;
`solved` ones run one generation of random search on a small problem, verified. The bar
is at most 5 ms of wall time for a cell.
"""

import argparse
import resource
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from swarmstart.cases.campaign.engine.cells import Cell, carried_out
from swarmstart.cases.campaign.judging.runs import entry_of
from swarmstart.cases.campaign.trials.solvers import solver_of
from swarmstart.cases.format.scenario import read_document, resolve

BAR_MS = 5.0
SCENARIO = "double_integrator"
EVALUATIONS = 20
"""Evaluations of random search: one generation, the least possible."""


class Cost(NamedTuple):
    """Milliseconds for a cell: wall, CPU of the command and of its workers; again."""

    wall: float
    command: float
    workers: float
    again: float


def nothing(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return nothing."""
    del job, folder
    return {}


def empty_cells(count: int) -> list[Cell]:
    """Return cells without work, with a job of a usual size."""
    settings = resolve(read_document(SCENARIO)).anonymous_settings()
    return [
        Cell(
            work="swarmstart.benchmarks.cells:nothing",
            job={"settings": settings, "seed": seed},
            label=f"seed {seed}",
            timeout_s=300.0,
        )
        for seed in range(count)
    ]


def solved_cells(count: int) -> list[Cell]:
    """Return cells of `compare` on a small problem, one generation each."""
    entry = entry_of(
        resolve(read_document(SCENARIO), search="random", polish="none"),
        solver_of("random"),
        seeds=count,
        budget={"evaluations": EVALUATIONS},
        timeout_s=300.0,
        repair=False,
    )
    return list(entry.cells)


def measured(cells: Sequence[Cell], workers: int) -> Cost:
    """Return the cost of the cells.

    Raises:
        SystemExit: If one has failed.
    """
    with tempfile.TemporaryDirectory() as place:
        before = _cpu()
        began = time.perf_counter()
        found = carried_out(cells, Path(place), workers=workers)
        wall = time.perf_counter() - began
        after = _cpu()
        began = time.perf_counter()
        again = carried_out(cells, Path(place), workers=workers)
        seconds = time.perf_counter() - began
    failures = {outcome.failure for outcome in found if outcome.failure}
    if failures or again != found:
        raise SystemExit(f"cells have failed: {failures}")
    command, in_workers = (b - a for a, b in zip(before, after, strict=True))
    scale = 1e3 / len(cells)
    return Cost(wall * scale, command * scale, in_workers * scale, seconds * scale)


def _cpu() -> tuple[float, float]:
    """Return CPU seconds of this process and of its children."""
    found = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    own, children = (used.ru_utime + used.ru_stime for used in found)
    return own, children


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure; return 3 if a cell costs more than the bar."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cells", type=int, default=10_000)
    parser.add_argument("--solved", type=int, default=10_000)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args(arguments)
    made = {"empty": empty_cells(options.cells), "solved": solved_cells(options.solved)}
    costs = {
        name: measured(cells, options.workers) for name, cells in made.items() if cells
    }
    print(
        f"{'cells':8}{'count':>8}  wall   command  workers  called again  [ms a cell]"
    )
    for name, cost in costs.items():
        shown = f"{cost.wall:5.2f}  {cost.command:7.2f}  {cost.workers:7.2f}"
        print(f"{name:8}{len(made[name]):8d}  {shown}  {cost.again:12.3f}")
    return 3 if any(cost.wall > BAR_MS for cost in costs.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
