"""A trial: one solver on one planning problem with a budget and a seed.

    building.py    common parts of all seeds: planner, evaluator, kernels, peers
    routes.py      the function that runs a solver, by its family
    answered       a trial: the solver's clock runs from the end of building and
                   compiling to its answer; then one reference judges the answer

A budget of evaluations counts an NLP solver's work in rollouts (watching.py) and
stops it after the iteration that spends the budget. A budget of seconds is kept by
searches, lanes and NLP solvers themselves, between two generations, batches or
iterations. A solver that still runs after LATE times the budget and a moment is ended
by the system (wall_limit.py), and its last checkpoint is judged (`judged_checkpoint`).

The answer is simulated again ten times finer: "claimed" values are those of the solver,
"verified" ones those of this simulation. The repair of an answer that breaks a
constraint between the checks is not part of the solver: its seconds and evaluations are
given separately.
"""

from __future__ import annotations

import json
import time as clock
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from swarmstart.cases.campaign.engine.wall_limit import hard_limit
from swarmstart.cases.campaign.trials.building import Built, Trial, built
from swarmstart.cases.campaign.trials.history import Meter
from swarmstart.cases.campaign.trials.result import PlanResult
from swarmstart.cases.campaign.trials.routes import ROUTES
from swarmstart.cases.campaign.trials.solver_names import IPOPT
from swarmstart.cases.format.kind import PlanningProblem
from swarmstart.cases.format.silence import silenced
from swarmstart.cases.record.files import replacing, to_json
from swarmstart.machine_code import stopwatch
from swarmstart.ocp import Planner, Solution, verified
from swarmstart.ocp.answer import Source, repaired

LATE, MOMENT_S = 1.1, 0.25
"""The hard limit: a factor of the budget, and a constant [s]."""
CHECKPOINT = "checkpoint.json"


def answered(
    posed: PlanningProblem, trial: Trial, folder: Path | None = None
) -> PlanResult:
    """Solve a planning problem and return the result; see `answer_of`.

    Args:
        posed: The problem.
        trial: The solver, its budget and seed.
        folder: Folder of the checkpoints; None means no checkpoints.
    """
    return answer_of(built(posed, trial), trial, folder)


def answer_of(made: Built, trial: Trial, folder: Path | None = None) -> PlanResult:
    """Return the answer of a trial with its verification and its effort.

    Args:
        made: The common parts of the trials of the same solver.
        trial: The trial.
        folder: Folder of the checkpoints; None means no checkpoints.

    Raises:
        SwarmstartError: If the solver cannot solve problems of this form.
    """
    planner, posed, budget = made.planner, made.posed, trial.budget
    rng = np.random.default_rng(trial.seed)
    x0, known, _ = planner.posed(posed.x0, posed.known)
    limit = None
    if budget.get("seconds") is not None:
        limit = LATE * budget["seconds"] + MOMENT_S
    is_loud = trial.solver.plugin not in ("", IPOPT) or bool(trial.solver.peer)
    counts = trial.solver.family != "solve"
    with silenced(is_needed=is_loud), hard_limit(limit), stopwatch() as watch:
        meter = Meter(
            watch,
            value_of=lambda u, x: planner.fitness.value(u, x, known),
            tolerance=planner.problem.tolerance,
            evaluations=budget.get("evaluations") if counts else None,
            seconds=budget.get("seconds"),
            kept=None if folder is None or limit is None else _keeper(made, folder),
        )
        with made.relay.to(meter):
            found = ROUTES[trial.solver.family](made, trial, meter, rng)
        seconds = watch.seconds
    if folder is not None:
        (folder / CHECKPOINT).unlink(missing_ok=True)
    with stopwatch() as judging:
        solution = found.solution or verified(
            planner.tracer, found.plan, x0, known, advised=False
        )
    with stopwatch() as repairing:
        final = solution
        if trial.repair:
            final = repaired(planner, solution, x0, known, rng=rng).solution
    own = found.plan.cost, found.plan.violation
    stopped = meter.stopped or ("itself" if found.has_ended else meter.ended)
    return _result(
        final,
        meter.history(own, seconds=seconds),
        evaluations=meter.evaluations,
        counts=_counts(meter),
        seconds=seconds,
        build_seconds=made.seconds,
        compile_seconds=made.compile_seconds + watch.compile_seconds,
        judge_seconds=judging.seconds + judging.compile_seconds,
        stopped_by=stopped or "itself",
        repaired=final is not solution,
        seconds_repair=repairing.seconds if trial.repair else 0.0,
        evaluations_repair=max(final.plan.evaluations - found.plan.evaluations, 0),
    )


def _counts(meter: Meter) -> dict[str, Any]:
    """Return the evaluations of NLP solvers; all others are rollouts."""
    work, ratios = meter.work, meter.ratios
    others = meter.evaluations - work.evaluations(ratios)
    return {
        "rollouts": work.rollouts + max(round(others), 0),
        "gradients": work.gradients,
        "hessians": work.hessians,
        "gradient_ratio": ratios.gradient,
        "hessian_ratio": ratios.hessian,
    }


def _result(
    solution: Solution, history: Mapping[str, Any], *, evaluations: float, **effort: Any
) -> PlanResult:
    """Return an answer and its effort."""
    problem, plan = solution.problem, solution.plan
    checks, model = problem.checks, problem.model
    return PlanResult(
        sense=int(problem.sense),
        claimed_cost=plan.cost,
        claimed_violation=plan.violation,
        claimed_feasible=plan.feasible,
        verified_cost=solution.path.cost,
        verified_violation=solution.verified_violation,
        feasible=bool(solution.status.is_confirmed),
        status=solution.status.value,
        evaluations=round(evaluations),
        history=history,
        plan={
            "time": solution.times[::checks].tolist(),
            "states": solution.states[:, ::checks].tolist(),
            "controls": np.asarray(solution.controls).tolist(),
            "state_names": list(model.state_names),
            "control_names": list(model.control_names),
        },
        **effort,
    )


def _keeper(made: Built, folder: Path) -> Callable[[Meter], None]:
    """Return a writer of checkpoints, not synced since only the process can die."""

    def keep(meter: Meter) -> None:
        if meter.best is None:
            return
        controls, start = meter.best
        content = {
            "controls": controls.tolist(),
            "x0": np.asarray(start).tolist(),
            "counts": _counts(meter),
            "history": meter.history(),
            "build_seconds": made.seconds,
            "compile_seconds": made.compile_seconds,
        }
        with replacing(folder / CHECKPOINT) as temporary:
            temporary.write_text(to_json(content), encoding="utf-8")

    return keep


def judged_checkpoint(posed: PlanningProblem, trial: Trial, folder: Path) -> PlanResult:
    """Return the result of a trial whose process the hard limit has ended.

    Args:
        posed: The problem.
        trial: The trial.
        folder: Folder of its checkpoints. Without a checkpoint it had found nothing,
            and its numbers have the value None.
    """
    began = clock.perf_counter()
    seconds = LATE * trial.budget["seconds"] + MOMENT_S
    kept = _checkpoint(folder)
    if kept is None:
        return _nothing(posed, seconds)
    planner = Planner(posed.problem, search=None, backend=trial.backend)
    x0, known, _ = planner.posed(posed.x0, posed.known)
    controls, start = np.array(kept["controls"]), np.array(kept["x0"])
    plan = planner.evaluated(controls, start, known=known, source=Source.SEARCH)
    solution = verified(planner.tracer, plan, x0, known, advised=False)
    result = _result(
        solution,
        kept["history"],
        evaluations=kept["history"]["evaluations"][-1],
        counts=kept["counts"],
        seconds=seconds,
        build_seconds=kept["build_seconds"],
        compile_seconds=kept["compile_seconds"],
        judge_seconds=clock.perf_counter() - began,
        stopped_by="hard limit",
    )
    (folder / CHECKPOINT).unlink(missing_ok=True)
    return result


def _checkpoint(folder: Path) -> dict[str, Any] | None:
    try:
        kept = json.loads((folder / CHECKPOINT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return kept if isinstance(kept, dict) else None


def _nothing(posed: PlanningProblem, seconds: float) -> PlanResult:
    """Return the result of a trial that had found nothing."""
    return PlanResult(
        sense=int(posed.problem.sense),
        status="the hard limit ended it before it had found anything",
        seconds=seconds,
        stopped_by="hard limit",
        history={key: [] for key in ("evaluations", "seconds", "cost", "violation")},
    )
