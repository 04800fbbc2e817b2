"""Reconfigurations and transfers over seeds: their bars.

    python benchmarks/reconfiguration.py --write docs/reconfiguration_bars.md

Every distinct run is flown once, in two worker processes; `--short` flies one seed of
everything. The bars are in reconfiguration_bars.py.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarmstart.benchmarks.bars import (
    bar_table,
    jobs_of,
)
from swarmstart.benchmarks.flights import Job, flown, fly_all
from swarmstart.benchmarks.reconfiguration_bars import BARS, FIRST, SECOND
from swarmstart.benchmarks.tables import row

MOST_SEEDS = 10
MANY_SEEDS = 200
"""Of the corrected variant, whose bars the text's DE misses now and then."""
CORRECTED = (Job(FIRST, variant="corrected"), Job(SECOND, variant="corrected"))
BOUNDS_M = {FIRST: 2.0, SECOND: 1.5}


def fly(job: Job) -> dict[str, Any]:
    """Fly one run and return its measures, and a few more."""
    finished = flown(job)
    measures = dict(finished.measures)
    if measures.get("gap_per_horizon") is not None:
        plans = [d.plans[0] for d in finished.trajectory.decisions]
        costs, gaps = (
            np.array(measures[name]) for name in ("cost_per_horizon", "gap_per_horizon")
        )
        best = costs - gaps
        searched = np.array([plan.search.cost for plan in plans])
        measures["best_cost_per_horizon"] = best.tolist()
        measures["search_gap_max"] = float((searched - best).max())
    return measures


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly all runs, print the tables, and write them where asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--short", action="store_true", help="one seed of everything")
    parser.add_argument("--write", type=Path, help="a Markdown file to write")
    options = parser.parse_args(arguments)
    began, most = time.perf_counter(), 1 if options.short else MOST_SEEDS
    many = 1 if options.short else MANY_SEEDS

    jobs = [job for bar in BARS for job in jobs_of(bar, most)]
    jobs += [job._replace(seed=seed) for job in CORRECTED for seed in range(many)]
    measured = fly_all(fly, jobs, options.workers)

    lines, failed = bar_table(BARS, measured, most)
    lines += [
        f"## The corrected variant over {many} seeds",
        "",
        row("scenario", "bound", "median", "95th percentile", "largest", "kept"),
        row(*["---"] * 6),
    ]
    for job in CORRECTED:
        bound = BOUNDS_M[job.scenario]
        values = np.array(
            [
                measured[job._replace(seed=seed)]["position_error_m"]
                for seed in range(many)
            ]
        )
        numbers = (np.median(values), np.quantile(values, 0.95), values.max())
        lines.append(
            row(
                job.scenario,
                f"<= {bound:g} m",
                *(f"{number:.2f}" for number in numbers),
                f"{np.sum(values <= bound)} of {many}",
            )
        )
    text = "\n".join(lines) + "\n"
    print(text)
    print(f"{failed} bars missed, {time.perf_counter() - began:.0f} s", file=sys.stderr)
    if options.write:
        options.write.write_text(_HEAD + text, encoding="utf-8")
    return 3 if failed else 0


_HEAD = """# Reconfigurations and transfers over seeds

Made by `python benchmarks/reconfiguration.py --write docs/reconfiguration_bars.md`.
Numbers are lowest / median / highest over the seeds, 0 and up; append `--seed n --json`
to a command. What is flown and measured: [reconfiguration.md](reconfiguration.md).

`name[k]`: entry k of a list, from 0. `best_cost_per_horizon`: the best J known from the
states flown. `search_gap_max`: the largest difference of the search's own answer from
it, before the polish.

"""


if __name__ == "__main__":
    sys.exit(main())
