"""Runs of scenarios by name: each distinct one is flown once, in worker processes."""

import multiprocessing
import os
import shlex
import sys
from collections.abc import Callable, Hashable, Iterable, Mapping
from typing import Any, NamedTuple, TypeVar

from swarmstart.cases.campaign.run import Run, run
from swarmstart.cases.format.scenario import read_document, resolve

AnyJob = TypeVar("AnyJob", bound=Hashable)
Result = TypeVar("Result")


class Job(NamedTuple):
    """One run: hashable, so that it is flown once.

    Attributes:
        scenario: Its name.
        sets: What `--set` changes.
        variant: `--variant`; empty where the scenario has none.
        ipopt: Whether IPOPT alone plans: `--search none --polish ipopt`.
        seed: Of all randomness.
        repeat: Tells a run from the same run again.
    """

    scenario: str
    sets: tuple[str, ...] = ()
    variant: str = ""
    ipopt: bool = False
    seed: int = 0
    repeat: int = 0

    def command(self) -> str:
        """Return the command line, without the seed."""
        words = ["swarmstart", "run", self.scenario]
        words += ["--variant", self.variant] if self.variant else []
        words += ["--search", "none", "--polish", "ipopt"] if self.ipopt else []
        for text in self.sets:
            words += ["--set", text]
        return shlex.join(words)


Measured = Mapping[Job, Mapping[str, Any]]


def flown(job: Job, *more: str) -> Run:
    """Fly one run.

    Args:
        job: The run.
        more: Further settings, as `--set` takes them.
    """
    resolved = resolve(
        read_document(job.scenario),
        variant=job.variant or None,
        search="none" if job.ipopt else None,
        polish="ipopt" if job.ipopt else None,
        assignments=(*job.sets, *more),
    )
    return run(resolved, seed=job.seed)


def fly_all(
    fly: Callable[[AnyJob], Result], jobs: Iterable[AnyJob], workers: int
) -> dict[AnyJob, Result]:
    """Return what `fly` measures of every distinct run."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    distinct = list(dict.fromkeys(jobs))
    print(f"{len(distinct)} runs", file=sys.stderr)
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        return dict(zip(distinct, pool.map(fly, distinct, chunksize=1), strict=True))
