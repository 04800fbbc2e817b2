"""Settings of a search on one planning problem, in all accepted forms.

multistart  local solves from random starts, batch after batch
memetic     a population search that improves its best distinct members by local solves

Both need the whole problem, not only its objective, and use lanes; `lane_search.py`
runs them. All other algorithms are those of `swarmstart.heuristics`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from swarmstart.arguments import (
    FLAG,
    MOST_WORK,
    a_count,
    a_number,
    checked,
    either,
    of_kind,
    optional,
    text,
)
from swarmstart.arrays import Array
from swarmstart.heuristics import (
    LSHADE,
    Algorithm,
    Box,
    Budget,
    Order,
    Sampling,
    algorithm_of,
    static_penalty,
)
from swarmstart.heuristics.laws.algorithm import ALGORITHM, InvalidSettingsError
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.expressions import shortened
from swarmstart.ocp.common.limits import require_choice

WarmStart = Literal["all", "half", "one", "none"]
When = Literal["needed", "undecided", "always"]
EVALUATIONS = 20_000
"""Default budget of a search."""
MULTISTART_EVALUATIONS = 500_000
"""Default budget of a multistart: a few hundred local solves."""
SAMPLE = 256
"""Size of the random sample that determines the weight of a violation."""


@checked(
    InvalidSettingsError,
    size=a_count(least=1),
    unseen=a_number(least=0, most=1),
    lanes=FLAG,
)
@dataclass(frozen=True, kw_only=True, slots=True)
class Multistart:
    """Local solves from smooth random starts, until few optima are left to find.

    The search ends when the budget is spent. It ends earlier if, with 95 % confidence,
    the share of starts that would lead to an optimum not seen yet is below `unseen`.
    This holds for these starts only (docs/answers.md, "Many starts"). If a problem has
    no lane method, or `lanes` is false, the NLP solver starts from random points until
    the budget is spent.

    Attributes:
        size: Number of starts that are solved at once, at least 1.
        unseen: Upper limit of the unseen share at which the search ends, in [0, 1]; 0
            means that the whole budget is used.
        lanes: Whether lanes solve the starts if possible. False: the NLP solver alone,
            one start after another, as a usual alternative to a search.

    Raises:
        InvalidSettingsError: If a value is out of its range.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=1,
        ...     terminal_cost=4 * (x**2 - 1) ** 2 - x / 2,
        ...     bounds=ss.Bounds(controls=(-2, 2)),
        ... )
        >>> search = ss.Multistart(size=8, lanes=False)
        >>> found = ss.solve(problem, [0.0], search=search, budget=150, lanes=0, seed=0)
        >>> round(float(found.controls[0, 0]), 4)
        1.0153
    """

    size: int = 64
    unseen: float = 0.05
    lanes: bool = True


@checked(
    InvalidSettingsError,
    size=optional(a_count(least=4)),
    members=a_count(least=1),
    share=a_number(above=0, below=1),
)
@dataclass(frozen=True, kw_only=True, slots=True)
class Memetic:
    """L-SHADE that improves its best distinct members by local solves in lanes.

    If a problem has no lane method, it is L-SHADE alone.

    Attributes:
        size: Number of individuals of the first generation, as `LSHADE.size`.
        members: Largest number of members improved at a time, at least 1.
        share: Share of the evaluations that local solves may cost, in (0, 1).

    Raises:
        InvalidSettingsError: If a value is out of its range.

    Example:
        >>> import swarmstart as ss
        >>> search = ss.SearchSettings(
        ...     algorithm=ss.Memetic(members=4, share=0.3),
        ...     budget=ss.Budget(evaluations=20_000),
        ... )
        >>> search.algorithm.share
        0.3
    """

    size: int | None = None
    members: int = 8
    share: float = 0.5

    @checked(refused, evaluations=optional(a_count(least=1, most=MOST_WORK)))
    def population(self, evaluations: int | None) -> LSHADE:
        """Return the population search that is improved.

        Args:
            evaluations: Largest number of evaluations, those of the local solves
                included; None if the budget is given in seconds.
        """
        if self.size is not None or evaluations is None:
            return LSHADE(size=self.size)
        own = max(int((1 - self.share) * evaluations), 1)
        line = Box(lower=np.zeros(1), upper=np.ones(1))
        return LSHADE(size=LSHADE().first_size(line, own))


SearchAlgorithm = Algorithm | Multistart | Memetic
_ALGORITHM = either(
    ALGORITHM, of_kind((Multistart, Memetic), "a Multistart or a Memetic")
)
"""Algorithms that search a planning problem."""
NAMED: dict[str, type[Multistart] | type[Memetic]] = {
    "multistart": Multistart,
    "memetic": Memetic,
}


@checked(
    refused,
    algorithm=_ALGORITHM,
    evaluations=optional(a_count(least=1, most=MOST_WORK)),
)
def population_of(
    algorithm: SearchAlgorithm, evaluations: int | None = None
) -> Algorithm | None:
    """Return the population search of an algorithm; None if it has none.

    Args:
        algorithm: The algorithm.
        evaluations: Largest number of evaluations; None if the budget is given in
            seconds.

    Returns:
        The settings of a population search, or None for a multistart.
    """
    if isinstance(algorithm, Multistart):
        return None
    if isinstance(algorithm, Memetic):
        return algorithm.population(evaluations)
    return algorithm


@checked(
    refused,
    algorithm=_ALGORITHM,
    budget=of_kind(Budget, "a Budget"),
    order=optional(of_kind(Order, "an order as feasibility_first() makes it")),
    warm_start=text(),
    sampling=optional(text()),
    basins=a_count(),
    radius=a_number(above=0, finite=False),
    when=text(),
)
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
        sampling: Method of drawing the random individuals, as in `heuristics.Initial`.
        basins: Number of additional starting points for the polish (the best distinct
            basins). 0: polish the best point only, or three basins if there are
            decisions besides the controls.
        radius: Smallest distance of two basins, as a fraction of the bounds' widths.
        when: Whether to search for a plan that follows an earlier one: "always", or
            only if "needed". With "needed" and a polish, the search runs if the polish
            from the earlier plan fails or the problem has jumped (docs/answers.md,
            "Closed loop: one warm polish a step"). "undecided" is like "needed", and
            leaves out the search for a first plan, too, if the polish from default
            controls and the lanes agree (docs/answers.md, "Many starts"). Without a
            polish every plan is searched.

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
            its name, or "default", which searches with `when="undecided"`; None or
            "none" means no search.
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
    # Without a search, too: a wrong budget is a mistake even if nothing is searched.
    if isinstance(budget, int | np.integer) and not isinstance(budget, bool):
        budget = Budget(evaluations=int(budget))
    if budget is not None and not isinstance(budget, Budget):
        raise InvalidProblemError(
            "budget must be a Budget or a number of evaluations, "
            f"got {shortened(budget)}"
        )
    if order is not None and not isinstance(order, Order):
        raise InvalidProblemError(
            "order must be an order such as feasibility_first(), "
            f"got {shortened(order)}"
        )
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
        evaluations = MULTISTART_EVALUATIONS if several else EVALUATIONS
        budget = Budget(evaluations=evaluations)
    algorithm = of_lanes or algorithm_of(search, budget.evaluations)  # type: ignore[arg-type]
    is_default = isinstance(search, str) and search == "default"
    return SearchSettings(
        algorithm=algorithm,
        budget=budget,
        order=order,
        when="undecided" if is_default else "needed",
    )


def _of_lanes(search: object) -> Multistart | Memetic | None:
    """Return a search that uses local solves in lanes; None: it is another one."""
    if isinstance(search, Multistart | Memetic):
        return search
    kind = NAMED.get(search) if isinstance(search, str) else search
    is_class = any(kind is known for known in NAMED.values())
    return kind() if is_class else None  # type: ignore[operator]


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
    # If most points are feasible, or all costs equal, the sample gives no weight.
    return static_penalty(float(weight) if weight > 0.0 else 1.0)
