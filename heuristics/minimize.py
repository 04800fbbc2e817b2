"""The loop: ask, evaluate, tell, until the budget is used up."""

import enum
import time
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Integral, Real
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.errors import SwarmstartError
from swarmstart.heuristics.algorithm import Algorithm
from swarmstart.heuristics.box import Box
from swarmstart.heuristics.compiled_loop import (
    CHUNK,
    CompiledObjective,
    can_loop,
    next_chunk,
)
from swarmstart.heuristics.default import default_algorithm
from swarmstart.heuristics.initial import Initial
from swarmstart.heuristics.kernel import Array
from swarmstart.heuristics.order import Order
from swarmstart.heuristics.search import (
    Individual,
    InvalidEvaluationError,
    Search,
    Snapshot,
)
from swarmstart.heuristics.stopping import (
    AT_TARGET,
    GOES_ON,
    STAGNANT,
    UNLIMITED,
    Limits,
    progress_of,
)

Objective = Callable[[Array], tuple[ArrayLike, ArrayLike]]
"""Population, shape (dim, size), read-only -> cost and violation, each (size,)."""


class InvalidBudgetError(SwarmstartError, ValueError):
    """A budget that is no budget, or in which not one generation fits.

    Attributes:
        evaluations: The evaluations given.
        seconds: The seconds given.
    """

    def __init__(self, message: str, budget: "Budget") -> None:
        """Keep the budget's numbers beside the message."""
        super().__init__(message)
        self.evaluations = budget.evaluations
        self.seconds = budget.seconds


@dataclass(frozen=True, kw_only=True, slots=True)
class Budget:
    """When a search stops: at whichever limit comes first.

    Attributes:
        evaluations: Largest number of individuals evaluated, at least 1; None means no
            limit.
        seconds: Wall time in s, above 0, after which no generation is started (the
            first always is); None means no limit. It includes the compilation of the
            kernels, a few seconds once per machine.

        target: Cost at which the search stops, once a feasible point has it; None means
            none.
        stagnation: Generations without a better point after which it stops, at least 1;
            None means never. A constant added to the cost changes nothing.

    Raises:
        InvalidBudgetError: If there are neither evaluations nor seconds, or one is out
            of its range.
    """

    evaluations: int | None = None
    seconds: float | None = None
    target: float | None = None
    stagnation: int | None = None

    def __post_init__(self) -> None:
        """Check the limits."""
        if self.evaluations is None and self.seconds is None:
            raise InvalidBudgetError("a budget needs evaluations or seconds", self)
        for name in ("evaluations", "stagnation"):
            value = getattr(self, name)
            if value is not None and not _is_count(value):
                message = (
                    f"{name} must be an integer of at least 1 and below 2^62, "
                    f"got {value!r}"
                )
                raise InvalidBudgetError(message, self)
        if self.seconds is not None and not 0.0 < self.seconds < np.inf:
            message = f"seconds must be finite and above 0, got {self.seconds}"
            raise InvalidBudgetError(message, self)
        target = self.target
        if target is not None and (not isinstance(target, Real) or np.isnan(target)):
            message = f"target must be a number, got {target!r}"
            raise InvalidBudgetError(message, self)

    def limits(self) -> Limits:
        """Return what both loops look at after a generation."""
        return Limits(
            evaluations=UNLIMITED
            if self.evaluations is None
            else int(self.evaluations),
            target=-np.inf if self.target is None else float(self.target),
            stagnation=int(self.stagnation or 0),
        )


def _is_count(value: object) -> bool:
    """Return whether a value is an integer from 1 to what compiled code can count."""
    ok = isinstance(value, Integral) and not isinstance(value, bool)
    return ok and 1 <= int(cast(int, value)) < UNLIMITED // 2


class StopReason(enum.Enum):
    """Why a search stopped."""

    EVALUATIONS = "the budget of evaluations is used up"
    SECONDS = "the budget of wall time is used up"
    TARGET = "a feasible point has reached the target"
    STAGNATION = "no better point was found for too long"
    CALLBACK = "on_generation stopped the search"


FINISHED = {
    GOES_ON: None,
    AT_TARGET: StopReason.TARGET,
    STAGNANT: StopReason.STAGNATION,
}


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class GenerationEvent:
    """What `on_generation` is told after each generation; arrays are read-only.

    Attributes:
        generation: Number of the generation; the initial population is 0.
        evaluations: Individuals evaluated so far.
        progress: Fraction of the budget used, in [0, 1].
        best_x: Best point so far, shape (dim,).
        best_cost: Its cost.
        best_violation: Its violation.
        population: The generation, shape (dim, size).
        cost: Its costs, shape (size,).
        violation: Its violations, shape (size,).
    """

    generation: int
    evaluations: int
    progress: float
    best_x: Array
    best_cost: float
    best_violation: float
    population: Array
    cost: Array
    violation: Array


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SearchResult:
    """What a search found; arrays are read-only.

    Attributes:
        x: Best point, shape (dim,), in the units of the variables.
        cost: Its cost; infinity if no individual was finite.
        violation: Its violation; 0 = feasible.
        evaluations: Individuals evaluated, those before a continuation included.
        generations: Generations evaluated, the initial population included.
        stopped: Why the search stopped.
        history_cost: Cost of the best point after each generation of this call, shape
            (generations of this call,). It may rise where the violation falls.
        history_violation: Violation of that point, same shape.
        nonfinite: Individuals whose cost or violation was not finite.
        basins: The best distinct basins met, the best first; see `archive`.
        seconds: Wall time of this call in s.
        snapshot: All that the search knows at its end; `Search` continues from it.
    """

    x: Array
    cost: float
    violation: float
    evaluations: int
    generations: int
    stopped: StopReason
    history_cost: Array
    history_violation: Array
    nonfinite: int
    basins: tuple[Individual, ...]
    seconds: float
    snapshot: Snapshot


def minimize(  # noqa: PLR0913
    objective: Objective,
    box: Box,
    *,
    algorithm: Algorithm | None = None,
    budget: Budget,
    rng: np.random.Generator,
    order: Order | None = None,
    initial: Initial | ArrayLike | None = None,
    basins: int = 0,
    radius: float = 0.1,
    on_generation: Callable[[GenerationEvent], None] | None = None,
) -> SearchResult:
    """Search a box for the best point of an objective.

    Args:
        objective: Population, shape (dim, size) -> (cost, violation), each (size,). The
            population is read-only and stays as it is; what is returned is copied.
        box: The box to search.
        algorithm: Settings of the algorithm; None means `default_algorithm`.
        budget: When to stop.
        rng: Source of randomness. The same state of it gives the same bits, unless the
            budget has seconds only, or seconds end the search.
        order: How individuals are ordered; None means `feasibility_first()`.
        initial: As in `Search`.
        basins: How many of the best distinct basins are kept (`archive`).
        radius: Least distance of two of them, a fraction of the box's widths.
        on_generation: Called after each generation; may raise StopIteration to stop.

    Returns:
        The best point found, and how the search went.

    Raises:
        InvalidBudgetError: If not one generation fits into the evaluations.
        InvalidEvaluationError: If the objective returns wrong shapes.
        InvalidPointsError: If initial points do not fit.
        InvalidSettingsError: If the settings do not fit the box.
    """
    search = Search(
        algorithm or default_algorithm(budget.evaluations),
        box,
        rng=rng,
        order=order,
        initial=initial,
        evaluations=budget.evaluations,
        basins=basins,
        radius=radius,
    )
    return run(search, objective, budget=budget, on_generation=on_generation)


def run(
    search: Search,
    objective: Objective,
    *,
    budget: Budget,
    on_generation: Callable[[GenerationEvent], None] | None = None,
) -> SearchResult:
    """Run a search until its budget is used up; the loop of `minimize`.

    Args:
        search: A search, new or continued; it is advanced.
        objective: As in `minimize`.
        budget: When to stop. Evaluations count from the beginning of the search, so
            that a continued search ends as an uninterrupted one; seconds count from
            this call.
        on_generation: As in `minimize`.

    Returns:
        The best point found, and how the search went.

    Raises:
        InvalidBudgetError: If not one generation fits into the evaluations left.
        InvalidEvaluationError: If the objective returns wrong shapes.
    """
    begin = time.perf_counter()
    _require_one_generation(search, budget)
    compiled = on_generation is None and budget.evaluations and can_loop(objective)
    advance = _CompiledGenerations() if compiled else _one_generation
    limits = budget.limits()
    history: list[tuple[Array, Array]] = []
    stopped = None
    while stopped is None:
        seconds = time.perf_counter() - begin
        advanced = advance(search, objective, budget, seconds, on_generation)
        history.append((advanced.best_cost, advanced.best_violation))
        stopped = (
            advanced.stopped
            or FINISHED[search.finished(limits)]
            or _used_up(search, budget, time.perf_counter() - begin)
        )
    costs, violations = (
        np.concatenate(column) for column in zip(*history, strict=True)
    )
    best = search.best
    return SearchResult(
        x=_locked(best.x),
        cost=best.cost,
        violation=best.violation,
        evaluations=search.evaluations,
        generations=search.generations,
        stopped=stopped,
        history_cost=_locked(costs),
        history_violation=_locked(violations),
        nonfinite=search.nonfinite,
        basins=search.basins,
        seconds=time.perf_counter() - begin,
        snapshot=search.snapshot(),
    )


class _Advanced(NamedTuple):
    """What one or several generations found.

    Attributes:
        best_cost: Best cost so far after each of them.
        best_violation: Its violation.
        stopped: Why to stop, where on_generation said so.
    """

    best_cost: Array
    best_violation: Array
    stopped: StopReason | None = None


def _one_generation(
    search: Search,
    objective: Objective,
    budget: Budget,
    seconds: float,
    on_generation: Callable[[GenerationEvent], None] | None,
) -> _Advanced:
    """Advance by one generation from Python."""
    progress = _progress(search, budget, seconds)
    population = search.ask(progress=progress)
    cost, violation = _pair(objective(population))
    search.tell(cost, violation)
    best = search.best
    found = _Advanced(np.array([best.cost]), np.array([best.violation]))
    if on_generation is not None:
        try:
            on_generation(_event(search, progress, population, cost, violation))
        except StopIteration:
            return found._replace(stopped=StopReason.CALLBACK)
    return found


class _CompiledGenerations:
    """Advances by chunks in compiled code, each as long as the clock allows."""

    def __init__(self) -> None:
        """Begin with a few generations."""
        self._generations = CHUNK

    def __call__(
        self,
        search: Search,
        objective: Objective,
        budget: Budget,
        seconds: float,
        on_generation: Callable[[GenerationEvent], None] | None,
    ) -> _Advanced:
        """Advance by a chunk."""
        begin, asked = time.perf_counter(), self._generations
        work = search.loop(
            cast(CompiledObjective, objective),
            generations=asked,
            limits=budget.limits(),
        )
        if work is None:
            return _one_generation(search, objective, budget, seconds, on_generation)
        done = int(work.done[0])
        self._generations = next_chunk(max(done, 1), time.perf_counter() - begin)
        return _Advanced(work.best_cost[:done], work.best_violation[:done])


def _progress(search: Search, budget: Budget, seconds: float) -> float:
    """Fraction of the budget used before a generation, in [0, 1].

    The clock counts only where there is no other limit: the same seed gives the same
    bits.
    """
    if budget.evaluations is not None:
        return progress_of(search.evaluations, search.size, budget.evaluations)
    return min(seconds / (budget.seconds or np.inf), 1.0)


def _used_up(search: Search, budget: Budget, seconds: float) -> StopReason | None:
    """Which limit forbids another generation; None if none does."""
    after_next = search.evaluations + search.size
    if budget.evaluations is not None and after_next > budget.evaluations:
        return StopReason.EVALUATIONS
    if budget.seconds is not None and seconds >= budget.seconds:
        return StopReason.SECONDS
    return None


def _require_one_generation(search: Search, budget: Budget) -> None:
    if _used_up(search, budget, seconds=0.0) is StopReason.EVALUATIONS:
        raise InvalidBudgetError(
            f"evaluations must be at least {search.evaluations + search.size}"
            f" (one generation of {search.size} after {search.evaluations} "
            f"evaluations so far), got {budget.evaluations}",
            budget,
        )


def _pair(values: tuple[ArrayLike, ArrayLike]) -> tuple[ArrayLike, ArrayLike]:
    try:
        cost, violation = values
    except (TypeError, ValueError) as error:
        message = f"objective must return (cost, violation), got {type(values)}"
        raise InvalidEvaluationError(message, name="objective") from error
    return cost, violation


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
        best_x=_locked(best.x),
        best_cost=best.cost,
        best_violation=best.violation,
        population=population,
        cost=_locked(cost),
        violation=_locked(violation),
    )


def _locked(values: ArrayLike) -> Array:
    """A read-only copy."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array
