"""The close formation over seeds: the project's bars, gusts and the chapter's claims.

    python benchmarks/close_formation.py --write docs/close_formation_bars.md

Every distinct run is flown once, in two worker processes; `--short` flies one seed of
everything. The bars are in close_formation_bars.py.
"""

import argparse
import hashlib
import multiprocessing
import os
import statistics
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarmstart.benchmarks.close_formation_bars import (
    BARS,
    FAST,
    GUST_LEVELS_FT_S,
    GUST_SEEDS,
    GUSTS,
    SCENARIO,
    VORTEX,
    Bar,
    Job,
    gust_job,
    jobs_of,
)
from swarmstart.benchmarks.formation_flight import (
    assignments_of,
    claim_assignments,
    paired_verdict,
    row,
    spread,
)
from swarmstart.cases.claims import holds
from swarmstart.cases.close_formation.measures import deviations
from swarmstart.cases.close_formation.scenario import CloseFormationScenario
from swarmstart.cases.run import Run, run
from swarmstart.cases.scenario import read_document, resolve

TURN_S = (25.0, 125.0)
"""When the full turn is on, and the wingman has met it."""
CLAIM_SEEDS = 10
Measured = Mapping[Job, Mapping[str, Any]]


def fly(job: Job) -> dict[str, Any]:
    """Fly one run and return its measures, and a few more."""
    finished = run(
        resolve(
            read_document(job.scenario),
            variant=job.variant or None,
            search="none" if job.ipopt else None,
            polish="ipopt" if job.ipopt else None,
            assignments=job.assignments(),
        ),
        seed=job.seed,
    )
    measures = finished.measures
    settled = None not in (measures["x_settle_s"], measures["y_settle_s"])
    return {
        **measures,
        "settled": float(settled),
        "wall_s": finished.wall_s,
        "trajectory": hashlib.sha256(_flown(finished)).hexdigest(),
        "error_in_turn_ft": _error_in_turn(finished),
    }


def _flown(finished: Run) -> bytes:
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
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    began, most = time.perf_counter(), 1 if options.short else GUST_SEEDS

    claims = _claims()
    jobs = [job for bar in (*BARS, *GUSTS) for job in jobs_of(bar, most)]
    jobs += [job for pair in _gust_jobs(most).values() for job in pair]
    jobs += [
        job for claim in claims for pair in _claim_jobs(claim, most) for job in pair
    ]
    distinct = list(dict.fromkeys(jobs))
    print(f"{len(distinct)} runs", file=sys.stderr)
    with multiprocessing.get_context("spawn").Pool(options.workers) as pool:
        results = pool.map(fly, distinct, chunksize=1)
    measured = dict(zip(distinct, results, strict=True))

    lines, failed = _bar_table((*BARS, *GUSTS), measured, most)
    lines += _gust_table(measured, most) + _claim_table(claims, measured, most)
    text = "\n".join(lines) + "\n"
    print(text)
    print(f"{failed} bars missed, {time.perf_counter() - began:.0f} s", file=sys.stderr)
    if options.write:
        options.write.write_text(_HEAD + text, encoding="utf-8")
    return 3 if failed else 0


def _values(bar: Bar, measured: Measured, most: int) -> list[Any]:
    """Return what is compared with the bound: one number a seed, or a ratio."""
    jobs = [bar.job._replace(seed=seed) for seed in range(min(bar.seeds, most))]
    if bar.measure == "same_again":
        return [
            int(
                measured[job]["trajectory"]
                == measured[job._replace(repeat=1)]["trajectory"]
            )
            for job in jobs
        ]
    values = [measured[job][bar.measure] for job in jobs]
    if bar.against is None:
        return values
    others = [
        measured[bar.against._replace(seed=job.seed)][bar.measure] for job in jobs
    ]
    return [statistics.median(others) / statistics.median(values)]


def _reached(bar: Bar, values: list[Any]) -> tuple[bool, str]:
    """Return whether a bar is reached, and what the table says of it."""
    if bar.against is not None or bar.over in ("median", "mean"):
        known = [v for v in values if v is not None]
        middle = statistics.mean if bar.over == "mean" else statistics.median
        reached = len(known) == len(values) and bar.reached(middle(known))
        return reached, "yes" if reached else "NO"
    count = sum(bar.reached(value) for value in values)
    return count == len(values), f"{count} of {len(values)}"


def _bar_table(
    bars: Sequence[Bar], measured: Measured, most: int
) -> tuple[list[str], int]:
    lines = [
        "## Bars",
        "",
        row("bar", "measure", "bound", "measured", "seeds", "reached", "command"),
        row(*["---"] * 7),
    ]
    failed = 0
    for bar in bars:
        values = _values(bar, measured, most)
        reached, said = _reached(bar, values)
        failed += not reached
        over = "" if bar.over == "every" else f", {bar.over}"
        over += ", ratio of medians" if bar.against is not None else ""
        command = f"`{bar.job.command()}`"
        command += f"; against `{bar.against.command()}`" if bar.against else ""
        lines.append(
            row(
                bar.name,
                bar.measure + over,
                bar.asked(),
                f"{statistics.mean(values):.3g}"
                if bar.over == "mean"
                else spread(values),
                str(min(bar.seeds, most)),
                said,
                command,
            )
        )
    return [*lines, ""], failed


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
        ranges = [round(measured[job]["min_range_ft"], 1) for job in jobs]
        saved = [round(measured[job]["drag_saving_percent"], 1) for job in jobs]
        lines.append(row(str(p), f"{level:g}", spread(ranges), spread(saved)))
    lines += ["", "A run: `" + gust_job(12, 10).command() + "`", ""]
    lines += ["Seed n: `--seed n --set plant.gusts.seed=n`.", ""]
    return lines


Found = tuple[str, Any, Mapping[str, Any]]


def _claims() -> list[Found]:
    """Return (scenario, claim, settings) for every claim."""
    found: list[Found] = []
    for name in (SCENARIO, FAST, VORTEX):
        resolved = resolve(read_document(name))
        found += [(name, c, resolved.settings) for c in resolved.scenario.claims]
    return found


def _claim_jobs(found: Found, most: int) -> list[tuple[Job, ...]]:
    """Return the runs of a claim, or the pairs; one where nothing is random."""
    name, claim, settings = found
    base = claim_assignments(claim, settings)
    both = [base]
    if claim.against is not None:
        both.append(base + assignments_of(claim.against))
    exact = claim.when.get("search.name") == "none"
    seeds = 1 if exact else min(CLAIM_SEEDS, most)
    return [tuple(Job(name, sets, seed=seed) for sets in both) for seed in range(seeds)]


def _claim_table(claims: Sequence[Found], measured: Measured, most: int) -> list[str]:
    lines = [
        "## The chapter's claims 11 to 18 and 23",
        "",
        "A ratio is to the second run that the claim names. Where nothing is random "
        "one run decides; else every seed, or for ratios the median and a Wilcoxon "
        "test.",
        "",
        row("claim", "scenario", "text", "asked", "measured", "verdict", "note"),
        row(*["---"] * 7),
    ]
    for found in claims:
        name, claim, _ = found
        values, verdict = _judged(claim, _claim_jobs(found, most), measured)
        bound = "never" if claim.bound is None else f"{claim.bound:.6g}"
        ratio = " (ratio)" if claim.against is not None else ""
        lines.append(
            row(
                claim.id,
                name,
                f"{claim.text} ({claim.source})",
                f"{claim.measure}{ratio} {claim.relation} {bound}",
                spread(values),
                verdict,
                claim.note or "-",
            )
        )
    return [*lines, ""]


def _judged(
    claim: Any, jobs: list[tuple[Job, ...]], measured: Measured
) -> tuple[list[Any], str]:
    found = [[measured[job][claim.measure] for job in pair] for pair in jobs]
    if claim.against is None:
        values = [value for (value,) in found]
    else:
        values = [a / b for a, b in found]
        if len(values) > 1:
            return values, paired_verdict(values, claim)
    kept = sum(bool(holds(v, claim.relation, claim.bound)) for v in values)
    if kept == len(values):
        return values, "holds"
    if kept:
        return values, f"in part: {kept} of {len(values)} seeds"
    return values, "does not hold"


_HEAD = """# The close formation over seeds

Made by `python benchmarks/close_formation.py --write docs/close_formation_bars.md`.
Numbers are lowest / median / highest over the seeds, 0 and up; append `--seed n --json`
to a command. What is flown and measured: [close_formation.md](close_formation.md).

D: deterministic, IPOPT alone. S: differential evolution. `settled`: 1 where x and y
both settle; `same_again`: 1 where the same seed gives the same trajectory to the bit;
`error_in_turn_ft`: largest distance from the slot while the leader turns, from 20 s
after its beginning; `wall_s`: of a run of 30 s of flight, while another ran beside it.
S4 asks of every seed what the fact sheet asks of all seeds pooled.

"""


if __name__ == "__main__":
    sys.exit(main())
