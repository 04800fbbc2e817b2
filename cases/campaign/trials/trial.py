"""A trial: one solver on one planning problem with a budget and a seed.

The parts that trials of all seeds share are built before (building.py). The solver's
clock runs from the end of building and compiling to the answer; then a finer
simulation, the same for all solvers, judges the answer. The solver's family decides how
it runs (`ROUTES`):

search, nlp   the planner's search, its NLP solver, or one after the other
repeated      the NLP solver from random points until the meter stops it
solve         all steps of `swarmstart run` and `swarmstart.solve`, bit for bit
peer          a search of another package, and the NLP solver after it if asked for
control       python-control's solver of optimal-control problems
own           a function of a user's own, which returns controls

A budget of evaluations counts an NLP solver's work in rollouts (`ocp.nlp.Work`) and
stops it after the iteration that spends the budget. Searches, local solves of many
starts at once (lanes) and NLP solvers observe a budget of seconds themselves, between
two generations, batches or iterations. A solver that still runs after LATE times the
budget, plus a moment, is ended by the system (wall_limit.py), and its last checkpoint
is judged (`judged_checkpoint`).

The answer is simulated again ten times finer: "claimed" values are those of the solver,
"verified" ones those of this simulation. The repair of an answer that breaks a
constraint between the checks is not part of the solver: seconds and evaluations of the
repair, and of what `solve` does after it, are given separately.
"""

from __future__ import annotations

import json
import time as clock
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, NamedTuple

import numpy as np

from swarmstart.cases.campaign.engine.wall_limit import hard_limit
from swarmstart.cases.campaign.trials.building import (
    ENDLESS,
    Built,
    Trial,
    built,
    is_loud,
    share_of,
)
from swarmstart.cases.campaign.trials.history import CountedObjective, Meter
from swarmstart.cases.campaign.trials.own_solver import owned
from swarmstart.cases.campaign.trials.peer_names import PEERS
from swarmstart.cases.campaign.trials.peers import (
    WORTH,
    PeerTask,
    peers_best,
    penalised,
)
from swarmstart.cases.campaign.trials.result import PlanResult
from swarmstart.cases.format.kind import PlanningProblem
from swarmstart.cases.record.files import replacing, to_json
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics import Budget
from swarmstart.heuristics.laws import STATIC_PENALTY
from swarmstart.machine_code import stopwatch
from swarmstart.ocp import (
    Planner,
    Solution,
    SolutionStatus,
    multistart,
    verified,
    zero_controls,
)
from swarmstart.ocp.answer import Plan, Source, improved, repaired
from swarmstart.ocp.nlp import Answer, Start
from swarmstart.ocp.rollout import Known
from swarmstart.ocp.system import shown_units
from swarmstart.silence import silenced

LATE, MOMENT_S = 1.1, 0.25
"""The hard limit: a factor of the budget, and a constant [s]."""
CHECKPOINT = "checkpoint.json"


class NotSolvedError(SwarmstartError):
    """A solver found no point."""


class Found(NamedTuple):
    """Answer of a solver.

    Attributes:
        plan: The plan.
        solution: The verified plan, if the solver has verified it itself.
        has_ended: Whether the solver ended by itself.
        rest: Iterator over the answers of the remaining steps of `solve`, the first of
            which is the repair; None if no step remains.
    """

    plan: Plan
    solution: Solution | None = None
    has_ended: bool = True
    rest: Iterator[Solution] | None = None


def answered(
    posed: PlanningProblem, trial: Trial, folder: Path | None = None
) -> PlanResult:
    """Solve a planning problem and return the result; see `answer_of`."""
    return answer_of(built(posed, trial), trial, folder)


def answer_of(
    made: Built,
    trial: Trial,
    folder: Path | None = None,
    *,
    route: Route | None = None,
) -> PlanResult:
    """Return the answer of a trial with its verification and its effort.

    Args:
        made: The common parts of the trials of the same solver.
        trial: The trial.
        folder: Folder of the checkpoints; None means no checkpoints.
        route: Function that runs the solver; None means that of its family.

    Raises:
        SwarmstartError: If the solver cannot solve problems of this form.
    """
    planner, posed, budget = made.planner, made.posed, trial.budget
    rng = np.random.default_rng(trial.seed)
    x0, known, _ = planner.posed(posed.x0, posed.known)
    limit = None
    if budget.get("seconds") is not None:
        limit = LATE * budget["seconds"] + MOMENT_S
    # `solve` keeps its own number of evaluations; only its seconds are limited.
    counts = trial.solver.family != "solve"
    with silenced(is_needed=is_loud(trial)), hard_limit(limit), stopwatch() as watch:
        meter = Meter(
            watch,
            value_of=lambda u, x: planner.fitness.value(u, x, known),
            tolerance=planner.problem.tolerance,
            evaluations=budget.get("evaluations") if counts else None,
            seconds=budget.get("seconds"),
            # Without a hard limit no checkpoint is ever read.
            kept=None if folder is None or limit is None else _keeper(made, folder),
        )
        with made.relay.to(meter):
            found = (route or ROUTES[trial.solver.family])(made, trial, meter, rng)
        seconds = watch.seconds
    if folder is not None:
        (folder / CHECKPOINT).unlink(missing_ok=True)
    with stopwatch() as judging:
        solution = found.solution or verified(
            planner.tracer, found.plan, x0, known, advised=False
        )
    with stopwatch() as repairing:
        final = solution
        if found.rest is not None:
            *_, final = found.rest
        elif trial.repair and trial.solver.family != "solve":
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
    # Searches, lanes and peers report rollouts only.
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
            "units": shown_units(model),
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
        folder: Folder of the trial's checkpoints. Without a checkpoint the solver had
            found nothing, and the numbers of the result are None.
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


def _searched(
    made: Built, trial: Trial, meter: Meter, rng: np.random.Generator
) -> Found:
    """Return the plan of a search, an NLP solver or both."""
    planner, posed = made.planner, made.posed
    x0, known, _ = planner.posed(posed.x0, posed.known)
    # An NLP solver alone is compared from one start, zero controls.
    guess = zero_controls(planner.problem) if planner.search is None else None
    plan = planner.plan(x0, known=known, guess=guess, rng=rng)
    return Found(plan, has_ended=bool(trial.solver.plugin) or not meter.ended)


def _many_starts(
    made: Built, trial: Trial, meter: Meter, rng: np.random.Generator
) -> Found:
    """Return the best of an NLP solver from random points until the budget is spent."""
    del trial, meter
    plan = multistart(
        made.planner,
        made.posed.x0,
        budget=Budget(evaluations=ENDLESS),  # The meter ends the loop.
        known=made.posed.known,
        family=made.posed.family,
        rng=rng,
    )
    return Found(plan)


def _solved(made: Built, trial: Trial, meter: Meter, rng: np.random.Generator) -> Found:
    """Return the answer of `swarmstart.solve`, or of a run that plans once."""
    planner, posed = made.planner, made.posed
    x0, known, guess = planner.posed(posed.x0, posed.known, posed.guess)
    plan = planner.plan(
        x0, known=known, guess=guess, candidates=posed.candidates, rng=rng
    )
    answers = improved(planner, plan, x0, known, repair=trial.repair, rng=rng)
    solution = next(answers)
    if trial.repair and solution.status is SolutionStatus.BROKEN:
        return Found(plan, solution, rest=answers)
    while not meter.is_over:
        better = next(answers, None)
        if better is None:
            break
        solution = better
    return Found(solution.plan, solution)


def _peered(made: Built, trial: Trial, meter: Meter, rng: np.random.Generator) -> Found:
    """Return the answer of a search that is known by name."""
    peer = PEERS[trial.solver.peer]
    search = resolve_name(peer.minimize)
    return searched_by(search, made, trial, meter, rng, options=peer.options)


def searched_by(
    search: Callable[[PeerTask], None],
    made: Built,
    trial: Trial,
    meter: Meter,
    rng: np.random.Generator,
    *,
    options: Mapping[str, Any],
) -> Found:
    """Return the best point that a search has evaluated, polished if asked for.

    Args:
        search: Function that minimises the objective of its task until the budget ends
            it, or it ends by itself.
        made: The common parts of the trials of the same solver, with a search space.
        trial: The trial.
        meter: Counter of the trial.
        rng: Source of the randomness of the polish; the search has the trial's seed.
        options: Options of the search, which those of the solver replace.

    Raises:
        NotSolvedError: If no evaluated point has a cost that is a number.
    """
    planner, space, solver = made.planner, made.space, trial.solver
    if space is None:
        raise TypeError("expected a space")
    x0, known, _ = planner.posed(made.posed.x0, made.posed.known)
    share = share_of(planner, trial)
    weight = _weight(planner, x0, known, trial)
    counted = CountedObjective(
        space.objective(x0, known),
        meter,
        (share.get("evaluations"), share.get("seconds")),
        lambda x: _meant(space.decoded(x, x0, known), x0),
    )
    task = PeerTask(
        objective=lambda population: penalised(*counted(population), weight),
        box=space.box,
        seed=trial.seed,
        options={**options, **dict(solver.options)},
    )
    ended = peers_best(search, task, solver.name)
    if meter.best is None:
        raise NotSolvedError(f"{solver.name} met no point that is a number")
    controls, start = meter.best
    spent = round(meter.evaluations)
    if planner.polisher is None:
        plan = planner.evaluated(
            controls, start, known=known, source=Source.SEARCH, evaluations=spent
        )
        meter.ended = "" if ended else counted.spent
        return Found(plan, has_ended=ended)
    guess = Start(controls, x0=start)
    plan = planner.plan(start, known=known, guess=guess, near=True, rng=rng)
    return Found(plan)


def _owned(made: Built, trial: Trial, meter: Meter, rng: np.random.Generator) -> Found:
    """Return the answer of a user's own solver."""
    if trial.own is None:
        raise TypeError("expected a function")
    posed, budget = made.posed, Budget(**trial.budget)
    x0 = np.asarray(posed.x0, dtype=np.float64).ravel()
    plan, has_ended = owned(
        trial.own,
        trial.solver.name,
        planner=made.planner,
        x0=x0,
        known=posed.known,
        budget=budget,
        meter=meter,
        rng=rng,
    )
    return Found(plan, has_ended=has_ended)


def _meant(start: Start, x0: Any) -> Answer:
    state = x0 if start.x0 is None else start.x0
    return start.controls, np.asarray(state, dtype=np.float64).ravel()


def _weight(planner: Planner, x0: Any, known: Known, trial: Trial) -> float:
    """Return the penalty of a violation of 1 for a peer; see peers.py."""
    order = trial.order
    if order is not None and order.rule == STATIC_PENALTY:
        return float(order.weight)
    return WORTH * float(planner.fitness.arguments.sizes(x0, known).cost)


def _controlled(
    made: Built, trial: Trial, meter: Meter, rng: np.random.Generator
) -> Found:
    """Return the best iterate of python-control's solver."""
    del rng
    name = trial.solver.peer
    ended = resolve_name(PEERS[name].minimize)(made, trial, meter)
    if meter.best is None:
        raise NotSolvedError(f"{name} met no point that is a number")
    controls, start = meter.best
    _, known, _ = made.planner.posed(made.posed.x0, made.posed.known)
    spent = round(meter.evaluations)
    plan = made.planner.evaluated(
        controls, start, known=known, source=Source.POLISH, evaluations=spent
    )
    meter.ended = "" if ended else meter.stopped
    return Found(plan, has_ended=ended)


Route = Callable[[Built, Trial, Meter, np.random.Generator], Found]
ROUTES: Mapping[str, Route] = {
    "search": _searched,
    "nlp": _searched,
    "repeated": _many_starts,
    "solve": _solved,
    "peer": _peered,
    "control": _controlled,
    "own": _owned,
}
"""Family of a solver -> function that runs it: (built, trial, meter, rng) -> Found."""
