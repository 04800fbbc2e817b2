"""Answers of many local solves, and the distinct local optima among them, counted.

Two answers count as the same optimum if the root mean square distance of their states
along the path is below 0.08, each state divided by how far the cheapest answer moves
it. The value was chosen here: 0.03 and 0.15 give the same counts on the problems tried.
Mirror images have the same cost, but are two optima. An answer counts as an optimum
only if its lane has shown that it meets the conditions of one; a lane that ended
elsewhere is unfinished.

The unseen share U is the probability that a further answer is an optimum not found yet.
Let n answers be optima, n1 of these optima be found once, and n2 twice. U is estimated
by n1 / n (Good 1953). n1 has variance n U (1 - U) + 2 n2 about n U (Esty 1983). The
upper limit of U, at 95 %, is the largest U with

    (n U - n1)^2 <= 1.645^2 (n U (1 - U) + 2 n2)

and at least 3 / n. This is the score interval (Wilson 1927). An interval of n1 plus a
multiple of its standard deviation would shrink if few optima were found once; this one
does not. docs/measured/unseen_share.md shows how often the limit holds. It holds for
these starts and this solver only, not for all optima.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array

APART = 0.08
"""Root mean square distance of scaled states above which two answers are two optima."""
_STILL = 1e-6
"""A state that moves by less, relative to its size, counts as constant."""
FEASIBLE = 1e-6
"""Largest violation, in the NLP's scaled numbers, of an answer that counts."""
_SURE = 1.6448536269514722
"""The 95 % quantile of the standard normal distribution."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LaneAnswers:
    """Results of lanes, in the order of their starts.

    Attributes:
        controls: Controls within their bounds, shape (nu, N, n).
        starts: Decisions about the start, shape (ny, n).
        states: States at the beginning of each interval and at the end, divided by
            their sizes, shape (nx, N + 1, n).
        cost: Cost of the rewritten problem (core), which is minimised, shape (n,);
            infinite if a lane broke down.
        violation: The worst excess in the NLP's scaled numbers, shape (n,).
        iterations: Number of steps, shape (n,).
        optimal: Whether an answer is shown to meet the conditions of a local optimum,
            of second order too, shape (n,); left out: none is.
        costates: Derivatives of the cost by the states at the start, at an optimum,
            shape (nx, n); left out: NaN.
    """

    controls: Array
    starts: Array
    states: Array
    cost: Array
    violation: Array
    iterations: NDArray[np.int64]
    optimal: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))
    costates: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        """Fill in what is left out."""
        if self.optimal.shape != self.cost.shape:
            none = np.zeros(self.cost.shape, dtype=np.bool_)
            object.__setattr__(self, "optimal", none)
        shape = self.states.shape[0], self.cost.size
        if self.costates.shape != shape:
            object.__setattr__(self, "costates", np.full(shape, np.nan))


def joined(parts: Sequence[LaneAnswers]) -> LaneAnswers:
    """Return the answers of several calls as those of one.

    Args:
        parts: Answers of each call, at least one.
    """
    return LaneAnswers(**{
        one.name: np.concatenate([getattr(part, one.name) for part in parts], axis=-1)
        for one in fields(LaneAnswers)
    })  # fmt: skip


def some_of(
    answers: LaneAnswers, lanes: Sequence[int] | NDArray[np.int64]
) -> LaneAnswers:
    """Return the answers of some lanes."""
    return LaneAnswers(**{
        one.name: np.ascontiguousarray(getattr(answers, one.name)[..., lanes])
        for one in fields(LaneAnswers)
    })  # fmt: skip


@dataclass(frozen=True, kw_only=True, slots=True)
class Optimum:
    """One local optimum that was found.

    Attributes:
        lane: Number of its best answer.
        cost: Cost of that answer.
        count: Number of answers that belong to it.
        controls: Controls of that answer, shape (nu, N).
        states: States of that answer between the intervals, shape (nx, N + 1).
        decided: Decisions of that answer about the start, shape (ny,).
    """

    lane: int
    cost: float
    count: int
    controls: Array = field(compare=False, repr=False)
    states: Array = field(compare=False, repr=False)
    decided: Array = field(compare=False, repr=False)


@dataclass(frozen=True, kw_only=True, slots=True)
class Unseen:
    """Probability that a further answer is an optimum not found yet.

    Attributes:
        share: The estimate.
        most: Upper end of the one-sided 95 % interval: if the share were larger, then
            in 95 % of all cases more optima would have been found exactly once.
        answers: Number of answers that belong to an optimum, on which the estimate
            rests.
    """

    share: float
    most: float
    answers: int


def distinct_optima(
    answers: LaneAnswers,
    *,
    stand_for: NDArray[np.int64] | None = None,
    shown: bool = False,
) -> list[Optimum]:
    """Return the optima among answers that are feasible, the cheapest first.

    The states of optima are divided by their sizes, as in the answers.

    Args:
        answers: Answers of lanes.
        stand_for: Number of answers that each given one represents, shape (n,), if only
            the best of earlier answers were kept; None: each represents itself.
        shown: Whether to leave out each optimum of which no answer is shown to meet the
            conditions of a local optimum.
    """
    each = np.ones(answers.cost.size, np.int64) if stand_for is None else stand_for
    number = optimum_of(answers)
    optima = []
    for one in range(int(number.max(initial=-1)) + 1):  # Numbers rise with the cost.
        lanes = np.flatnonzero(number == one)
        able = lanes[answers.optimal[lanes]] if shown else lanes
        if not able.size:
            continue
        best = int(able[np.argmin(answers.cost[able])])
        optima.append(
            Optimum(
                lane=best,
                cost=float(answers.cost[best]),
                count=int(each[lanes].sum()),
                controls=answers.controls[:, :, best],
                states=answers.states[:, :, best],
                decided=answers.starts[:, best],
            )
        )
    return optima


def optimum_of(answers: LaneAnswers) -> NDArray[np.int64]:
    """Return the number of each answer's optimum, -1 if it is infeasible.

    The cheapest answer is an optimum, and so is each answer that is apart from all
    cheaper optima. Every other answer belongs to the nearest optimum.

    Args:
        answers: Answers of lanes.
    """
    feasible = np.flatnonzero(reached(answers))
    # Stable, so that answers of equal cost give the same optima in every run.
    order = feasible[np.argsort(answers.cost[feasible], kind="stable")]
    number = np.full(answers.cost.size, -1, dtype=np.int64)
    if not order.size:
        return number
    points = paths(answers, int(order[0]))
    first: list[int] = []
    for lane in order.tolist():
        away = np.sqrt(np.mean((points[first] - points[lane]) ** 2, axis=1))
        if first and away.min() <= APART:
            number[lane] = away.argmin()
        else:
            number[lane] = len(first)
            first.append(lane)
    return number


def reached(answers: LaneAnswers) -> NDArray[np.bool_]:
    """Return which answers are feasible, shape (n,)."""
    return np.isfinite(answers.cost) & (answers.violation <= FEASIBLE)


def unreached(answers: LaneAnswers) -> tuple[int, int]:
    """Return how many answers are infeasible, and how many lanes broke down."""
    broken = ~np.isfinite(answers.cost)
    return int((~broken & ~reached(answers)).sum()), int(broken.sum())


def paths(answers: LaneAnswers, cheapest: int) -> Array:
    """Return the states of answers along their paths, a row for each answer.

    Each state is divided by the range that it covers in the cheapest answer.

    Args:
        answers: Answers of lanes.
        cheapest: Number of the cheapest answer.
    """
    moved = np.ptp(answers.states[:, :, cheapest], axis=1)
    size = np.where(moved > _STILL, moved, 1.0)  # A constant state keeps its scale.
    scaled = answers.states / size[:, None, None]
    return np.ascontiguousarray(scaled.reshape(-1, answers.cost.size).T)


def unseen_share(counts: Sequence[int]) -> Unseen:
    """Return the estimated probability that a further answer is a new optimum.

    The estimate is n1 / n with n1 optima found once among n answers; its upper limit,
    at 95 %, is that of Wilson's score interval, and at least 3 / n.

    Args:
        counts: Number of times that each optimum was found.

    Source: Good (1953), The population frequencies of species and the estimation of
    population parameters; Esty (1983), A normal limit law for a nonparametric estimator
    of the coverage of a random sample; Wilson (1927), Probable inference, the law of
    succession, and statistical inference; 3 / n is the rule of three of Hanley and
    Lippman-Hand (1983).
    """
    n, once, twice = sum(counts), counts.count(1), counts.count(2)
    if not n:
        return Unseen(share=1.0, most=1.0, answers=0)
    # (n + z^2) n U^2 - (2 n1 + z^2) n U + n1^2 - 2 z^2 n2 = 0: its larger root.
    square = _SURE**2
    a, b = (n + square) * n, (once + square / 2) * n
    most = (b + math.sqrt(b**2 - a * (once**2 - 2 * square * twice))) / a
    return Unseen(share=once / n, most=min(1.0, max(most, 3 / n)), answers=n)
