"""Building of the parts that all trials of one solver on one problem share.

If an NLP solver follows a search, the search has nine tenths of the budget, or less if
ITERATIONS of the NLP solver would not fit into the rest, but at least a half.

All machine code is compiled or loaded here, before any clock runs.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from swarmstart.cases.campaign.trials.own_solver import OwnSolver
from swarmstart.cases.campaign.trials.peer_names import PEERS
from swarmstart.cases.campaign.trials.solver_names import IPOPT, Solver, polish_of
from swarmstart.cases.format.kind import PlanningProblem
from swarmstart.heuristics import Budget, Order, default_order, minimize
from swarmstart.machine_code import stopwatch
from swarmstart.ocp import (
    IpoptOptions,
    NlpOptions,
    Planner,
    SearchSettings,
    population_of,
)
from swarmstart.ocp.nlp import DEAF, PolishOptions, Relay, Unwatched, Work
from swarmstart.ocp.search import SearchSpace, space_of
from swarmstart.silence import silenced

SEARCH_SHARE, LEAST_SHARE = 0.9, 0.5
"""Part of the budget that a search has if an NLP solver follows."""
ITERATIONS = 50
"""Iterations of an NLP solver that should fit into its part of the budget."""
ENDLESS = 2**60
"""Number of evaluations that stands for no limit."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Trial:
    """A solver with a budget and a seed.

    Attributes:
        solver: The solver.
        budget: Budget of one planning problem, as arguments of `heuristics.Budget`.
        seed: Seed of all random numbers.
        search: The search that the solver names, with the scenario's settings; the
            budget in it counts for `solve` only. None if the solver has no search.
        polish: The NLP solver of the solver `solve`; other solvers name their own.
        lanes: Number of random starts of the solver `solve`.
        own: The function of a user's own solver; None for others.
        repair: Whether an answer that breaks a constraint between the checks is solved
            again with a margin, for every solver.
        backend: Evaluator of populations.
        order: The scenario's order of individuals; None if the scenario gives none.
    """

    solver: Solver
    budget: Mapping[str, Any]
    seed: int
    search: SearchSettings | None
    polish: PolishOptions | None = None
    lanes: int = 0
    own: OwnSolver | None = None
    repair: bool = False
    backend: str | None = None
    order: Order | None = None


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Built:
    """Common parts of the trials of one solver on one problem.

    Attributes:
        posed: The problem.
        planner: The planner; its search has a part of the trial's budget.
        relay: Object that passes reports on to the meter of the current trial.
        space: Search space, if the solver is a search of another package (a peer); None
            for other solvers.
        seconds: Time to build these parts, without compiling [s].
        compile_seconds: Time to compile these parts [s].
    """

    posed: PlanningProblem
    planner: Planner
    relay: Relay
    space: SearchSpace | None = None
    seconds: float = 0.0
    compile_seconds: float = 0.0


def built(posed: PlanningProblem, trial: Trial) -> Built:
    """Return the common parts of the trials of a solver on a problem.

    Args:
        posed: The problem.
        trial: One of the trials; its seed is not used.

    Raises:
        SwarmstartError: If the solver cannot solve problems of this form.
    """
    solver, relay = trial.solver, Relay()
    space = None
    quiet = silenced(is_needed=is_loud(trial))
    # Observed already, so that no trial has to build the solver that reports iterates.
    with quiet, stopwatch() as watch, relay.to(Unwatched()):
        planner = _planner(posed, trial, relay, _polish_of(trial))
        # The costs of derivatives are known only after the planner is built.
        fewer = _limited(planner, trial)
        if fewer is not None:
            planner = _planner(posed, trial, relay, fewer)
        if solver.family != "solve":
            planner = planner.with_budget(Budget(**share_of(planner, trial)))
        if solver.family == "peer":
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
        lanes=trial.lanes,
        watch=relay,
    )


def _limited(planner: Planner, trial: Trial) -> PolishOptions | None:
    """Return options with as many iterations as the budget allows; None if unchanged.

    This is for NLP solvers that do not report iterations and cannot be stopped.
    """
    option = DEAF.get(trial.solver.plugin)
    evaluations = trial.budget.get("evaluations")
    ratios = None if planner.polisher is None else planner.polisher.ratios
    if option is None or evaluations is None or ratios is None:
        return None
    # An iteration counts as one rollout, one gradient and one Hessian.
    most = max(int(evaluations / Work(1, 1, 1).evaluations(ratios)), 1)
    given = dict(trial.solver.polish_options)
    # A lower limit of the user remains.
    given[option] = min(most, given.get(option, most))
    limited: PolishOptions = polish_of(trial.solver.plugin, given)
    return limited


def _search_of(trial: Trial) -> SearchSettings | None:
    """Return the search of a trial with the solver's own options."""
    solver, given = trial.solver, Budget(**trial.budget)
    if trial.search is None:
        return None
    if solver.family == "solve":
        limits = [s for s in (trial.search.budget.seconds, given.seconds) if s]
        own = replace(trial.search.budget, seconds=min(limits, default=None))
        return replace(trial.search, budget=own)
    if solver.family != "search":
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
    solver, options = trial.solver, trial.polish
    if solver.plugin:
        options = polish_of(solver.plugin, dict(solver.polish_options))
    seconds = trial.budget.get("seconds")
    if isinstance(options, IpoptOptions) and seconds is not None:
        options = replace(options, max_seconds=seconds)
    return options


def is_loud(trial: Trial) -> bool:
    """Return whether a solver of a trial may print; IPOPT is quiet by its options."""
    own = isinstance(trial.polish, NlpOptions)
    return own or trial.solver.plugin not in ("", IPOPT) or bool(trial.solver.peer)


def share_of(planner: Planner, trial: Trial) -> dict[str, Any]:
    """Return the part of a trial's budget that is left to its search.

    The search may be one of another package. An NLP solver after it gets the rest.
    """
    solver, budget = trial.solver, dict(trial.budget)
    if not solver.plugin:
        return budget
    if budget.get("seconds") is not None:
        budget["seconds"] = SEARCH_SHARE * budget["seconds"]
    if budget.get("evaluations") is not None:
        budget["evaluations"] = _most_searched(planner, budget["evaluations"])
    return budget


def _most_searched(planner: Planner, evaluations: int) -> int:
    """Return the number of evaluations of a search before an NLP solver."""
    ratios = None if planner.polisher is None else planner.polisher.ratios
    rest = (1 - SEARCH_SHARE) * evaluations
    if ratios is not None:
        rest = max(rest, ITERATIONS * Work(1, 1, 1).evaluations(ratios))
    return max(int(max(evaluations - rest, LEAST_SHARE * evaluations)), 1)


def _warm_up(planner: Planner, posed: PlanningProblem, trial: Trial) -> None:
    """Compile and load machine code now, and not while the clock runs."""
    if trial.solver.peer:
        # Not the solver's work, so not on its clock.
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
            # Its time is over after the first generation: only the kernels are wanted.
            budget=Budget(evaluations=ENDLESS, stagnation=1, seconds=1e-9),
            order=search.order or default_order(planner.problem.tolerance),
            seed=0,
        )
