"""Local solves of one search: their starts, and the optima found so far.

Members      members of a population, which are improved
RandomStarts batches of smooth random starts, in lanes
PolishStarts random points, one after the other, by the NLP solver
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.heuristics import Order
from swarmstart.heuristics.running import Improved, Individual, heeded
from swarmstart.machine_code import stopwatch
from swarmstart.ocp.lanes.answers import (
    LaneAnswers,
    Optimum,
    distinct_optima,
    joined,
    some_of,
    unreached,
    unseen_share,
)
from swarmstart.ocp.lanes.solver import LaneSolver, random_starts
from swarmstart.ocp.nlp.polish import Polisher, is_better
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.rollout.fitness import Known, Objective, started
from swarmstart.ocp.search.account import Lanes
from swarmstart.ocp.search.search_space import ControlSpace, SearchSpace, side_by_side
from swarmstart.ocp.search.settings import Multistart

Told = Callable[[int], None] | None
ToldBest = Callable[[int, Callable[[], Individual]], None] | None

FIRST_ITERATIONS = 60
"""Assumed number of iterations of a lane before the first solve: large, so that the
first batch does not exceed a small budget."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Task:
    """Task of one search.

    Attributes:
        x0: Initial state of the rewritten problem (core), shape (nx,).
        known: Values of the parameters and signals.
        objective: Population -> cost and violation.
        order: Order of individuals.
        guess: Controls to start from, shape (nu, N); None without a guess.
        first: Further controls to evaluate, each (nu, N).
        basins: Number of basins wanted in addition to the best point.
        rng: Source of all randomness.
        tell: Called with the evaluations so far.
        told_best: Called with the evaluations so far and a function that returns the
            best point so far.
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
    told_best: ToldBest = None


class _Found:
    """Distinct optima found in lanes so far, with the best answer of each."""

    def __init__(self, solver: LaneSolver) -> None:
        self.solver, self.solves, self.iterations = solver, 0, 0
        self.seconds, self.infeasible, self.lost = 0.0, 0, 0
        self.kept: LaneAnswers | None = None
        self.optima: list[Optimum] = []

    @property
    def each(self) -> float:
        """Mean cost of a solve, in evaluations."""
        solves, done = self.solves, self.iterations
        iterations = max(done / solves, 1.0) if solves else FIRST_ITERATIONS
        return iterations * self.solver.rollouts_per_iteration

    def add(self, answers: LaneAnswers) -> int:
        """Add answers; return their cost, in evaluations."""
        before = np.array([one.count for one in self.optima], dtype=np.int64)
        every = answers if self.kept is None else joined([self.kept, answers])
        ones = np.ones(answers.cost.size, dtype=np.int64)
        # An optimum from earlier batches stands for all lanes that ended in it.
        self.optima = distinct_optima(every, stand_for=np.concatenate([before, ones]))
        lanes = [one.lane for one in self.optima]
        self.kept = some_of(every, lanes)
        self.optima = [replace(one, lane=i) for i, one in enumerate(self.optima)]
        infeasible, lost = unreached(answers)
        self.infeasible += infeasible
        self.lost += lost
        self.solves += answers.cost.size
        taken = int(answers.iterations.sum())
        self.iterations += taken
        return max(round(taken * self.solver.rollouts_per_iteration), 1)

    def account(self, x0: ArrayLike, known: Known, *, random: bool) -> Lanes:
        """Return the results of the lanes.

        Args:
            x0: Initial state of the rewritten problem (core), shape (nx,).
            known: Values of the parameters and signals.
            random: Whether the starts were a random sample, which allows an estimate.
        """
        ends, optima = [one.count for one in self.optima], tuple[Optimum, ...]()
        if self.kept is not None and ends:
            optima = self.solver.optima(
                self.kept, x0, known, stand_for=np.array(ends, dtype=np.int64)
            )
        counts = [one.count for one in optima]
        return Lanes(
            starts=self.solves,
            optima=optima,
            unseen=unseen_share(counts) if random else None,
            iterations=self.iterations,
            seconds=self.seconds,
            infeasible=self.infeasible,
            unfinished=sum(ends) - sum(counts),
            lost=self.lost,
        )


class _Lanes:
    """Local solves of one task, with the points of the space for their answers."""

    def __init__(self, solver: LaneSolver, space: SearchSpace, task: Task) -> None:
        self.found, self._space, self._task = _Found(solver), space, task
        self._state = np.asarray(task.x0, dtype=np.float64).ravel()

    def solve(self, controls: Array, decided: Array) -> tuple[LaneAnswers, int]:
        """Solve in lanes; return the answers and their cost, in evaluations."""
        task = self._task
        # Lanes that diverge overflow; they end as failed ones.
        with stopwatch() as watch, heeded(), np.errstate(all="ignore"):
            answers = self.found.solver(
                self._state, controls, decided, known=task.known
            )
            self.found.seconds += watch.seconds
        return answers, self.found.add(answers)

    def point(self, answers: LaneAnswers, lane: int) -> Array:
        """Return the point of the search space that stands for the answer of a lane."""
        decided = answers.starts[:, lane]
        start = started(self.found.solver.problem, self._state, decided)
        return self._space.encoded(answers.controls[:, :, lane], start)


class Members(_Lanes):
    """Members of a population, improved in lanes."""

    @property
    def each(self) -> float:
        """Mean cost of a solve, in evaluations."""
        return self.found.each

    @property
    def solves(self) -> int:
        """Number of local solves so far."""
        return self.found.solves

    def account(self) -> Lanes:
        """Return the results of the lanes."""
        return self.found.account(self._state, self._task.known, random=False)

    def __call__(self, members: Array) -> Improved:
        """Return the distinct optima reached from members."""
        task = self._task
        starts = [self._space.decoded(x, self._state, task.known) for x in members.T]
        problem = self.found.solver.problem
        answers, evaluations = self.solve(*side_by_side(problem, starts, self._state))
        lanes = [one.lane for one in distinct_optima(answers)]
        points = [self.point(answers, lane) for lane in lanes]
        none = np.empty((members.shape[0], 0))
        return Improved(np.stack(points, axis=1) if points else none, evaluations)


class RandomStarts(_Lanes):
    """Batches of random starts, solved in lanes."""

    def __init__(
        self,
        solver: LaneSolver,
        space: SearchSpace,
        settings: Multistart,
        task: Task,
        given: Sequence[Array],
    ) -> None:
        """Set up the starts; see `LaneSearch`."""
        super().__init__(solver, space, task)
        self._settings, self._given = settings, given
        self._limits = solver.problem.search_limits
        # The best (violation, cost, point), in case no lane ends in an optimum.
        self._lost: tuple[float, float, Array] | None = None

    @property
    def each(self) -> float:
        """Mean cost of a start, in evaluations."""
        return self.found.each

    def account(self) -> Lanes:
        """Return the results of the lanes."""
        return self.found.account(self._state, self._task.known, random=True)

    @property
    def ended(self) -> bool:
        """True if few further starts would end in an optimum not seen yet.

        Their estimated share must be below the limit with 95 % confidence.
        """
        counts = [one.count for one in self.found.optima]
        return unseen_share(counts).most < self._settings.unseen

    def batch(self, most: int) -> int:
        """Solve at most `most` starts; return their cost, in evaluations."""
        task, problem = self._task, self.found.solver.problem
        # In the first batch only.
        given = () if self.found.solves else self._given[:most]
        count = min(self._settings.size, most) - len(given)
        controls, decided = random_starts(
            problem, max(count, 0), task.rng, limits=self._limits
        )
        if given:
            first = side_by_side(problem, [Start(one) for one in given], self._state)
            controls = np.dstack([first[0], controls])
            decided = np.hstack([first[1], decided])
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
            return self.found.optima[0].cost, 0.0  # Optima are feasible.
        # Cost and violation, which are stored the other way round.
        return (np.inf, np.inf) if self._lost is None else self._lost[1::-1]

    def points(self, most: int) -> list[Array]:
        """Return the points of the best answers, the best first.

        After a batch there is at least one point: if no lane ended in an optimum, it is
        that of the best lane.
        """
        kept = self.found.kept
        if kept is not None and self.found.optima:
            count = min(most, len(self.found.optima))
            return [self.point(kept, lane) for lane in range(count)]
        return [] if self._lost is None else [self._lost[2]]


class PolishStarts:
    """NLP solver from random points, one after another.

    If the search space is a family of trajectories, an answer need not be a member of
    it. In this case the start that led to the best answer is kept instead; from this
    start the planner's own polish reaches the same answer.
    """

    def __init__(
        self,
        space: SearchSpace,
        polisher: Polisher | None,
        task: Task,
        given: Sequence[Array],
    ) -> None:
        """Start from the guess, if controls are searched."""
        if polisher is None:
            raise TypeError("expected an NLP solver")
        self._space, self._polisher, self._task = space, polisher, task
        self._given = given if isinstance(space, ControlSpace) else ()
        self._is_encodable = isinstance(space, ControlSpace)
        self._best: tuple[float, float, Array] | None = None
        self._solves = self._evaluations = 0

    @property
    def ended(self) -> bool:
        """True if a watch says that the budget is spent."""
        return self._polisher.watch.is_over

    @property
    def each(self) -> float:
        """Mean cost of a start, in evaluations; 1 before the first start."""
        return max(self._evaluations / self._solves, 1.0) if self._solves else 1.0

    def account(self) -> None:
        """Return None: there are no lanes."""
        return

    def batch(self, most: int) -> int:
        """Solve from one start; return its cost in evaluations, that is, rollouts."""
        del most
        task, box = self._task, self._space.box
        if self._solves < len(self._given):
            x = self._space.encoded(self._given[self._solves], task.x0)
        else:
            x = box.lower + box.width * task.rng.random(box.dim)
        start = self._space.decoded(x, task.x0, task.known)
        at = task.x0 if start.x0 is None else start.x0
        with heeded():
            one = self._polisher(
                start.controls,
                at,
                task.known,
                states=start.states,
                near=not self._is_encodable,
            )
        self._solves += 1
        spent = max(round(one.rollouts), 1)
        self._evaluations += spent
        tolerance = task.order.tolerance
        value = one.cost, one.violation
        if self._best is None or is_better(value, self._best[:2], tolerance=tolerance):
            if self._is_encodable:
                x = self._space.encoded(one.controls, one.x0)
            self._best = (*value, x)
        return spent

    def best(self) -> tuple[float, float]:
        """Return cost and violation of the best answer."""
        return (np.inf, np.inf) if self._best is None else self._best[:2]

    def points(self, most: int) -> list[Array]:
        """Return the best answer's point in a list, empty before the first solve."""
        del most
        return [] if self._best is None else [self._best[2]]
