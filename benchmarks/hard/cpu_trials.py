"""Trials on hard problems whose budget of seconds counts CPU time of the process.

Each trial runs in a process for cells with one thread, in which the clock of all
budgets is the CPU time, so that other work on the machine costs a solver nothing.
Building and compiling do not count, for the library's solvers and for peers alike. The
repair of an answer that breaks a limit between the checks is the same for all, and its
time counts.
"""

from __future__ import annotations

import functools
import json
import os
import re
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from swarmstart.benchmarks.hard.peers import PEERS
from swarmstart.cases.campaign.engine.cell_keys import modules_of_settings
from swarmstart.cases.campaign.engine.cells import Cell
from swarmstart.cases.campaign.engine.wall_limit import PLACE
from swarmstart.cases.campaign.judging.runs import Entry
from swarmstart.cases.campaign.studies.comparing import contest_of
from swarmstart.cases.campaign.studies.comparison_plan import Chosen, ComparisonPlan
from swarmstart.cases.campaign.trials.building import Built, Trial, built
from swarmstart.cases.campaign.trials.solver_names import Solver, solver_of
from swarmstart.cases.campaign.trials.solvers import solve_cell
from swarmstart.cases.campaign.trials.trial import answer_of
from swarmstart.cases.format.scenario import read_document, resolved_again
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.errors import SwarmstartError, load_optional

CHARGE = 3.0
"""Limits of seconds that a failed run is charged; a run may take as many."""
BUILDING_S, AGAIN_S = 60.0, 5.0
"""CPU time for building on top of the limit, and from one stop to the next [s]."""
BUSY = 10.0
"""Ratio of wall time to CPU time from which a run is stopped all the same."""
UNTIMED = "max_wall_time=1e9"
"""Option of IPOPT that removes its own limit of wall time; the budget stops it."""


class OverLimitError(SwarmstartError):
    """A run took more CPU time than its limit."""


def solver_named(name: str) -> Solver:
    """Return a solver of the library or a peer, whose IPOPT has no limit of wall time.

    Raises:
        UnknownSolverError: If there is no such solver.
        MissingPackageError: If its package is not installed.
    """
    if name not in PEERS:
        return solver_of(re.sub(r"ipopt$", f"ipopt[{UNTIMED}]", name))
    peer = PEERS[name]
    load_optional(peer.package, extra="peers", need=name)
    alone = solver_of(f"ipopt[{UNTIMED}]")
    return replace(alone, name=name, title=peer.title, family="peer")


def entries_of(
    problem: str,
    solvers: Sequence[str],
    *,
    seeds: int,
    budget: Mapping[str, float | int],
) -> list[Entry]:
    """Return the cells of solvers on a problem, one for each seed.

    Args:
        problem: Its name, such as hard/walls_2.
        solvers: Names of solvers of the library and of peers.
        seeds: Number of seeds; a deterministic solver has one.
        budget: "seconds" of CPU time, or "evaluations".
    """
    known = [solver_named(name) for name in solvers]
    contest = contest_of(
        Chosen(source=problem, of="plan", assignments=(f"ipopt.options.{UNTIMED}",)),
        read_document(problem),
        # A peer gets what IPOPT alone gets of a scenario: no search, and no lanes.
        [
            solver if solver.name not in PEERS else solver_of("ipopt")
            for solver in known
        ],
        ComparisonPlan(scenarios=(), solvers=(), seeds=1),
        budget,
        lambda resolved: resolved,
    )
    longest = CHARGE * budget.get("seconds", 600.0) + BUILDING_S
    found = []
    for name, solver, entry in zip(solvers, known, contest.entries, strict=True):
        job = {**entry.cells[0].job, "solver": solver.name}
        cells = [
            Cell(
                work="swarmstart.benchmarks.hard.cpu_trials:solved",
                job={**job, "seed": seed, "limit": longest},
                label=f"{problem}, {name}, seed {seed}",
                timeout_s=BUSY * longest,
            )
            for seed in range(1 if solver.is_deterministic else seeds)
        ]
        found.append(Entry(scenario=problem, solver=solver, cells=tuple(cells)))
    return found


def solved(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return the result of a cell, with the time of the repair; called in a worker.

    Args:
        job: As of a cell of `compare`, and "limit", the largest CPU time [s].
        folder: The cell's folder.

    Raises:
        OverLimitError: If the limit is over.
    """
    # The hard limit counts wall time; this one is instead of it.
    os.environ.pop(PLACE, None)
    with counted_by(time.process_time), cpu_limit(job["limit"]):
        return with_repair(answered(job, folder))


def answered(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return the result of a solver or a peer."""
    if job["solver"] not in PEERS:
        return solve_cell(job, folder)
    common = {key: job[key] for key in ("settings", "variant", "solver", "budget")}
    made, first = _built(json.dumps(common))
    trial = replace(first, seed=job["seed"])
    return answer_of(made, trial, route=PEERS[job["solver"]].route).as_json()


@functools.lru_cache(maxsize=len(PEERS))
def _built(text: str) -> tuple[Built, Trial]:
    job = json.loads(text)
    resolved = resolved_again(job["settings"], job["variant"])
    trial = Trial(
        solver=solver_named(job["solver"]),
        budget=job["budget"],
        seed=0,
        search=None,
        repair=True,
        backend=resolved.scenario.evaluator,
    )
    return built(first_problem(resolved.posed()), trial), trial


def modules_of(job: Mapping[str, Any]) -> tuple[str, ...]:
    """Return further modules whose code a cell uses: those of kind and search."""
    return modules_of_settings(job["settings"])


def with_repair(result: dict[str, Any]) -> dict[str, Any]:
    """Return a result whose times have that of the repair, if it needed one."""
    if not result["repaired"]:
        return result
    later, history = result["seconds_repair"], result["history"]
    moved = [seconds + later for seconds in history["seconds"]]
    total = result["seconds"] + later
    return {**result, "seconds": total, "history": {**history, "seconds": moved}}


@contextmanager
def counted_by(clock: Callable[[], float]) -> Iterator[None]:
    """Count all budgets of seconds by another clock.

    The library reads `time.perf_counter`, and has no clock that is passed in.
    """
    before = time.perf_counter
    time.perf_counter = clock
    try:
        yield
    finally:
        time.perf_counter = before


@contextmanager
def cpu_limit(seconds: float) -> Iterator[None]:
    """Raise an OverLimitError in this context after so much CPU time of the process."""

    def over(*_: object) -> None:
        raise OverLimitError(f"it took more than {seconds:g} s of CPU time")

    before = signal.signal(signal.SIGPROF, over)
    # Again and again, since CasADi discards an error of a callback.
    signal.setitimer(signal.ITIMER_PROF, seconds, AGAIN_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
