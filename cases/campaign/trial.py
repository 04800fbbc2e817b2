"""A trial: one solver on one planning problem with a budget and a seed.

    built       all that seeds have in common: planner, evaluator, kernels, peers
    answered    a trial with it: the solver's own clock runs from when all is built and
                compiled until it answers; then one reference judges the answer

A budget of evaluations counts an NLP solver's work in rollouts (ocp/watching.py) and
stops it after the iteration that spends it. A budget of seconds is kept in time by
searches, lanes and NLP solvers themselves, between two generations, batches or
iterations; what is still running after LATE of it and a moment is ended by the system
(wall_limit.py), and its last checkpoint is judged (`judged_checkpoint`).

Where an NLP solver follows a search, the search has nine tenths of the budget, or less
where ITERATIONS of the NLP solver would not fit into the rest, at least a half.

The answer is simulated again ten times finer: "claimed" is what the solver says of it,
"verified" what the one reference says. What repairs an answer that breaks a constraint
between the checks is no part of the solver: its seconds and evaluations stand apart.
"""

from __future__ import annotations

import json
import math
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.campaign.history import Meter, Relay
from swarmstart.cases.campaign.peers import (
    WORTH,
    BudgetSpent,
    PeerTask,
    peers_best,
    penalised,
)
from swarmstart.cases.campaign.silence import silenced
from swarmstart.cases.campaign.solver_names import IPOPT, PEERS, Solver, polish_of
from swarmstart.cases.campaign.wall_limit import hard_limit
from swarmstart.cases.format.kind import PlanningProblem
from swarmstart.cases.record.files import replacing, to_json
from swarmstart.compile_time import stopwatch
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics import Budget, Order, default_order, minimize
from swarmstart.heuristics.order import STATIC_PENALTY
from swarmstart.ocp import (
    IpoptOptions,
    Planner,
    SearchSettings,
    Solution,
    multistart,
    population_of,
    verified,
)
from swarmstart.ocp.fitness import Known, Objective
from swarmstart.ocp.improving import improved, repaired
from swarmstart.ocp.many_starts import LANES
from swarmstart.ocp.plan import Plan, Source
from swarmstart.ocp.polish_options import PolishOptions
from swarmstart.ocp.search_settings import search_settings
from swarmstart.ocp.search_space import SearchSpace, Start, space_of
from swarmstart.ocp.watching import Answer, Work

Array = NDArray[np.float64]
SEARCH_SHARE, LEAST_SHARE = 0.9, 0.5
"""Of the budget, where an NLP solver follows."""
ITERATIONS = 50
"""Of an NLP solver that should fit into its part of the budget."""
DEAF = {"fatrop": "fatrop.max_iter"}
"""NLP solvers that CasADi cannot stop between iterations -> their limit of these."""
LATE, MOMENT_S = 1.1, 0.25
"""The hard limit, in parts of the budget, and what is added [s]."""
CHECKPOINT = "checkpoint.json"
_ENDLESS = 2**60


class NotSolvedError(SwarmstartError):
    """A solver found no point at all."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Trial:
    """A solver with a budget and a seed.

    Attributes:
        solver: The solver.
        budget: Of one planning problem, as `heuristics.Budget` takes it.
        seed: Seed of all randomness.
        search: The search that the solver names, as the scenario has it; its own budget
            is not used. None: it names none.
        repair: Whether an answer that breaks a constraint between the checks is solved
            again with a margin, whatever the solver.
        backend: What evaluates populations.
        order: How the scenario orders individuals; None: it does not say.
    """

    solver: Solver
    budget: Mapping[str, Any]
    seed: int
    search: SearchSettings | None
    repair: bool = False
    backend: str | None = None
    order: Order | None = None


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Built:
    """What the trials of one solver on one problem have in common.

    Attributes:
        posed: The problem.
        planner: Plans; its search has its part of the budget.
        relay: Tells the meter of the trial at hand.
        space: What a peer searches; None: there is no peer.
        seconds: Time to build it, without compiling [s].
        compile_seconds: Time to compile it [s].
    """

    posed: PlanningProblem
    planner: Planner
    relay: Relay
    space: SearchSpace | None = None
    seconds: float = field(default=0.0)
    compile_seconds: float = field(default=0.0)


class Found(NamedTuple):
    """What a solver answers.

    Attributes:
        plan: The plan.
        solution: The same verified, if the solver has done that itself.
        has_ended: Whether it came to an end of its own.
    """

    plan: Plan
    solution: Solution | None = None
    has_ended: bool = True


def built(posed: PlanningProblem, trial: Trial) -> Built:
    """Return all that the trials of a solver on a problem have in common.

    Args:
        posed: The problem.
        trial: One of the trials; its seed is not used.

    Raises:
        SwarmstartError: If the solver cannot serve the problem.
    """
    solver, relay = trial.solver, Relay()
    space = None
    quiet = silenced(is_needed=solver.plugin not in ("", IPOPT))
    with quiet, stopwatch() as watch:
        planner = _planner(posed, trial, relay, _polish_of(trial))
        fewer = _limited(planner, trial)
        if fewer is not None:
            planner = _planner(posed, trial, relay, fewer)
        planner = planner.with_budget(Budget(**_share(planner, trial)))
        if solver.peer:
            space = space_of(planner.fitness, posed.family)
        _warm_up(planner, posed, trial)
    return Built(
        posed=posed,
        planner=planner,
        relay=relay,
        space=space,
        seconds=watch.seconds,
        compile_seconds=watch.compile_seconds,
    )


def _planner(
    posed: PlanningProblem, trial: Trial, relay: Relay, polish: PolishOptions | None
) -> Planner:
    return Planner(
        posed.problem,
        search=_search_of(trial),
        polish=polish,
        family=posed.family,
        backend=trial.backend,
        lanes=LANES if trial.solver.family == "solve" else 0,
        watch=relay,
    )


def _limited(planner: Planner, trial: Trial) -> PolishOptions | None:
    """Return options with as many iterations as the budget pays for; None: as it is.

    Of an NLP solver that tells nothing of its iterations, and so cannot be stopped.
    """
    option = DEAF.get(trial.solver.plugin)
    evaluations = trial.budget.get("evaluations")
    ratios = None if planner.polisher is None else planner.polisher.ratios
    if option is None or evaluations is None or ratios is None:
        return None
    most = max(int(evaluations / Work(1, 1, 1).evaluations(ratios)), 1)
    given = dict(trial.solver.polish_options)
    given[option] = min(most, given.get(option, most))
    limited: PolishOptions = polish_of(trial.solver.plugin, given)
    return limited


def _search_of(trial: Trial) -> SearchSettings | None:
    """Return the search of a trial with the solver's own options."""
    solver, given = trial.solver, Budget(**trial.budget)
    if solver.family == "solve":
        settings = search_settings("default")
        if settings is None:
            raise TypeError("expected a default search")
        budget = replace(settings.budget, seconds=given.seconds)
        return replace(settings, budget=budget)
    if solver.family != "search" or trial.search is None:
        return None
    options = dict(solver.options)
    sampling = options.pop("sampling", trial.search.sampling)
    algorithm: Any = trial.search.algorithm
    return SearchSettings(
        algorithm=replace(algorithm, **options),
        budget=given,
        order=trial.search.order,
        sampling=sampling,
    )


def _polish_of(trial: Trial) -> PolishOptions | None:
    """Return the NLP solver of a trial."""
    solver = trial.solver
    if not solver.plugin:
        return None
    options: PolishOptions = polish_of(solver.plugin, dict(solver.polish_options))
    if isinstance(options, IpoptOptions):
        options = replace(options, max_seconds=trial.budget.get("seconds"))
    return options


def _share(planner: Planner, trial: Trial) -> dict[str, Any]:
    """Return the part of a budget that the search has."""
    solver, budget = trial.solver, dict(trial.budget)
    if planner.search is not None and solver.family == "solve":
        limits = planner.search.budget
        return {"evaluations": limits.evaluations, "seconds": limits.seconds}
    if not solver.plugin:
        return budget
    if budget.get("seconds") is not None:
        budget["seconds"] = SEARCH_SHARE * budget["seconds"]
    if budget.get("evaluations") is not None:
        budget["evaluations"] = _most_searched(planner, budget["evaluations"])
    return budget


def _most_searched(planner: Planner, evaluations: int) -> int:
    """Return how many of the evaluations a search has before an NLP solver."""
    ratios = None if planner.polisher is None else planner.polisher.ratios
    rest = (1 - SEARCH_SHARE) * evaluations
    if ratios is not None:
        rest = max(rest, ITERATIONS * Work(1, 1, 1).evaluations(ratios))
    return max(int(max(evaluations - rest, LEAST_SHARE * evaluations)), 1)


def _warm_up(planner: Planner, posed: PlanningProblem, trial: Trial) -> None:
    """Compile and load now what else would be while the clock runs."""
    if planner.polisher is not None and trial.solver.family not in (
        "nlp",
        "multistart",
    ):
        planner.polisher.prepare()
    if trial.solver.peer:
        import importlib

        importlib.import_module(PEERS[trial.solver.peer].package)
    if trial.solver.family == "solve":
        float(planner.tracer.problem.length)
    search = planner.search
    planner.prepare()
    population = None if search is None else population_of(search.algorithm)
    if search is None or population is None:
        return
    space = space_of(planner.fitness, posed.family)
    x0, known, _ = planner.posed(posed.x0, posed.known)
    with np.errstate(all="ignore"):
        minimize(
            space.objective(x0, known),
            space.box,
            algorithm=population,
            budget=Budget(evaluations=_ENDLESS, stagnation=1, seconds=1e-9),
            order=search.order or default_order(planner.problem.tolerance),
            seed=0,
        )


def answered(
    posed: PlanningProblem, trial: Trial, folder: Path | None = None
) -> dict[str, Any]:
    """Solve a planning problem, and return what is kept of it; see `answer_of`.

    Args:
        posed: The problem.
        trial: The solver, its budget and seed.
        folder: Where checkpoints are kept; None: none are.
    """
    return answer_of(built(posed, trial), trial, folder)


def answer_of(made: Built, trial: Trial, folder: Path | None = None) -> dict[str, Any]:
    """Return what a trial answers and what that is worth, as JSON has it.

    Args:
        made: What the trial is done with, of the same solver.
        trial: The trial.
        folder: Where checkpoints are kept; None: none are.

    Raises:
        SwarmstartError: If the solver cannot serve the problem.
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
            found = _ROUTES[trial.solver.family](made, trial, meter, rng)
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
    return _told(
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
    """Return what NLP solvers asked for; what else was spent are rollouts."""
    work, ratios = meter.work, meter.ratios
    others = meter.evaluations - work.evaluations(ratios)
    return {
        "rollouts": work.rollouts + max(round(others), 0),
        "gradients": work.gradients,
        "hessians": work.hessians,
        "gradient_ratio": ratios.gradient,
        "hessian_ratio": ratios.hessian,
    }


def _told(
    solution: Solution, history: Mapping[str, Any], **account: Any
) -> dict[str, Any]:
    """Return an answer and its account; numbers are finite or None."""
    problem, plan = solution.problem, solution.plan
    checks, model = problem.checks, problem.model
    account["evaluations"] = round(account["evaluations"])
    told = {
        "of": "plan",
        "sense": int(problem.sense),
        "claimed_cost": plan.cost,
        "claimed_violation": plan.violation,
        "claimed_feasible": plan.feasible,
        "verified_cost": solution.path.cost,
        "verified_violation": solution.verified_violation,
        "feasible": bool(solution.status.is_confirmed),
        "status": solution.status.value,
        **account,
        "history": history,
        "plan": {
            "time": solution.times[::checks].tolist(),
            "states": solution.states[:, ::checks].tolist(),
            "controls": np.asarray(solution.controls).tolist(),
            "state_names": list(model.state_names),
            "control_names": list(model.control_names),
        },
    }
    return {key: _finite(value) for key, value in told.items()}


def _finite(value: Any) -> Any:
    """Return plain data with None for what is not finite."""
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return value


def _searched(
    made: Built, trial: Trial, meter: Meter, rng: np.random.Generator
) -> Found:
    """Return the plan of a search, an NLP solver or both."""
    planner, posed = made.planner, made.posed
    x0, known, _ = planner.posed(posed.x0, posed.known)
    plan = planner.plan(x0, known=known, rng=rng)
    return Found(plan, has_ended=bool(trial.solver.plugin) or not meter.ended)


def _many_starts(
    made: Built, trial: Trial, meter: Meter, rng: np.random.Generator
) -> Found:
    """Return the best of an NLP solver from random points until all is spent."""
    del trial, meter
    plan = multistart(
        made.planner,
        made.posed.x0,
        budget=Budget(evaluations=_ENDLESS),  # The meter stops it.
        known=made.posed.known,
        family=made.posed.family,
        rng=rng,
    )
    return Found(plan)


def _solved(made: Built, trial: Trial, meter: Meter, rng: np.random.Generator) -> Found:
    """Return what `swarmstart.solve` does."""
    del trial
    planner, posed = made.planner, made.posed
    x0, known, _ = planner.posed(posed.x0, posed.known)
    plan = planner.plan(x0, known=known, rng=rng)
    answers = improved(planner, plan, x0, known, repair=False, rng=rng)
    solution = next(answers)
    while not meter.is_over:
        better = next(answers, None)
        if better is None:
            break
        solution = better
    return Found(solution.plan, solution)


def _peered(made: Built, trial: Trial, meter: Meter, rng: np.random.Generator) -> Found:
    """Return the best point that a peer has asked for, polished if that is asked."""
    planner, space, solver = made.planner, made.space, trial.solver
    if space is None:
        raise TypeError("expected a space")
    x0, known, _ = planner.posed(made.posed.x0, made.posed.known)
    share = _share(planner, trial)
    asked = _Asked(space.objective(x0, known), _weight(planner, x0, known, trial))
    asked.meter, asked.limits = meter, (share.get("evaluations"), share.get("seconds"))
    asked.answer = lambda x: _meant(space.decoded(x, x0, known), x0)
    task = PeerTask(
        objective=asked,
        box=space.box,
        seed=trial.seed,
        options={**PEERS[solver.peer].options, **dict(solver.options)},
    )
    ended = peers_best(resolve_name(PEERS[solver.peer].minimize), task, solver.peer)
    if meter.best is None:
        raise NotSolvedError(f"{solver.peer} met no point that is a number")
    controls, start = meter.best
    spent = round(meter.evaluations)
    if planner.polisher is None:
        plan = planner.evaluated(
            controls, start, known=known, source=Source.SEARCH, evaluations=spent
        )
        meter.ended = "" if ended else asked.spent
        return Found(plan, has_ended=ended)
    guess = Start(controls, x0=start)
    plan = planner.plan(start, known=known, guess=guess, near=True, rng=rng)
    return Found(plan)


def _meant(start: Start, x0: Any) -> Answer:
    state = x0 if start.x0 is None else start.x0
    return start.controls, np.asarray(state, dtype=np.float64).ravel()


def _weight(planner: Planner, x0: Any, known: Known, trial: Trial) -> float:
    """Return what a violation of 1 is worth to a peer; see peers.py."""
    order = trial.order
    if order is not None and order.rule == STATIC_PENALTY:
        return float(order.weight)
    return WORTH * float(planner.fitness.arguments.sizes(x0, known).cost)


class _Asked:
    """The objective of a peer: counts, and ends it when its budget is spent.

    Attributes:
        meter: Counts.
        limits: Evaluations and seconds that the peer has; None: no limit.
        answer: What a point means.
        spent: Which limit has ended it.
    """

    meter: Meter
    limits: tuple[int | None, float | None]
    answer: Callable[[Array], Answer]

    def __init__(self, objective: Objective, weight: float) -> None:
        self._objective, self._weight, self.spent = objective, weight, ""

    def __call__(self, population: Array) -> Array:
        most, seconds = self.limits
        population = np.ascontiguousarray(population, dtype=np.float64)
        size, meter = population.shape[1], self.meter
        if most is not None:
            size = min(size, most - round(meter.evaluations))
        values = self._objective(np.ascontiguousarray(population[:, :size]))
        meter.evaluated(population[:, :size], values, self.answer)
        if most is not None and meter.evaluations >= most:
            self.spent = "evaluations"
        elif seconds is not None and meter.seconds >= seconds:
            self.spent = "seconds"
        if self.spent:
            raise BudgetSpent
        return penalised(*values, self._weight)


_ROUTES: Mapping[str, Callable[..., Found]] = {
    "search": _searched,
    "nlp": _searched,
    "multistart": _many_starts,
    "solve": _solved,
    "peer": _peered,
}


def _keeper(made: Built, folder: Path) -> Callable[[Meter], None]:
    """Return what writes a checkpoint: not synced, since only the process may die."""

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


def judged_checkpoint(
    posed: PlanningProblem, trial: Trial, folder: Path
) -> dict[str, Any]:
    """Return what a trial had found when the hard limit ended its process.

    Args:
        posed: The problem.
        trial: The trial.
        folder: Where its checkpoints were kept. Without any it had found nothing: then
            its numbers are None.
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
    told = _told(
        solution,
        kept["history"],
        evaluations=kept["history"]["evaluations"][-1],
        counts=kept["counts"],
        seconds=seconds,
        build_seconds=kept["build_seconds"],
        compile_seconds=kept["compile_seconds"],
        judge_seconds=clock.perf_counter() - began,
        stopped_by="hard limit",
        repaired=False,
        seconds_repair=0.0,
        evaluations_repair=0,
    )
    (folder / CHECKPOINT).unlink(missing_ok=True)
    return told


def _checkpoint(folder: Path) -> dict[str, Any] | None:
    try:
        kept = json.loads((folder / CHECKPOINT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return kept if isinstance(kept, dict) else None


def _nothing(posed: PlanningProblem, seconds: float) -> dict[str, Any]:
    """Return the result of a trial that had found nothing."""
    empty: dict[str, list[Any]] = {
        key: [] for key in ("evaluations", "seconds", "cost", "violation")
    }
    numbers = ("claimed_cost", "claimed_violation", "verified_cost")
    return {
        "of": "plan",
        "sense": int(posed.problem.sense),
        **dict.fromkeys((*numbers, "verified_violation")),
        "claimed_feasible": False,
        "feasible": False,
        "status": "the hard limit ended it before it had found anything",
        "evaluations": 0,
        "counts": {
            "rollouts": 0, "gradients": 0, "hessians": 0,
            "gradient_ratio": 0.0, "hessian_ratio": 0.0,
        },
        "seconds": seconds,
        "build_seconds": None,
        "compile_seconds": None,
        "judge_seconds": 0.0,
        "stopped_by": "hard limit",
        "repaired": False,
        "seconds_repair": 0.0,
        "evaluations_repair": 0,
        "history": empty,
        "plan": None,
    }  # fmt: skip
