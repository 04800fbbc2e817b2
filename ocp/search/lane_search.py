"""Searches of one planning problem that use local solves in parallel lanes.

multistart  smooth random starts -> lanes -> distinct optima, batch after batch, until
            the budget is spent or hardly any optimum is left unseen (settings.py);
            the polish starts from the best optima
memetic     generations of L-SHADE; its best distinct members -> lanes -> back into the
            population (heuristics/running/memetic.py)

An iteration of a lane is charged as evaluations: the ratio of the instructions of its
machine code to those of a rollout. This ratio is fixed for a problem, so that the same
seed and budget give the same answer on a fast and on a slow machine. Derivatives of an
NLP solver are charged in the same way (watching.py).
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    Budget,
    SearchInterrupted,
    SearchResult,
    StopReason,
    minimize,
)
from swarmstart.heuristics.running import (
    Improved,
    Individual,
    LocalSolves,
    Search,
    locked,
    run_memetic,
)
from swarmstart.machine_code import stopwatch
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.lanes.posed import NoLanesError
from swarmstart.ocp.lanes.solver import LaneSolver
from swarmstart.ocp.nlp.polish import Polisher
from swarmstart.ocp.rollout.fitness import Fitness
from swarmstart.ocp.search.account import Lanes
from swarmstart.ocp.search.lane_starts import Members, PolishStarts, RandomStarts, Task
from swarmstart.ocp.search.search_space import (
    ControlSpace,
    SearchSpace,
    first_population,
)
from swarmstart.ocp.search.settings import (
    Memetic,
    Multistart,
    SearchSettings,
    population_of,
)

TOO_DEAR = "a local solve would cost more than its share of the budget"


class Searched(NamedTuple):
    """Result of a search, with the results of its lanes.

    Attributes:
        result: Result of the search.
        lanes: Results of the lanes; None without lanes.
        without: Reason why there were no lanes; empty if there were.
    """

    result: SearchResult
    lanes: Lanes | None = None
    without: str = ""


def searched(
    search: SearchSettings, space: SearchSpace, task: Task, lanes: "LaneSearch | None"
) -> Searched:
    """Run a search and return its result.

    Args:
        search: Settings of the search.
        space: The search space.
        task: The task to search for.
        lanes: The `LaneSearch` that runs the search; None: it is a population search.

    Raises:
        SearchInterrupted: On Ctrl-C, with the best point so far, if there is one.
    """
    if lanes is not None:
        return lanes(task)
    result = minimize(
        task.objective,
        space.box,
        algorithm=population_of(search.algorithm),
        budget=search.budget,
        order=task.order,
        initial=first_population(search, space, task.guess, task.first, task.x0),
        basins=task.basins,
        radius=search.radius,
        rng=task.rng,
        on_advance=task.tell,
        on_best=task.told_best,
    )
    return Searched(result)


class LaneSearch:
    """Search of one problem by local solves in lanes; built once."""

    def __init__(
        self,
        fitness: Fitness,
        space: SearchSpace,
        search: SearchSettings,
        polisher: Polisher | None,
    ) -> None:
        """Compile the functions of the lanes.

        Args:
            fitness: The problem's evaluator.
            space: The search space.
            search: The search: a multistart, or memetic.
            polisher: The NLP solver, for a multistart without lanes; None without one.

        Raises:
            InvalidProblemError: If neither lanes nor the NLP solver can run a
                multistart.
        """
        self._problem, self._space = fitness.problem, space
        self._search, self._polisher = search, polisher
        self._solver: LaneSolver | None = None
        self._without = ""
        try:
            if not isinstance(space, ControlSpace):
                raise NoLanesError("its search looks at members of a family")
            if isinstance(search.algorithm, Multistart) and not search.algorithm.lanes:
                raise NoLanesError("none are asked for")
            program = None if polisher is None else polisher.program
            self._solver = LaneSolver(fitness.shooting, program=program)
        except NoLanesError as error:
            self._without = str(error)
            if isinstance(search.algorithm, Multistart):
                self._require_solvable()

    def with_search(self, search: SearchSettings) -> "LaneSearch":
        """Return a copy with other settings of its algorithm; nothing is rebuilt."""
        other = copy(self)  # Shallow: both use the same compiled lanes.
        other._search = search
        return other

    @property
    def uses_lanes(self) -> bool:
        """True if its local solves are made in lanes."""
        return self._solver is not None

    def prepare(self) -> None:
        """Wait for machine code that is still being compiled."""
        if self._solver is not None:
            float(self._solver.rollouts_per_iteration)  # Reading it waits for the code.

    def _require_solvable(self) -> None:
        """Raise if nothing can solve the starts of a multistart."""
        reasons = {
            "it has whole numbers, which solve rounds": bool(self._problem.integer),
            f"{self._without}, and there is no polish": self._polisher is None,
        }
        for reason, is_so in reasons.items():
            if is_so:
                raise InvalidProblemError(
                    f"multistart cannot serve this problem: {reason}"
                )

    def __call__(self, task: Task) -> Searched:
        """Run the search.

        Raises:
            SearchInterrupted: On Ctrl-C, with the best point so far, if there is one.
        """
        settings = self._search.algorithm
        if isinstance(settings, Memetic):
            return self._memetic(settings, task)
        if not isinstance(settings, Multistart):
            raise TypeError("expected a multistart, or a memetic search")
        given = [*task.first]
        if task.guess is not None and self._search.warm_start != "none":
            given.append(task.guess)
        starts: RandomStarts | PolishStarts
        if self._solver is None:
            starts = PolishStarts(self._space, self._polisher, task, given)
        else:
            starts = RandomStarts(self._solver, self._space, settings, task, given)
        result = _until_spent(starts, self._search.budget, task)
        return Searched(result, starts.account(), self._without)

    def _memetic(self, settings: Memetic, task: Task) -> Searched:
        budget, solver = self._search.budget, self._solver
        lanes = None if solver is None else Members(solver, self._space, task)
        population = Search(
            settings.population(budget.evaluations),
            self._space.box,
            rng=task.rng,
            order=task.order,
            initial=first_population(
                self._search, self._space, task.guess, task.first, task.x0
            ),
            evaluations=budget.evaluations,
            # Members are chosen among the basins that were not improved yet.
            basins=max(task.basins, 2 * settings.members),
            radius=self._search.radius,
        )
        local = LocalSolves(
            improve=_as_they_are if lanes is None else lanes,
            each=1.0 if lanes is None else lanes.each,
            members=settings.members if lanes else 0,
            share=settings.share,
        )
        found = run_memetic(
            population,
            task.objective,
            local,
            budget=budget,
            on_advance=task.tell,
            on_best=task.told_best,
        )
        # More basins were kept for the choice of members than were asked for.
        result = replace(found, basins=found.basins[: task.basins])
        if lanes is None:
            return Searched(result, None, self._without)
        if not lanes.solves:
            return Searched(result, None, TOO_DEAR)  # No solve fitted into their share.
        return Searched(result, lanes.account())


def _best_of(starts: RandomStarts | PolishStarts) -> Individual:
    cost, violation = starts.best()
    return Individual(x=starts.points(1)[0], cost=cost, violation=violation)


def _as_they_are(members: Array) -> Improved:
    return Improved(members, 0)


def _until_spent(
    starts: RandomStarts | PolishStarts, budget: Budget, task: Task
) -> SearchResult:
    """Solve batch after batch; return the best optima as points of the space."""
    evaluations, still, stopped = 0, 0, None
    history: list[tuple[float, float, int]] = []
    target = -np.inf if budget.target is None else budget.target
    with stopwatch() as watch:

        def result(reason: StopReason) -> SearchResult:
            return _result(starts, task, history, reason, watch.seconds)

        try:
            while stopped is None:
                left = (budget.evaluations or np.inf) - evaluations
                # A whole number, also of an unlimited budget.
                most = int(min(left / starts.each, 2**31))
                before = starts.best()
                evaluations += starts.batch(max(most, 1))  # One start is always made.
                cost, violation = after = starts.best()
                still = 0 if after != before else still + 1
                history.append((cost, violation, evaluations))
                if task.tell is not None:
                    task.tell(evaluations)
                if task.told_best is not None:
                    task.told_best(evaluations, lambda: _best_of(starts))
                feasible = violation <= task.order.tolerance
                reasons = {
                    StopReason.TARGET: feasible and cost <= target,
                    StopReason.FOUND: starts.ended,
                    StopReason.EVALUATIONS: budget.evaluations is not None
                    and evaluations + starts.each > budget.evaluations,
                    StopReason.SECONDS: watch.seconds >= (budget.seconds or np.inf),
                    StopReason.STAGNATION: still >= (budget.stagnation or np.inf),
                }
                stopped = next((one for one, is_so in reasons.items() if is_so), None)
        except KeyboardInterrupt as interrupt:
            if not history:
                raise
            partial = result(StopReason.INTERRUPTED)
            raise SearchInterrupted(partial) from interrupt
        return result(stopped)


def _result(
    starts: RandomStarts | PolishStarts,
    task: Task,
    history: Sequence[tuple[float, float, int]],
    stopped: StopReason,
    seconds: float,
) -> SearchResult:
    """Return the result, with the values of the search's own evaluator."""
    points = starts.points(1 + task.basins)
    values = task.objective(np.ascontiguousarray(np.stack(points, axis=1)))
    found = [
        Individual(x=x, cost=float(cost), violation=float(violation))
        for x, cost, violation in zip(points, *values, strict=True)
    ]
    costs, violations, evaluations = zip(*history, strict=True)
    return SearchResult(
        x=locked(found[0].x),
        cost=found[0].cost,
        violation=found[0].violation,
        evaluations=evaluations[-1],
        generations=len(history),
        stopped=stopped,
        history_cost=locked(costs),
        history_violation=locked(violations),
        history_evaluations=np.array(evaluations, dtype=np.int64),
        nonfinite=int(not np.isfinite(found[0].cost)),
        basins=tuple(found[1:]),
        seconds=seconds,
        snapshot={},
    )
