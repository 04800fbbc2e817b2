"""History of a solver: its best answer over its work, and its stop at the budget.

A meter watches the solver (`ocp.nlp.Watch`). It counts the work so far in evaluations
of one rollout, the time without compiling, and whether a budget is spent. It keeps the
best answer so far: feasible before infeasible, then by cost, both at the checks of the
problem.

The history has the best answer at log-spaced marks of the evaluations, PER_DECADE to a
decade, and at the end. It is exact after each generation of a search or a peer, each
batch of starts that are solved at once (lanes) and each start of a multistart. Of an
NLP solver's iterates only those at marks are evaluated, which costs hardly any time.
Times between two reports of a search are interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.campaign.trials.result import finite
from swarmstart.heuristics import SearchResult
from swarmstart.heuristics.running import Individual, StopReason
from swarmstart.machine_code import Stopwatch
from swarmstart.ocp.nlp import Answer, Ratios, Value, Work, is_better

PER_DECADE = 10
CHECKPOINT_S = 0.25
"""Shortest time between two checkpoints; the first is written at once [s]."""
WORST: Value = (math.inf, math.inf)


class Entry(NamedTuple):
    """The best answer so far.

    Attributes:
        evaluations: Number of evaluations until this answer.
        seconds: Time until this answer [s].
        cost: Cost of the best answer.
        violation: Violation of the best answer.
    """

    evaluations: float
    seconds: float
    cost: float
    violation: float


class Meter:
    """Counter of one trial's work, which keeps the best answer and ends the trial.

    Attributes:
        work: Numbers of rollouts, gradients and Hessians that NLP solvers asked for.
        ratios: Costs of derivatives, in rollouts; those of the last NLP if there are
            several.
        stopped: The limit that stopped the solver: "evaluations" or "seconds"; empty if
            none did.
        best: The best answer so far; None if there is none, or it is not known.
        value: Its cost and violation.
    """

    def __init__(
        self,
        watch: Stopwatch,
        *,
        value_of: Callable[[Array, Array], Value],
        tolerance: float,
        evaluations: int | None = None,
        seconds: float | None = None,
        kept: Callable[[Meter], None] | None = None,
    ) -> None:
        """Start counting.

        Args:
            watch: The solver's clock.
            value_of: Controls and initial state -> cost and violation at the checks.
            tolerance: Largest violation of a feasible answer.
            evaluations: Budget of evaluations; None means no limit.
            seconds: Budget of time [s]; None means no limit.
            kept: Function that writes a checkpoint; None means no checkpoints.
        """
        self._watch, self._value_of, self._tolerance = watch, value_of, tolerance
        self._limits = evaluations, seconds
        self._kept, self._next_kept, self._is_kept = kept, 0.0, True
        self.work, self.ratios = Work(), Ratios(0.0, 0.0)
        self._spent = 0.0
        self._search: float | None = None
        self.stopped, self.ended = "", ""
        self.best: Answer | None = None
        self.value: Value = WORST
        self._entries: list[Entry] = []
        self._partial: Entry | None = None
        self._clock: list[tuple[float, float]] = []
        self._mark = -1

    @property
    def seconds(self) -> float:
        """Time of the solver's clock [s]."""
        return self._watch.seconds

    @property
    def evaluations(self) -> float:
        """Work so far, in rollouts."""
        return self._spent

    @property
    def is_over(self) -> bool:
        """True if a budget is spent."""
        return bool(self.stopped) or self._is_spent(self._spent)

    def _is_spent(self, evaluations: float) -> bool:
        most, seconds = self._limits
        if most is not None and evaluations >= most:
            self.stopped = self.stopped or "evaluations"
        elif seconds is not None and self.seconds >= seconds:
            self.stopped = self.stopped or "seconds"
        return bool(self.stopped)

    @contextmanager
    def searching(self) -> Iterator[None]:
        """Context of a search, in which only the work that the search reports counts.

        Reports of NLP solvers that the search calls are not counted.
        """
        self._search = self._spent
        self._clock = [(self._spent, self.seconds)]
        try:
            yield
        finally:
            self._search = None

    def advanced(
        self,
        evaluations: int,
        best: Callable[[], Individual],
        answer: Callable[[Array], Answer],
    ) -> None:
        """Record the time at which a search has done so many evaluations.

        A checkpoint is written if one is due and the best point is a new one.
        """
        begun = self._search or 0.0
        self._clock.append((begun + evaluations, self.seconds))
        if self._kept is None or self.seconds < self._next_kept:
            return
        found = best()
        if self._is_new((found.cost, found.violation)):
            self.best, self._is_kept = answer(found.x), False
            self.value = found.cost, found.violation
            self._keep(begun + evaluations)

    def searched(self, result: SearchResult) -> None:
        """Add the history of a search."""
        begun = self._search or 0.0
        evaluations = begun + np.asarray(result.history_evaluations, dtype=np.float64)
        if self._clock:
            # The history of a search has no times; its reports have.
            told = np.array(self._clock)
            seconds = np.interp(evaluations, told[:, 0], told[:, 1])
        else:
            seconds = np.full(evaluations.shape, self.seconds)
        values = zip(
            evaluations.tolist(),
            seconds.tolist(),
            result.history_cost.tolist(),
            result.history_violation.tolist(),
            strict=True,
        )
        self._entries += _changes(values)
        self._spent = begun + result.evaluations
        self.ended = _ENDS.get(result.stopped, "itself")

    def counted(self, evaluations: float) -> None:
        """Add work, in evaluations of one rollout, unless a search is running.

        A search counts its own evaluations, which are added at its end.
        """
        if self._search is None:
            self._spent += evaluations

    def iterated(self, evaluations: float, answer: Callable[[], Answer] | None) -> bool:
        """Evaluate an iterate if the work has reached a mark of the history.

        Returns:
            Whether to continue: False if a budget is spent.
        """
        spent = self._spent + (0.0 if self._search is not None else evaluations)
        mark = math.floor(PER_DECADE * math.log10(max(spent, 1.0)))
        self._keep(spent)
        if answer is not None and mark > self._mark and self._search is None:
            self._mark = mark
            found = answer()
            # Iterates of a solver that fails can be NaN.
            if all(np.isfinite(part).all() for part in found):
                self._noted(spent, found, self._value_of(*found))
        return not self._is_spent(spent)

    def solved(self, work: Work, ratios: Ratios) -> None:
        """Count a finished solve of an NLP solver."""
        self.work, self.ratios = self.work + work, ratios
        self.counted(work.evaluations(ratios))
        spent = self._spent  # Until now it was estimated.
        for place in range(len(self._entries) - 1, -1, -1):
            one = self._entries[place]
            if one.evaluations <= spent:
                break
            self._entries[place] = one._replace(evaluations=spent)

    def answered(self, answer: Answer, cost: float, violation: float) -> None:
        """Add an answer to the history."""
        self._noted(self._spent, answer, (cost, violation))

    def evaluated(
        self,
        population: Array,
        values: tuple[Array, Array],
        answer: Callable[[Array], Answer],
    ) -> None:
        """Add points that a search of another package (a peer) has evaluated.

        Args:
            population: The points, shape (dim, size).
            values: Cost and violation, each (size,).
            answer: Function of a point that returns its answer.
        """
        self._spent += population.shape[1]
        cost, violation = values
        self._keep(self._spent)
        broken = np.where(violation > self._tolerance, violation, 0.0)
        finite = np.isfinite(cost) & np.isfinite(violation)
        broken = np.where(finite, broken, np.inf)
        # The last key counts first: violation, then cost.
        best = int(np.lexsort((cost, broken))[0])
        value = float(cost[best]), float(violation[best])
        if self._is_new(value):
            self._noted(self._spent, answer(population[:, best]), value)

    def _is_new(self, value: Value) -> bool:
        return is_better(value, self.value, tolerance=self._tolerance)

    def _noted(self, spent: float, answer: Answer, value: Value) -> None:
        if self._search is not None:  # The search has a history of its own.
            return
        self._entries.append(Entry(spent, self.seconds, *value))
        if self._is_new(value):
            self.best, self.value, self._is_kept = answer, value, False
            self._keep(spent)

    def _keep(self, spent: float) -> None:
        """Write a checkpoint, if one is due and the best answer is new."""
        if self._kept is None or self._is_kept or self.seconds < self._next_kept:
            return
        if self._search is not None:  # Else the checkpoint has it already.
            self._partial = Entry(spent, self.seconds, *self.value)
        self._kept(self)
        self._is_kept, self._next_kept = True, self.seconds + CHECKPOINT_S

    def history(
        self, final: Value | None = None, *, seconds: float | None = None
    ) -> dict[str, list[Any]]:
        """Return the best answer so far at log-spaced marks and at the end.

        Args:
            seconds: End of the trial [s]; None means now.
            final: Cost and violation of the solver's answer; None means those of the
                best answer so far. If an earlier point was better than the solver's
                answer, the history has the cost and violation of the answer in its
                place, since the solver did not return that point.
        """
        best, improved = WORST, []
        if seconds is None:
            seconds = self.seconds
        partial = [self._partial] if self._search is not None and self._partial else []
        entries = sorted([*self._entries, *partial], key=lambda one: one.evaluations)
        for one in entries:
            value = one.cost, one.violation
            if is_better(value, best, tolerance=self._tolerance):
                # It counts like the answer, which the solver gave instead.
                if final is not None and is_better(
                    value, final, tolerance=self._tolerance
                ):
                    value = final
                if value != best:
                    best = value
                    improved.append(Entry(one.evaluations, one.seconds, *value))
        last = improved[-1] if improved else None
        end = (last.cost, last.violation) if last and final is None else final or WORST
        evaluations = [one.evaluations for one in entries]
        total = max([self._spent, *evaluations])
        told = [*_at_marks(improved, total), Entry(total, seconds, *end)]
        return {
            "evaluations": [round(one.evaluations) for one in told],
            "seconds": [one.seconds for one in told],
            "cost": [finite(one.cost) for one in told],
            "violation": [finite(one.violation) for one in told],
        }


_ENDS = {StopReason.EVALUATIONS: "evaluations", StopReason.SECONDS: "seconds"}


def _changes(values: Iterator[tuple[float, float, float, float]]) -> list[Entry]:
    """Return the entries at which cost or violation changes."""
    entries, last = [], None
    for one in values:
        if one[2:] != last:
            entries.append(Entry(*one))
            last = one[2:]
    return entries


def _at_marks(improved: Sequence[Entry], total: float) -> list[Entry]:
    """Return the best entry so far at each mark below the end, from the first on."""
    told: list[Entry] = []
    if not improved:
        return told
    first = math.ceil(PER_DECADE * math.log10(max(improved[0].evaluations, 1.0)))
    last = math.floor(PER_DECADE * math.log10(max(total, 1.0)))
    place = 0
    for number in range(first, last + 1):
        # Powers that are whole can be above it by round-off.
        mark = math.ceil(10 ** (number / PER_DECADE) - 1e-9)
        if mark >= total or (told and mark <= told[-1].evaluations):
            continue
        while place + 1 < len(improved) and improved[place + 1].evaluations <= mark:
            place += 1
        at = improved[place]
        told.append(Entry(mark, at.seconds, at.cost, at.violation))
    return told


class BudgetSpent(Exception):  # noqa: N818 - no error
    """The budget is spent; raised inside a solver of another package or of a user."""


class CountedObjective:
    """An objective that counts calls for a meter, and raises when the budget is spent.

    Attributes:
        spent: The limit that is reached, "evaluations" or "seconds"; empty before.
    """

    def __init__(
        self,
        objective: Callable[[Array], tuple[Array, Array]],
        meter: Meter,
        limits: tuple[int | None, float | None],
        answer: Callable[[Array], Answer],
    ) -> None:
        """Count from now on.

        Args:
            objective: Population (dim, size) -> cost and violation, each (size,).
            meter: The counter, which keeps the best point.
            limits: Evaluations and seconds; None means no limit.
            answer: Function of a point that returns its answer.
        """
        self._objective, self._meter, self._answer = objective, meter, answer
        self._most, self._seconds = limits
        self.spent = ""

    def __call__(self, population: Array) -> tuple[Array, Array]:
        """Return cost and violation of each point, shape (size,).

        Raises:
            BudgetSpent: If the budget was spent by an earlier call, or is spent by this
                one. The points of this call are evaluated and counted first, as far as
                the budget allows.
        """
        if self.spent:  # The caller has gone on.
            raise BudgetSpent
        meter, size = self._meter, population.shape[1]
        if self._most is not None:
            # The last generation is cut where the budget ends.
            size = min(size, self._most - round(meter.evaluations))
        # Evaluators take contiguous arrays only.
        points = np.ascontiguousarray(population[:, :size], dtype=np.float64)
        values = self._objective(points)
        meter.evaluated(points, values, self._answer)
        if self._most is not None and meter.evaluations >= self._most:
            self.spent = "evaluations"
        elif self._seconds is not None and meter.seconds >= self._seconds:
            self.spent = "seconds"
        if self.spent:
            raise BudgetSpent
        return values
