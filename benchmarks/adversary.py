"""The adversary: problems with independently known answers, in three unit systems.

    python benchmarks/adversary.py
    python benchmarks/adversary.py --class nonsmooth --limit 10 --backend auto --verbose

Each is solved with default settings, on two backends. A judge has its own statement of
each problem in NumPy, and decides by DOP853 at 1e-10 whether the claim is true and the
answer right. The exit status is 1 if any claim was false. Classes in brackets do not
count.
"""

import argparse
import multiprocessing
import os
import sys
import time
from collections.abc import Iterable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from swarmstart.benchmarks.tables import row
from swarmstart.tests.adversary.case import UNITS, Case, in_units
from swarmstart.tests.adversary.catalogue import CLASSES, all_cases, chosen
from swarmstart.tests.adversary.claims import claimed
from swarmstart.tests.adversary.judge import Verdict, judge

BACKENDS = ("auto", "casadi")
WORKERS = 2
COLUMNS = ("class", "problems", "runs", "false", "solvable", "solved", "share")


class Job(NamedTuple):
    """One run: class and name of a case (so that it can be pickled), units, backend."""

    kind: str
    name: str
    units: int
    backend: str
    seed: int


class Outcome(NamedTuple):
    """A run and its outcome.

    Attributes:
        job: The run.
        verdict: Verdict of the judge.
        is_solvable: Whether the problem has a solution.
        is_counted: Whether its class counts.
        failure: The error that was raised; empty if there was none.
        seconds: Wall time, the judge's included.
    """

    job: Job
    verdict: Verdict
    is_solvable: bool
    is_counted: bool
    failure: str
    seconds: float


@cache
def cases_of(kind: str) -> dict[str, Case]:
    """Return the cases of a class by name."""
    return {case.name: case for case in all_cases([kind])}


def outcome_of(job: Job) -> Outcome:
    """Solve one case, and judge its claim."""
    case = in_units(cases_of(job.kind)[job.name], UNITS[job.units])
    start, failure, verdict = time.perf_counter(), "", Verdict()
    try:
        verdict = judge(case.truth, claimed(case, backend=job.backend, seed=job.seed))
    except Exception as error:  # noqa: BLE001 - a crash is an outcome, and printed
        failure = f"{type(error).__name__}: {error}"
    return Outcome(
        job,
        verdict,
        case.truth.is_solvable,
        case.is_counted,
        failure,
        time.perf_counter() - start,
    )


def jobs(options: argparse.Namespace) -> list[Job]:
    """Return the requested runs."""
    kinds = [options.kind] if options.kind else [*CLASSES]
    backends = [options.backend] if options.backend else [*BACKENDS]
    found = []
    for kind in kinds:
        cases = list(cases_of(kind).values())
        if options.limit:
            rng = np.random.default_rng(options.seed)
            cases = chosen(cases, options.limit, rng=rng)
        found += [
            Job(kind, case.name, units, backend, options.seed)
            for case in cases
            for units in range(len(UNITS))
            for backend in backends
        ]
    return found


def say(outcome: Outcome) -> None:
    """Print a run whose claim is false or whose problem is not solved."""
    job, verdict = outcome.job, outcome.verdict
    said = "; ".join(verdict.faults)
    mark = "FALSE" if said else "crash" if outcome.failure else "missed"
    why = said or outcome.failure or verdict.note
    print(f"{mark}: {job.name}, units {job.units}, {job.backend}: {why}", flush=True)


def table(outcomes: Iterable[Outcome]) -> list[str]:
    """Return the table by class, in Markdown, with a last row for all that count."""
    groups: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        label = outcome.job.kind if outcome.is_counted else f"({outcome.job.kind})"
        groups.setdefault(label, []).append(outcome)
        if outcome.is_counted:
            groups.setdefault("all that count", []).append(outcome)
    if "all that count" in groups:
        groups["all that count"] = groups.pop("all that count")
    lines = [row(*COLUMNS), row("---", *["---:"] * (len(COLUMNS) - 1))]
    for label, group in groups.items():
        solvable = [o for o in group if o.is_solvable]
        solved = sum(o.verdict.is_right for o in solvable)
        share = f"{100 * solved / len(solvable):.1f} %" if solvable else ""
        counts = (
            len({o.job.name for o in group}),
            len(group),
            sum(bool(o.verdict.faults) for o in group),
            len(solvable),
            solved,
        )
        lines.append(row(label, *map(str, counts), share))
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the set, and print what is false, what is missed and the shares."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--class", dest="kind", choices=[*CLASSES])
    parser.add_argument("--limit", type=int, default=0, help="cases of each class")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--backend", choices=["auto", "llvm", "casadi"])
    parser.add_argument("--verbose", action="store_true", help="print what is missed")
    options = parser.parse_args(arguments)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    start, outcomes = time.perf_counter(), []
    with multiprocessing.get_context("spawn").Pool(WORKERS) as pool:
        for outcome in pool.imap(outcome_of, jobs(options), chunksize=4):
            outcomes.append(outcome)
            verdict = outcome.verdict
            if verdict.faults or (options.verbose and not verdict.is_right):
                say(outcome)
    print("\n".join(table(outcomes)))
    crashed = sum(bool(outcome.failure) for outcome in outcomes)
    print(f"{crashed} crashes; {time.perf_counter() - start:.0f} s")
    return 1 if any(outcome.verdict.faults for outcome in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
