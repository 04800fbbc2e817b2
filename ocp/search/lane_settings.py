"""Settings of the searches that use local solves in lanes.

multistart  local solves from random starts, batch after batch
memetic     a population search that improves its best distinct members by local solves

Both need the whole problem, not only its objective; `lane_search.py` runs them.
"""

from dataclasses import dataclass
from numbers import Real

import numpy as np

from swarmstart.heuristics import LSHADE, Algorithm, Box
from swarmstart.heuristics.laws import require


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

    def __post_init__(self) -> None:
        """Validate the values."""
        _require_count("size", self.size)
        ok = isinstance(self.unseen, Real) and 0.0 <= self.unseen <= 1.0
        require("unseen", self.unseen, ok=ok, allowed="in [0, 1]")
        ok = isinstance(self.lanes, bool)
        require("lanes", self.lanes, ok=ok, allowed="true or false")


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

    def __post_init__(self) -> None:
        """Validate the values."""
        _require_count("members", self.members)
        ok = isinstance(self.share, Real) and 0.0 < self.share < 1.0
        require("share", self.share, ok=ok, allowed="between 0 and 1")
        LSHADE(size=self.size)

    def population(self, evaluations: int | None) -> LSHADE:
        """Return the population search that is improved.

        Args:
            evaluations: The budget of both together; None if it is given in seconds.
        """
        if self.size is not None or evaluations is None:
            return LSHADE(size=self.size)
        own = max(int((1 - self.share) * evaluations), 1)
        line = Box(lower=np.zeros(1), upper=np.ones(1))
        return LSHADE(size=LSHADE().first_size(line, own))


SearchAlgorithm = Algorithm | Multistart | Memetic
"""Algorithms that search a planning problem."""

NAMED: dict[str, type[Multistart] | type[Memetic]] = {
    "multistart": Multistart,
    "memetic": Memetic,
}
EVALUATIONS = 500_000
"""Default budget of a multistart: a few hundred local solves."""


def population_of(
    algorithm: SearchAlgorithm, evaluations: int | None = None
) -> Algorithm | None:
    """Return the population search of an algorithm; None if it has none.

    Args:
        algorithm: The algorithm.
        evaluations: Its budget; None if that is given in seconds.

    Returns:
        The settings of a population search, or None for a multistart.
    """
    if isinstance(algorithm, Multistart):
        return None
    if isinstance(algorithm, Memetic):
        return algorithm.population(evaluations)
    return algorithm


def _require_count(name: str, value: object) -> None:
    ok = isinstance(value, int) and not isinstance(value, bool) and value >= 1
    require(name, value, ok=ok, allowed="an integer of at least 1")
