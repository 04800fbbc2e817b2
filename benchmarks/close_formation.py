"""The close formation over seeds: the project's bars, and gusts.

    python benchmarks/close_formation.py --write docs/close_formation_bars.md

Every distinct run is flown once, in two worker processes; `--short` flies one seed of
everything. The bars are in close_formation_bars.py.
"""

import argparse
import hashlib
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
from swarmstart.benchmarks.close_formation_bars import (
    BARS,
    GUST_LEVELS_FT_S,
    GUST_SEEDS,
    GUSTS,
    gust_job,
)
from swarmstart.benchmarks.flights import Job, Measured, flown, fly_all
from swarmstart.benchmarks.tables import row
from swarmstart.cases.campaign.run import Run
from swarmstart.cases.campaign.statistics import spread
from swarmstart.cases.kinds.close_formation.measures import deviations
from swarmstart.cases.kinds.close_formation.scenario import CloseFormationScenario

TURN_S = (25.0, 125.0)
"""When the full turn is on, and the wingman has met it."""


def fly(job: Job) -> dict[str, Any]:
    """Fly one run and return its measures, and a few more."""
    gusts = any("gusts.sigma" in text for text in job.sets)
    finished = flown(job, *([f"plant.gusts.seed={job.seed}"] if gusts else []))
    measures = finished.measures
    settled = None not in (measures["x_settle_s"], measures["y_settle_s"])
    return {
        **measures,
        "settled": float(settled),
        "wall_s": finished.wall_s,
        "trajectory": hashlib.sha256(_bytes(finished)).hexdigest(),
        "error_in_turn_ft": _error_in_turn(finished),
    }


def _bytes(finished: Run) -> bytes:
    trajectory = finished.trajectory
    return trajectory.dense_states.tobytes() + trajectory.controls.tobytes()


def _error_in_turn(finished: Run) -> float | None:
    """Return the largest distance from the slot during the full turn [ft]."""
    scenario, trajectory = finished.resolved.scenario, finished.trajectory
    assert isinstance(scenario, CloseFormationScenario)  # noqa: S101 - for the types
    begin, end = TURN_S
    within = (trajectory.times >= begin) & (trajectory.times <= end)
    if trajectory.times[-1] < end:
        return None
    off = deviations(scenario, trajectory.states[:, within])
    return float(np.linalg.norm(off, axis=0).max())


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly all runs, print the tables, and write them where asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--short", action="store_true", help="one seed of everything")
    parser.add_argument("--write", type=Path, help="a Markdown file to write")
    options = parser.parse_args(arguments)
    began, most = time.perf_counter(), 1 if options.short else GUST_SEEDS

    jobs = [job for bar in (*BARS, *GUSTS) for job in jobs_of(bar, most)]
    jobs += [job for pair in _gust_jobs(most).values() for job in pair]
    measured = fly_all(fly, jobs, options.workers)

    lines, failed = bar_table((*BARS, *GUSTS), measured, most)
    lines += _gust_table(measured, most)
    text = "\n".join(lines) + "\n"
    print(text)
    print(f"{failed} bars missed, {time.perf_counter() - began:.0f} s", file=sys.stderr)
    if options.write:
        options.write.write_text(_HEAD + text, encoding="utf-8")
    return 3 if failed else 0


def _gust_jobs(most: int) -> dict[tuple[float, int], list[Job]]:
    return {
        (level, p): [
            gust_job(level, p)._replace(seed=seed)
            for seed in range(min(GUST_SEEDS, most))
        ]
        for p in (1, 10)
        for level in GUST_LEVELS_FT_S
    }


def _gust_table(measured: Measured, most: int) -> list[str]:
    lines = [
        "## Gusts",
        "",
        "The vortex plant; p = 1 with the text's DE, p = 10 with exact kinematics in "
        "the prediction, F = 0.5 and CR = 0.9. Lowest / median / highest over "
        f"{min(GUST_SEEDS, most)} seeds, of search and gusts.",
        "",
        row("p", "sigma [ft/s]", "smallest range [ft]", "drag saved [percent]"),
        row(*["---"] * 4),
    ]
    for (level, p), jobs in _gust_jobs(most).items():
        ranges, saved = (
            spread([round(measured[job][name], 1) for job in jobs], digits=6)
            for name in ("min_range_ft", "drag_saving_percent")
        )
        lines.append(row(str(p), f"{level:g}", ranges, saved))
    lines += ["", "A run: `" + gust_job(12, 10).command() + "`", ""]
    lines += ["Seed n: `--seed n --set plant.gusts.seed=n`.", ""]
    return lines


_HEAD = """# The close formation over seeds

Made by `python benchmarks/close_formation.py --write docs/close_formation_bars.md`.
Numbers are lowest / median / highest over the seeds, 0 and up; append `--seed n --json`
to a command. What is flown and measured: [close_formation.md](close_formation.md).

D: deterministic, IPOPT alone. S: differential evolution. `settled`: 1 where x and y
both settle; `same_again`: 1 where the same seed gives the same trajectory to the bit;
`error_in_turn_ft`: largest distance from the slot while the leader turns, from 20 s
after its beginning; `wall_s`: of a run of 30 s of flight, while another ran beside it.
S4 asks of every seed what might be asked of all seeds pooled.

"""


if __name__ == "__main__":
    sys.exit(main())
