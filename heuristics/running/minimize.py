"""The loop of a search: ask, evaluate, tell, until the budget is used up."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import checked, function, of_kind, optional
from swarmstart.arrays import Array
from swarmstart.heuristics.laws.algorithm import Algorithm, InvalidSettingsError
from swarmstart.heuristics.laws.box import Box
from swarmstart.heuristics.laws.initial import Initial
from swarmstart.heuristics.laws.order import Order
from swarmstart.heuristics.running.budget import (
    AT_TARGET,
    GOES_ON,
    STAGNANT,
    Budget,
    InvalidBudgetError,
    budget_of,
    progress_of,
)
from swarmstart.heuristics.running.compiled_loop import (
    CHUNK,
    CompiledObjective,
    can_loop,
    next_chunk,
)
from swarmstart.heuristics.running.interrupts import heeded, put_off
from swarmstart.heuristics.running.result import (
    GenerationEvent,
    SearchInterrupted,
    SearchResult,
    StopReason,
    locked,
)
from swarmstart.heuristics.running.search import (
    Individual,
    InvalidEvaluationError,
    Search,
)
from swarmstart.heuristics.searches.arguments import algorithm_of, box_of, generator_of
from swarmstart.machine_code import Count, Stopwatch, stopwatch

Objective = Callable[[Array], ArrayLike | tuple[ArrayLike, ArrayLike]]
"""Population, shape (dim, size), read-only -> cost, or (cost, violation), each (size,).

A cost alone means that every individual is feasible.
"""

Callback = Callable[[GenerationEvent], None]

FINISHED = {
    GOES_ON: None,
    AT_TARGET: StopReason.TARGET,
    STAGNANT: StopReason.STAGNATION,
}


_WATCHERS = dict.fromkeys(
    ("on_generation", "on_advance", "on_best"), optional(function())
)


@checked(InvalidSettingsError, **_WATCHERS)
def minimize(  # noqa: PLR0913
    objective: Objective,
    box: Box | ArrayLike | None = None,
    *,
    bounds: Box | ArrayLike | None = None,
    algorithm: Algorithm | type[Algorithm] | str | None = None,
    budget: Budget | int,
    rng: np.random.Generator | None = None,
    seed: int | Sequence[int] | None = None,
    order: Order | None = None,
    initial: Initial | ArrayLike | None = None,
    basins: int = 0,
    radius: float = 0.1,
    on_generation: Callback | None = None,
    on_advance: Callable[[int], None] | None = None,
    on_best: Callable[[int, Callable[[], Individual]], None] | None = None,
) -> SearchResult:
    """Search a box for the best point of an objective.

    Args:
        objective: Population, shape (dim, size) -> cost, or (cost, violation), each
            (size,). The population is read-only; returned arrays are copied. A cost
            alone means that every individual is feasible.
        box: The box to search, or pairs (lower, upper), one for each variable.
        bounds: Another name for `box`; exactly one of the two must be given.
        algorithm: Settings of the algorithm; or their class, or one of the names
            "lshade", "cpso", "pso", "de", "jde", "cma", "ga", "random", for its
            defaults. None means `default_algorithm`.
        budget: Limits of the search; an integer is a number of evaluations.
        rng: Source of randomness. The same state of the generator gives the same result
            bit for bit, unless the budget has seconds only, or seconds end the search.
        seed: Seed of a new generator; exactly one of rng and seed must be given.
        order: Order of individuals; None means `default_order()`.
        initial: Options of the initial population, or its first points; as in `Search`.
        basins: Number of best distinct basins that are kept (`archive`).
        radius: Least distance between two of these basins, a fraction of the box's
            widths.
        on_generation: Function that is called with a `GenerationEvent` after each
            generation; it may raise StopIteration to end the search.
        on_advance: Function that is called now and then with the number of evaluations
            so far, seldom enough not to slow down compiled generations.
        on_best: Function that is called as often as `on_advance`, with the number of
            evaluations so far and a function that returns the best point so far.

    Returns:
        The best point found, and how the search went.

    Raises:
        InvalidBoxError: If the bounds do not make a box.
        InvalidBudgetError: If the evaluations are too few for one generation.
        InvalidEvaluationError: If the objective is not a function, or returns wrong
            shapes.
        InvalidPointsError: If initial points do not fit the box or the population.
        InvalidSettingsError: If the settings do not fit the box, or an argument is of
            the wrong type.
        SearchInterrupted: On Ctrl-C, once a generation is finished.

    Example:
        >>> import swarmstart as ss
        >>> found = ss.minimize(
        ...     lambda x: (x**2).sum(axis=0), bounds=[(-1, 2)] * 3, budget=5000, seed=0
        ... )
        >>> found.evaluations, bool(found.cost < 1e-9)
        (5000, True)
    """
    budget = budget_of(budget)
    _require_callable(objective)
    search = Search(
        algorithm_of(algorithm, budget.evaluations),
        box_of(box, bounds),
        rng=generator_of(rng, seed),
        order=order,
        initial=initial,
        evaluations=budget.evaluations,
        basins=basins,
        radius=radius,
    )
    return run(
        search,
        objective,
        budget=budget,
        on_generation=on_generation,
        on_advance=on_advance,
        on_best=on_best,
    )


@checked(InvalidSettingsError, search=of_kind(Search, "a Search"), **_WATCHERS)
def run(
    search: Search,
    objective: Objective,
    *,
    budget: Budget | int,
    on_generation: Callback | None = None,
    on_advance: Callable[[int], None] | None = None,
    on_best: Callable[[int, Callable[[], Individual]], None] | None = None,
) -> SearchResult:
    """Run a search until its budget is used up; the loop of `minimize`.

    Args:
        search: A search, new or continued; it is advanced.
        objective: As in `minimize`.
        budget: Limits of the search. Evaluations count from the beginning of the
            search, so that a continued search ends as an uninterrupted one; seconds
            count from this call, without loading and compiling machine code.
        on_generation: As in `minimize`.
        on_advance: As in `minimize`.
        on_best: As in `minimize`.

    Returns:
        The best point found, and how the search went.

    Raises:
        InvalidBudgetError: If the evaluations left are too few for one generation.
        InvalidEvaluationError: If the objective is no function, or returns wrong
            shapes.
        SearchInterrupted: On Ctrl-C, once a generation is finished; the search can then
            be continued.
    """
    budget = budget_of(budget)
    _require_callable(objective)
    require_one_generation(search, budget)
    running = Running(search, objective, budget, on_generation)

    def advance(watch: Stopwatch) -> StopReason | None:
        return running(watch.seconds)

    return until_stopped(search, running, advance, on_advance, on_best)


def until_stopped(
    search: Search,
    running: Running,
    advance: Callable[[Stopwatch], StopReason | None],
    on_advance: Callable[[int], None] | None,
    on_best: Callable[[int, Callable[[], Individual]], None] | None,
) -> SearchResult:
    """Advance a search until it stops, and return the result.

    Args:
        search: The search.
        running: The same search with its budget and history.
        advance: Function that advances the search: stopwatch -> the reason to stop, or
            None to go on.
        on_advance: As in `minimize`.
        on_best: As in `minimize`.

    Raises:
        SearchInterrupted: On Ctrl-C, once a generation is finished.
    """
    with stopwatch() as watch:
        stopped = None
        try:
            while stopped is None:
                stopped = advance(watch) or running.ended(watch.seconds)
                spent = search.evaluations + running.spent
                if on_advance is not None:
                    on_advance(spent)
                if on_best is not None:
                    on_best(spent, lambda: search.best)
        except KeyboardInterrupt as interrupt:
            search.abandon()
            if not search.generations:  # There is no result to keep.
                raise
            raise SearchInterrupted(
                running.result(StopReason.INTERRUPTED, watch)
            ) from interrupt
        return running.result(stopped, watch)


class Running:
    """A running search with its budget and its history; a call advances the search.

    Attributes:
        spent: Evaluations charged to the budget for other work so far.
    """

    def __init__(
        self,
        search: Search,
        objective: Objective,
        budget: Budget,
        on_generation: Callback | None,
        *,
        chunk: int | None = None,
    ) -> None:
        """Prepare the search; compiled chunks begin with few generations.

        Args:
            search: The search.
            objective: As in `minimize`.
            budget: Limits of the search.
            on_generation: As in `minimize`.
            chunk: Fixed number of generations in a chunk; None means as many as take
                `CHUNK_S` seconds.
        """
        self._search = search
        self._objective = objective
        self._budget, self._chunk_size = budget, chunk
        self.spent = 0
        self._on_generation = on_generation
        self._compiled = on_generation is None and can_loop(objective)
        search.prepare(compiled=self._compiled)
        self._generations = chunk or CHUNK
        self._costs: list[Array] = []
        self._violations: list[Array] = []
        self._evaluations: list[Count] = []

    @property
    def budget(self) -> Budget:
        """The budget, less the evaluations charged for other work."""
        given = self._budget.evaluations
        if given is None or not self.spent:
            return self._budget
        # A budget of 0 would be refused; `_used_up` sees that nothing is left.
        return replace(self._budget, evaluations=max(given - self.spent, 1))

    def __call__(
        self, seconds: float, suggested: Array | None = None
    ) -> StopReason | None:
        """Advance by one generation, or by a chunk in compiled code.

        Args:
            seconds: Wall time so far [s].
            suggested: As in `Search.ask`.

        Returns:
            The reason to stop, if on_generation raised StopIteration; else None.
        """
        budget = self.budget
        progress = _progress(self._search, budget, seconds)
        left = (budget.seconds or np.inf) - seconds
        if suggested is None and self._compiled and self._chunk(progress, left):
            return None
        return self._generation(progress, suggested)

    def ended(self, seconds: float) -> StopReason | None:
        """Return the reason to stop after this wall time; None to go on."""
        budget = self.budget
        reached = FINISHED[self._search.finished(budget.limits())]
        return reached or _used_up(self._search, budget, seconds)

    def result(self, stopped: StopReason, watch: Stopwatch) -> SearchResult:
        """Return the result of the search.

        Args:
            stopped: Reason for the end of the search.
            watch: Stopwatch that was started with the search.
        """
        # `concatenate` needs an array, also if this call has finished no generation.
        search, best, none = self._search, self._search.best, np.empty(0)
        return SearchResult(
            x=locked(best.x),
            cost=best.cost,
            violation=best.violation,
            evaluations=search.evaluations + self.spent,
            generations=search.generations,
            stopped=stopped,
            history_cost=locked(np.concatenate([none, *self._costs])),
            history_violation=locked(np.concatenate([none, *self._violations])),
            history_evaluations=locked(np.concatenate([none, *self._evaluations])),
            nonfinite=search.nonfinite,
            basins=search.basins,
            seconds=watch.seconds,
            compile_seconds=search.compile_seconds + watch.compile_seconds,
            snapshot=search.snapshot(),
        )

    def _chunk(self, progress: float, left: float) -> bool:
        """Advance in compiled code; return whether that was possible.

        Ctrl-C waits until the generations are in the history, here and below.
        """
        begin = time.perf_counter()
        with put_off():
            work = self._search.loop(
                cast(CompiledObjective, self._objective),
                generations=self._generations,
                limits=self.budget.limits(),
                progress=progress,
            )
            if work is None:
                return False
            done = int(work.done[0])
            # Views: the next chunk gets new arrays.
            self._costs.append(work.best_cost[:done])
            self._violations.append(work.best_violation[:done])
            self._evaluations.append(work.evaluations[:done] + self.spent)
        if self._chunk_size is None:
            took = time.perf_counter() - begin
            # No generation is done if the next one needs more room or evaluations.
            self._generations = next_chunk(max(done, 1), took, left=left - took)
        return True

    def _generation(
        self, progress: float, suggested: Array | None
    ) -> StopReason | None:
        """Advance by one generation from Python."""
        search = self._search
        population = search.ask(progress=progress, suggested=suggested)
        with heeded():
            returned = self._objective(population)
        cost, violation = values_of(returned, population.shape[1])
        with put_off():
            search.tell(cost, violation)
            best = search.best
            self._costs.append(np.array([best.cost]))
            self._violations.append(np.array([best.violation]))
            self._evaluations.append(np.array([search.evaluations + self.spent]))
        if self._on_generation is not None:
            try:
                event = _event(search, progress, population, cost, violation)
                self._on_generation(event)
            except StopIteration:
                return StopReason.CALLBACK
        return None


def values_of(
    returned: ArrayLike | tuple[ArrayLike, ArrayLike], size: int
) -> tuple[ArrayLike, ArrayLike]:
    """Split what an objective returned into costs and violations.

    Args:
        returned: A tuple (cost, violation); or costs alone, shape (size,); or costs and
            violations as rows, shape (2, size).
        size: Number of individuals.

    Returns:
        Costs and violations; those of a tuple are returned unchecked.

    Raises:
        InvalidEvaluationError: If `returned` is not one of these.
    """
    if isinstance(returned, tuple):
        if len(returned) == len(("cost", "violation")):
            return returned
        found = f"a tuple of {len(returned)}"
    else:
        try:
            array = np.asarray(returned, dtype=np.float64)
        except (TypeError, ValueError):
            array = None
        if array is not None and array.shape == (size,):
            return array, np.zeros(size)
        if array is not None and array.shape == (2, size):
            return array[0], array[1]
        shape = "" if array is None else f" of shape {array.shape}"
        found = f"{type(returned).__name__}{shape}"
    raise InvalidEvaluationError(
        f"objective must return (cost, violation), or the cost alone, each of shape "
        f"({size},): one for each column of the population; got {found}",
        name="objective",
    )


def _require_callable(objective: object) -> None:
    if not callable(objective) or isinstance(objective, type):
        raise InvalidEvaluationError(
            "objective must be a function: population of shape (dim, size) -> cost, "
            f"or (cost, violation), each (size,); got {type(objective).__name__}",
            name="objective",
        )


def _progress(search: Search, budget: Budget, seconds: float) -> float:
    """Return the fraction of the budget used before a generation, in [0, 1].

    Time counts only if the budget has no evaluations, so that the same seed gives the
    same bits.
    """
    if budget.evaluations is not None:
        if search.evaluations + search.size > budget.evaluations:
            return 1.0  # Other work has spent what was left for this generation.
        return progress_of(search.evaluations, search.size, budget.evaluations)
    return min(seconds / (budget.seconds or np.inf), 1.0)


def _used_up(search: Search, budget: Budget, seconds: float) -> StopReason | None:
    """Return the limit that forbids another generation; None if one is allowed."""
    after_next = search.evaluations + search.size
    if budget.evaluations is not None and after_next > budget.evaluations:
        return StopReason.EVALUATIONS
    if budget.seconds is not None and seconds >= budget.seconds:
        return StopReason.SECONDS
    return None


def require_one_generation(search: Search, budget: Budget) -> None:
    """Validate that one more generation of a search fits into a budget.

    Raises:
        InvalidBudgetError: If it does not.
    """
    if _used_up(search, budget, seconds=0.0) is StopReason.EVALUATIONS:
        raise InvalidBudgetError(
            f"evaluations must be at least {search.evaluations + search.size}"
            f" (one generation of {search.size} after {search.evaluations} "
            f"evaluations so far), got {budget.evaluations}",
            budget,
        )


def _event(
    search: Search,
    progress: float,
    population: Array,
    cost: ArrayLike,
    violation: ArrayLike,
) -> GenerationEvent:
    best = search.best
    return GenerationEvent(
        generation=search.generations - 1,
        evaluations=search.evaluations,
        progress=progress,
        best_x=locked(best.x),
        best_cost=best.cost,
        best_violation=best.violation,
        population=population,
        cost=locked(cost),
        violation=locked(violation),
    )
