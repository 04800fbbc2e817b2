"""Settings of a population search on one planning problem, in all accepted forms."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    Algorithm,
    Box,
    Budget,
    Order,
    Sampling,
    algorithm_of,
    static_penalty,
)
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import shortened
from swarmstart.ocp.common.limits import require_choice
from swarmstart.ocp.search.lane_settings import (
    EVALUATIONS as OF_MULTISTART,
)
from swarmstart.ocp.search.lane_settings import (
    NAMED,
    Memetic,
    Multistart,
    SearchAlgorithm,
)

WarmStart = Literal["all", "half", "one", "none"]
When = Literal["needed", "always"]
EVALUATIONS = 20_000
"""Default budget of a search."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SearchSettings:
    """Settings of a population search on one planning problem.

    Attributes:
        algorithm: Settings of an algorithm of `swarmstart.heuristics`, `Multistart` or
            `Memetic`.
        budget: Budget of the search for one planning problem.
        order: Order of two individuals; None: `heuristics.default_order` with the
            problem's tolerance, or `traded_order` before a polish if there are
            decisions besides the controls.
        warm_start: Share of the first population that is the guess: "all", "half",
            "one" individual or "none"; the rest is drawn at random.
        sampling: Method of drawing the rest, as in `heuristics.Initial`.
        basins: Number of additional starting points for the polish (the best distinct
            basins). 0: polish the best point only, or three basins if there are
            decisions besides the controls.
        radius: Smallest distance of two basins, as a fraction of the bounds' widths.
        when: Whether to search for a plan that follows an earlier one: "always", or
            only if "needed". With "needed" and a polish, the search runs if the polish
            from the earlier plan fails or the problem has jumped (docs/answers.md,
            "Closed loop: one warm polish a step").
            Without a polish every plan is searched.

    Raises:
        InvalidProblemError: If a value is out of its range.

    Example:
        >>> import swarmstart as ss
        >>> search = ss.SearchSettings(
        ...     algorithm=ss.LSHADE(), budget=ss.Budget(evaluations=5000), basins=2
        ... )
        >>> search.warm_start, search.when
        ('one', 'needed')
    """

    algorithm: SearchAlgorithm
    budget: Budget
    order: Order | None = None
    warm_start: WarmStart = "one"
    sampling: Sampling | None = None
    basins: int = 0
    radius: float = 0.1
    when: When = "needed"

    def __post_init__(self) -> None:
        """Validate the values."""
        require_choice("when", self.when, get_args(When))
        if self.warm_start not in get_args(WarmStart):
            raise InvalidProblemError(
                f"warm_start must be one of {', '.join(get_args(WarmStart))}, "
                f"got {self.warm_start!r}"
            )
        if isinstance(self.algorithm, Multistart) and self.sampling is not None:
            raise InvalidProblemError(
                "sampling must be left out with a Multistart, which draws its own, "
                f"got {self.sampling!r}"
            )
        if self.basins < 0 or not self.radius > 0:
            raise InvalidProblemError(
                "basins must be at least 0 and radius above 0, "
                f"got {self.basins} and {self.radius}"
            )


SearchGiven = (
    SearchSettings
    | SearchAlgorithm
    | type[Algorithm]
    | type[Multistart]
    | type[Memetic]
    | str
    | None
)
"""Settings; or an algorithm, its class or its name, without a budget; None: none."""


def search_settings(
    search: SearchGiven,
    budget: Budget | int | None = None,
    order: Order | None = None,
) -> SearchSettings | None:
    """Return a search in the form that a planner uses; None means no search.

    Args:
        search: Settings, which have a budget and an order; or an algorithm, its class,
            its name, or "default"; None or "none" means no search.
        budget: Budget of an algorithm; an integer is a number of evaluations; None
            means 20,000, or 500,000 for a multistart.
        order: Order of an algorithm; None means `heuristics.default_order` with the
            problem's tolerance.

    Returns:
        The settings; None without a search.

    Raises:
        InvalidProblemError: If the budget or the order is of the wrong kind, or is
            given in addition to settings.
        InvalidSettingsError: If there is no such algorithm.
    """
    if search is None or (isinstance(search, str) and search == "none"):
        return None
    if isinstance(search, SearchSettings):
        if budget is not None or order is not None:
            raise InvalidProblemError(
                "budget and order must stand in the SearchSettings that search= is "
                f"given, got {shortened(budget if order is None else order)} beside it"
            )
        return search
    of_lanes = _of_lanes(search)
    if budget is None:
        several = isinstance(of_lanes, Multistart)
        budget = OF_MULTISTART if several else EVALUATIONS
    if isinstance(budget, int | np.integer) and not isinstance(budget, bool):
        budget = Budget(evaluations=int(budget))
    if not isinstance(budget, Budget):
        raise InvalidProblemError(
            "budget must be a Budget or a number of evaluations, "
            f"got {shortened(budget)}"
        )
    if order is not None and not isinstance(order, Order):
        raise InvalidProblemError(
            "order must be an order such as feasibility_first(), "
            f"got {shortened(order)}"
        )
    algorithm = of_lanes or algorithm_of(search, budget.evaluations)  # type: ignore[arg-type]
    return SearchSettings(algorithm=algorithm, budget=budget, order=order)


def _of_lanes(search: object) -> Multistart | Memetic | None:
    """Return a search that uses local solves in lanes; None: it is another one."""
    if isinstance(search, Multistart | Memetic):
        return search
    kind = NAMED.get(search) if isinstance(search, str) else search
    return kind() if kind in NAMED.values() else None  # type: ignore[operator]


SAMPLE = 256
"""Size of the random sample that determines the weight of a violation."""


def traded_order(
    values: Callable[[Array], tuple[Array, Array]], box: Box, rng: np.random.Generator
) -> Order:
    """Return the order by cost + weight * violation, for searches before a polish.

    A random sample sets the weight, so that it does not depend on the unit of the cost:

        weight = (interquartile range of the cost) / (median of the violation)

    With a much larger weight each constraint becomes a wall, and the search ends on the
    side on which it began (benchmarks/opti_warm_start.py).

    Args:
        values: Population (dim, size) -> cost and violation, each (size,).
        box: The box of the search.
        rng: Source of the sample.
    """
    sample = rng.uniform(box.lower[:, None], box.upper[:, None], (box.dim, SAMPLE))
    cost, violation = values(sample)
    finite = np.isfinite(cost) & np.isfinite(violation)
    if not finite.any():
        return static_penalty(1.0)
    low, high = np.percentile(cost[finite], (25, 75))
    typical = np.median(violation[finite])
    weight = (high - low) / typical if typical > 0.0 else 0.0
    return static_penalty(float(weight) if weight > 0.0 else 1.0)
