"""Ways to solve: the function that runs a trial, by the solver's family.

search, nlp   the planner's search, its NLP solver, or one after the other
multistart    the NLP solver from random points until the meter stops it
solve         all steps of `swarmstart.solve`
peer          a search of another package, and the NLP solver after it if asked for
control       python-control's solver of optimal-control problems
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pkgutil import resolve_name
from typing import Any, NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.campaign.trials.building import ENDLESS, Built, Trial, share_of
from swarmstart.cases.campaign.trials.history import Meter
from swarmstart.cases.campaign.trials.peer_names import PEERS
from swarmstart.cases.campaign.trials.peers import (
    WORTH,
    BudgetSpent,
    PeerTask,
    peers_best,
    penalised,
)
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics import Budget
from swarmstart.heuristics.laws import STATIC_PENALTY
from swarmstart.ocp import Planner, Solution, multistart
from swarmstart.ocp.answer import Plan, Source, improved
from swarmstart.ocp.nlp import Answer, Start
from swarmstart.ocp.rollout import Known, Objective


class NotSolvedError(SwarmstartError):
    """A solver found no point."""


class Found(NamedTuple):
    """Answer of a solver.

    Attributes:
        plan: The plan.
        solution: The verified plan, if the solver has verified it itself.
        has_ended: Whether it ended by itself.
    """

    plan: Plan
    solution: Solution | None = None
    has_ended: bool = True


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
    """Return the answer of `swarmstart.solve`."""
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
    """Return the best point that a peer has evaluated, polished if asked for."""
    planner, space, solver = made.planner, made.space, trial.solver
    if space is None:
        raise TypeError("expected a space")
    x0, known, _ = planner.posed(made.posed.x0, made.posed.known)
    share = share_of(planner, trial)
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
    """Return the penalty of a violation of 1 for a peer; see peers.py."""
    order = trial.order
    if order is not None and order.rule == STATIC_PENALTY:
        return float(order.weight)
    return WORTH * float(planner.fitness.arguments.sizes(x0, known).cost)


class _Asked:
    """The objective of a peer: it counts, and ends the peer when its budget is spent.

    Attributes:
        meter: The counter.
        limits: Evaluations and seconds of the peer; None means no limit.
        answer: Function of a point that returns its answer.
        spent: The limit that has ended it.
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


ROUTES: Mapping[str, Callable[..., Found]] = {
    "search": _searched,
    "nlp": _searched,
    "multistart": _many_starts,
    "solve": _solved,
    "peer": _peered,
    "control": _controlled,
}
"""Family of a solver -> function that runs it: (built, trial, meter, rng) -> Found."""
