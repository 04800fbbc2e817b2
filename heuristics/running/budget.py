"""Budgets, how long a search may go on, and the criteria for its end.

The loop in Python (`minimize.py`) and the compiled one (`compiled_loop.py`) judge the
criteria after each generation:

target      the best point is feasible and its cost at most the target
stagnation  a number of generations without a better point; generations in which the
            level of the order was above its tolerance do not count; a constant added to
            the cost changes nothing
"""

from dataclasses import dataclass
from numbers import Integral, Real
from typing import NamedTuple, cast

import numpy as np

from swarmstart.errors import SwarmstartError, brief
from swarmstart.heuristics.laws.algorithm import State
from swarmstart.heuristics.laws.order import RunningOrder
from swarmstart.machine_code import kernel

GOES_ON, AT_TARGET, STAGNANT = 0, 1, 2
UNLIMITED = np.iinfo(np.int64).max


class InvalidBudgetError(SwarmstartError, ValueError):
    """An invalid budget, or one too small for a single generation.

    Attributes:
        evaluations: The evaluations given; None if not given.
        seconds: The seconds given; None if not given.
    """

    def __init__(self, message: str, budget: object) -> None:
        """Store the message and the budget's numbers."""
        super().__init__(message)
        self.evaluations: int | None = getattr(budget, "evaluations", None)
        self.seconds: float | None = getattr(budget, "seconds", None)


class Limits(NamedTuple):
    """Limits of a search, as plain numbers.

    Attributes:
        evaluations: Largest number of individuals.
        target: Cost at which the search ends; minus infinity: no such cost.
        stagnation: Number of generations without a better point after which the search
            ends; 0: no such limit.
    """

    evaluations: int
    target: float
    stagnation: int


@dataclass(frozen=True, kw_only=True, slots=True)
class Budget:
    """Limits of a search, which stops at the first limit that it reaches.

    Attributes:
        evaluations: Largest number of individuals evaluated, at least 1; None means no
            limit.
        seconds: Wall time in s, above 0, after which no generation is started (the
            first always is); None means no limit. Loading machine code, or compiling
            it once per machine, does not count.
        target: Cost at which the search stops as soon as a feasible point reaches it;
            None means no target.
        stagnation: Number of generations without a better point after which the search
            stops, at least 1; None means never. A constant added to the cost changes
            nothing. Generations in which the level of the order is above its tolerance
            do not count.

    Raises:
        InvalidBudgetError: If there are neither evaluations nor seconds, or a limit is
            out of its range.

    Example:
        >>> import swarmstart as ss
        >>> ss.Budget(evaluations=20_000, seconds=2.0, target=1e-8)
        Budget(evaluations=20000, seconds=2.0, target=1e-08, stagnation=None)
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
                    f"got {brief(value)}"
                )
                raise InvalidBudgetError(message, self)
        seconds, target = self.seconds, self.target
        if seconds is not None and not (_is_number(seconds) and 0.0 < seconds < np.inf):
            message = f"seconds must be finite and above 0, got {brief(seconds)}"
            raise InvalidBudgetError(message, self)
        if target is not None and not (
            _is_number(target) and -np.inf <= target <= np.inf
        ):
            message = f"target must be a number, got {brief(target)}"
            raise InvalidBudgetError(message, self)

    def limits(self) -> Limits:
        """Return the limits that a search's loop checks after each generation."""
        return Limits(
            evaluations=UNLIMITED
            if self.evaluations is None
            else int(self.evaluations),
            target=-np.inf if self.target is None else float(self.target),
            stagnation=int(self.stagnation or 0),
        )


def budget_of(given: Budget | int) -> Budget:
    """Return a budget; an integer is a number of evaluations.

    Raises:
        InvalidBudgetError: If it is neither a Budget nor an integer of at least 1.

    Example:
        >>> budget_of(5000) == Budget(evaluations=5000)
        True
    """
    if isinstance(given, Budget):
        return given
    if not _is_count(given):
        raise InvalidBudgetError(
            "budget must be a Budget, or an integer of at least 1 (evaluations), "
            f"got {brief(given)}",
            None,
        )
    return Budget(evaluations=int(given))


def _is_count(value: object) -> bool:
    """Return whether a value is an integer from 1 to what compiled code can count."""
    ok = isinstance(value, Integral) and not isinstance(value, bool)
    # Half of the range, so that a sum of evaluations cannot overflow.
    return ok and 1 <= int(cast(int, value)) < UNLIMITED // 2


def _is_number(value: object) -> bool:
    """Return whether a value is a real number."""
    return isinstance(value, Real) and not isinstance(value, bool)


@kernel
def finished(order: RunningOrder, state: State, limits: Limits) -> int:
    """Return whether and why a search ends now: GOES_ON, AT_TARGET or STAGNANT."""
    feasible = state.best_violation[0] <= order.tolerance
    if feasible and state.best_cost[0] <= limits.target:
        return AT_TARGET
    # By generations, not by costs: a constant added to them changes nothing.
    idle = state.generation[0] - state.improved[0]
    if limits.stagnation > 0 and idle >= limits.stagnation:
        return STAGNANT
    return GOES_ON


@kernel
def progress_of(evaluations: int, size: int, budget: int) -> float:
    """Fraction of the budget used before a generation, in [0, 1].

    It is 0 for the initial population and 1 for the last generation that fits; with
    generations of one size it is iter_k / iter_max of (5.19). If sizes change, the
    remaining generations are assumed to have the present size, so that the search of a
    growing population may end before the fraction is 1.

    Args:
        evaluations: Number of individuals evaluated so far.
        size: Number of individuals of the generation.
        budget: Number of individuals that may be evaluated.
    """
    left = (budget - evaluations) // size  # Whole generations, this one included.
    before_last = evaluations + (left - 1) * size
    return min(evaluations / before_last, 1.0) if before_last > 0 else 0.0
