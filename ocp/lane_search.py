"""Searches that use local solves in lanes, on one planning problem.

multistart  smooth random starts -> lanes -> distinct optima, batch after batch, until
            the budget is spent or hardly an optimum is unseen (lane_settings.py); the
            best optima are where the polish starts
memetic     generations of L-SHADE; its best distinct members -> lanes -> back into the
            population (heuristics/memetic.py)

An iteration of a lane counts as so many evaluations as its machine code has times as
many instructions as a rollout's: fixed for a problem, so that the same seed and budget
give the same answer on a quick and on a slow machine.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.compile_time import stopwatch
from swarmstart.heuristics import (
    Budget,
    Order,
    SearchInterrupted,
    SearchResult,
    StopReason,
    minimize,
)
from swarmstart.heuristics.interrupts import heeded
from swarmstart.heuristics.memetic import Improved, LocalSolves, run_memetic
from swarmstart.heuristics.result import locked
from swarmstart.heuristics.search import Individual, Search
from swarmstart.ocp.account import Lanes
from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.fitness import Fitness, Known, Objective, started
from swarmstart.ocp.lane_settings import Memetic, Multistart, population_of
from swarmstart.ocp.lanes.augmented import LaneAnswers
from swarmstart.ocp.lanes.optima import Optimum, distinct_optima, unseen_share
from swarmstart.ocp.lanes.solver import LaneSolver, NoLanesError, random_starts
from swarmstart.ocp.polish import Polisher, is_better
from swarmstart.ocp.search_settings import SearchSettings
from swarmstart.ocp.search_space import (
    ControlSpace,
    SearchSpace,
    first_population,
)

Array = NDArray[np.float64]
Told = Callable[[int], None] | None

FIRST_ITERATIONS = 150
"""Iterations that a lane is expected to take before any has been solved: many, so that
a small budget is not overdrawn by the first batch."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Task:
    """One search.

    Attributes:
        x0: Initial state of the core, shape (nx,).
        known: Parameters and signals.
        objective: Population -> cost and violation.
        order: How individuals are ordered.
        guess: Controls to start from, shape (nu, N); None: none is known.
        first: Controls to look at besides, each (nu, N).
        basins: Number of basins that are wanted besides the best point.
        rng: Source of all randomness.
        tell: Told the evaluations so far.
    """

    x0: ArrayLike
    known: Known
    objective: Objective
    order: Order
    guess: Array | None
    first: Sequence[Array]
    basins: int
    rng: np.random.Generator
    tell: Told


class Searched(NamedTuple):
    """What a search found, and how lanes served it.

    Attributes:
        result: What it found.
        lanes: What the lanes found; None: there were none.
        without: Why there were none.
    """

    result: SearchResult
    lanes: Lanes | None = None
    without: str = ""


def searched(
    search: SearchSettings, space: SearchSpace, task: Task, lanes: "LaneSearch | None"
) -> Searched:
    """Return what a search finds.

    Args:
        search: Its settings.
        space: What is searched.
        task: What it searches for.
        lanes: What runs it; None: it is a population search.

    Raises:
        SearchInterrupted: On Ctrl-C, with the best so far, if there is any.
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
    )
    return Searched(result)


class LaneSearch:
    """A search of one problem that uses local solves in lanes; built once."""

    def __init__(
        self,
        fitness: Fitness,
        space: SearchSpace,
        search: SearchSettings,
        polisher: Polisher | None,
    ) -> None:
        """Compile what lanes compute.

        Args:
            fitness: The problem's evaluator.
            space: What is searched.
            search: The search: a multistart, or memetic.
            polisher: The NLP solver, for a multistart without lanes; None: none.

        Raises:
            InvalidProblemError: If a multistart can have neither lanes nor the NLP
                solver.
        """
        self._problem, self._space = fitness.problem, space
        self._search, self._polisher = search, polisher
        self._solver: LaneSolver | None = None
        self._without = ""
        try:
            if not isinstance(space, ControlSpace):
                raise NoLanesError("its search looks for members of a family")
            self._solver = LaneSolver(fitness.shooting)
        except NoLanesError as error:
            self._without = str(error)
            if isinstance(search.algorithm, Multistart):
                self._require_solvable()

    def _require_solvable(self) -> None:
        """Refuse a multistart that nothing can solve."""
        reasons = {
            self._without: not isinstance(self._space, ControlSpace),
            "it has whole numbers, which solve rounds": bool(self._problem.integer),
            f"{self._without}, and there is no polish": self._polisher is None,
        }
        for reason, is_so in reasons.items():
            if is_so:
                raise InvalidProblemError(
                    f"multistart cannot serve this problem: {reason}"
                )

    def __call__(self, task: Task) -> Searched:
        """Search.

        Raises:
            SearchInterrupted: On Ctrl-C, with the best so far, if there is any.
        """
        settings = self._search.algorithm
        if isinstance(settings, Memetic):
            return self._memetic(settings, task)
        if not isinstance(settings, Multistart):
            raise TypeError("expected a multistart, or a memetic search")
        given = [*task.first]
        if task.guess is not None and self._search.warm_start != "none":
            given.append(task.guess)
        starts: _InLanes | _ByPolish
        if self._solver is None:
            starts = _ByPolish(self._space, self._polisher, task, given)
        else:
            starts = _InLanes(self._solver, self._space, settings, task, given)
        result = _until_spent(starts, self._search.budget, task)
        return Searched(result, starts.account(), self._without)

    def _memetic(self, settings: Memetic, task: Task) -> Searched:
        budget, solver = self._search.budget, self._solver
        lanes = None if solver is None else _Members(solver, self._space, task)
        population = Search(
            settings.population(budget.evaluations),
            self._space.box,
            rng=task.rng,
            order=task.order,
            initial=first_population(
                self._search, self._space, task.guess, task.first, task.x0
            ),
            evaluations=budget.evaluations,
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
            population, task.objective, local, budget=budget, on_advance=task.tell
        )
        result = replace(found, basins=found.basins[: task.basins])
        account = lanes.account() if lanes and lanes.solves else None
        return Searched(result, account, self._without)


def _as_they_are(members: Array) -> Improved:
    return Improved(members, 0)


class _Found:
    """Distinct optima of lanes so far, of each the best answer."""

    def __init__(self, solver: LaneSolver) -> None:
        self.solver, self.solves, self.iterations = solver, 0, 0
        self.kept: LaneAnswers | None = None
        self.optima: list[Optimum] = []

    @property
    def each(self) -> float:
        """What a solve costs on average, in evaluations."""
        iterations = FIRST_ITERATIONS
        if self.solves:
            iterations = max(self.iterations / self.solves, 1)  # type: ignore[assignment]
        return iterations * self.solver.rollouts_per_iteration

    def add(self, answers: LaneAnswers) -> int:
        """Take in answers; return what they cost, in evaluations."""
        before = np.array([one.count for one in self.optima], dtype=np.int64)
        every = answers if self.kept is None else _joined(self.kept, answers)
        ones = np.ones(answers.cost.size, dtype=np.int64)
        self.optima = distinct_optima(every, stand_for=np.concatenate([before, ones]))
        lanes = [one.lane for one in self.optima]
        self.kept = _some(every, lanes)
        self.optima = [replace(one, lane=i) for i, one in enumerate(self.optima)]
        self.solves += answers.cost.size
        taken = int(answers.iterations.sum())
        self.iterations += taken
        return max(round(taken * self.solver.rollouts_per_iteration), 1)

    def account(self, *, random: bool) -> Lanes:
        """Return what was found.

        Args:
            random: Whether the starts were a random sample, which speaks of others.
        """
        counts = [one.count for one in self.optima]
        return Lanes(
            starts=self.solves,
            method=self.solver.method,
            optima=tuple(self.optima),
            unseen=unseen_share(counts) if random else None,
        )


def _joined(one: LaneAnswers, other: LaneAnswers) -> LaneAnswers:
    names = ("controls", "starts", "states", "cost", "violation", "iterations")
    return LaneAnswers(**{
        name: np.concatenate([getattr(one, name), getattr(other, name)], axis=-1)
        for name in names
    })  # fmt: skip


def _some(answers: LaneAnswers, lanes: Sequence[int]) -> LaneAnswers:
    names = ("controls", "starts", "states", "cost", "violation", "iterations")
    return LaneAnswers(**{
        name: np.ascontiguousarray(getattr(answers, name)[..., lanes])
        for name in names
    })  # fmt: skip


class _Lanes:
    """Local solves of one task, and points of the space that their answers are."""

    def __init__(self, solver: LaneSolver, space: SearchSpace, task: Task) -> None:
        self.found, self._space, self._task = _Found(solver), space, task
        self._state = np.asarray(task.x0, dtype=np.float64).ravel()
        firsts = solver.problem.free_starts
        self.firsts = [one.states[0] for one in firsts]

    def solve(self, controls: Array, decided: Array) -> tuple[LaneAnswers, int]:
        """Solve; return the answers and what they cost, in evaluations."""
        task = self._task
        with heeded(), np.errstate(all="ignore"):
            answers = self.found.solver(
                self._state, controls, decided, known=task.known, rng=task.rng
            )
        return answers, self.found.add(answers)

    def point(self, answers: LaneAnswers, lane: int) -> Array:
        """Return the point of the space that an answer is."""
        decided = answers.starts[:, lane]
        start = started(self.found.solver.problem, self._state, decided)
        return self._space.encoded(answers.controls[:, :, lane], start)


class _Members(_Lanes):
    """Members of a population, improved in lanes."""

    @property
    def each(self) -> float:
        """What a solve costs, in evaluations."""
        return self.found.each

    @property
    def solves(self) -> int:
        """Number of local solves so far."""
        return self.found.solves

    def account(self) -> Lanes:
        """Return what was found."""
        return self.found.account(random=False)

    def __call__(self, members: Array) -> Improved:
        """Return the distinct optima that members lead to."""
        task = self._task
        starts = [self._space.decoded(x, self._state, task.known) for x in members.T]
        controls = np.stack([one.controls for one in starts], axis=2)
        own = [(self._state if one.x0 is None else one.x0)[self.firsts]
               for one in starts]  # fmt: skip
        answers, evaluations = self.solve(controls, np.array(own).T)
        lanes = [one.lane for one in distinct_optima(answers)]
        points = [self.point(answers, lane) for lane in lanes]
        none = np.empty((members.shape[0], 0))
        return Improved(np.stack(points, axis=1) if points else none, evaluations)


class _InLanes(_Lanes):
    """Batches of random starts, solved in lanes."""

    def __init__(
        self,
        solver: LaneSolver,
        space: SearchSpace,
        settings: Multistart,
        task: Task,
        given: Sequence[Array],
    ) -> None:
        super().__init__(solver, space, task)
        self._settings, self._given = settings, given
        self._limits = solver.problem.search_limits
        self._lost: tuple[float, float, Array] | None = None

    @property
    def each(self) -> float:
        """What a start costs, in evaluations."""
        return self.found.each

    def account(self) -> Lanes:
        """Return what was found."""
        return self.found.account(random=True)

    @property
    def ended(self) -> bool:
        """Whether hardly an optimum is left unseen."""
        counts = [one.count for one in self.found.optima]
        return unseen_share(counts).most < self._settings.unseen

    def batch(self, most: int) -> int:
        """Solve up to so many starts; return what they cost, in evaluations."""
        task, problem = self._task, self.found.solver.problem
        given = () if self.found.solves else self._given[:most]
        count = min(self._settings.size, most) - len(given)
        controls, decided = random_starts(
            problem, max(count, 0), task.rng, limits=self._limits
        )
        if given:
            own = np.repeat(self._state[self.firsts][:, None], len(given), axis=1)
            controls = np.dstack([*given, controls])
            decided = np.hstack([own, decided])
        answers, evaluations = self.solve(controls, decided)
        order = np.lexsort((answers.cost, answers.violation))
        best = int(order[0])
        value = float(answers.violation[best]), float(answers.cost[best])
        if self._lost is None or value < self._lost[:2]:
            self._lost = (*value, self.point(answers, best))
        return evaluations

    def best(self) -> tuple[float, float]:
        """Return cost and violation of the best answer."""
        if self.found.optima:
            return self.found.optima[0].cost, 0.0
        return (np.inf, np.inf) if self._lost is None else self._lost[1::-1]

    def points(self, most: int) -> list[Array]:
        """Return the best answers' points, the best first: at least one."""
        kept = self.found.kept
        if kept is not None and self.found.optima:
            count = min(most, len(self.found.optima))
            return [self.point(kept, lane) for lane in range(count)]
        return [] if self._lost is None else [self._lost[2]]


class _ByPolish:
    """The NLP solver from random points, one after the other."""

    def __init__(
        self,
        space: SearchSpace,
        polisher: Polisher | None,
        task: Task,
        given: Sequence[Array],
    ) -> None:
        if polisher is None:
            raise TypeError("expected an NLP solver")
        self._space, self._polisher, self._task = space, polisher, task
        self._given = given
        self._best: tuple[float, float, Array] | None = None
        self._solves = self._evaluations = 0
        self.ended = False

    @property
    def each(self) -> float:
        """What a start costs, in evaluations; at first no more than one."""
        return max(self._evaluations / self._solves, 1.0) if self._solves else 1.0

    def account(self) -> None:
        """Return None: there were no lanes."""
        return

    def batch(self, most: int) -> int:
        """Solve from one start; return what that cost, in evaluations."""
        del most
        task, box = self._task, self._space.box
        if self._solves < len(self._given):
            x = self._space.encoded(self._given[self._solves], task.x0)
        else:
            x = box.lower + box.width * task.rng.random(box.dim)
        start = self._space.decoded(x, task.x0, task.known)
        at = task.x0 if start.x0 is None else start.x0
        with heeded():
            one = self._polisher(start.controls, at, task.known, states=start.states)
        self._solves += 1
        self._evaluations += max(one.evaluations, 1)
        tolerance = task.order.tolerance
        value = one.cost, one.violation
        if self._best is None or is_better(value, self._best[:2], tolerance=tolerance):
            self._best = (*value, self._space.encoded(one.controls, one.x0))
        return max(one.evaluations, 1)

    def best(self) -> tuple[float, float]:
        """Return cost and violation of the best answer."""
        return (np.inf, np.inf) if self._best is None else self._best[:2]

    def points(self, most: int) -> list[Array]:
        """Return the best answer's point."""
        del most
        return [] if self._best is None else [self._best[2]]


def _until_spent(
    starts: _InLanes | _ByPolish, budget: Budget, task: Task
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
                most = int(min(left / starts.each, 2**31))
                before = starts.best()
                evaluations += starts.batch(max(most, 1))
                cost, violation = after = starts.best()
                still = 0 if after != before else still + 1
                history.append((cost, violation, evaluations))
                if task.tell is not None:
                    task.tell(evaluations)
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
    starts: _InLanes | _ByPolish,
    task: Task,
    history: Sequence[tuple[float, float, int]],
    stopped: StopReason,
    seconds: float,
) -> SearchResult:
    """Return what was found, with the values of the search's own evaluator."""
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
