"""Distinct local optima among the answers of many local solves, counted.

Two answers are the same optimum where their states are within 0.08 of each other on the
way (root mean square), each state in parts of how far the cheapest answer moves it: as
near as 0.03 or as far as 0.15 gives the same counts on the problems tried. Mirror
images have one cost, and are two.

How much has not been seen: the share U of answers that would be an optimum not among
these is estimated by that of optima found once, n1 / n (Good 1953). About U, n1 has the
variance n U (1 - U) + 2 n2, with n2 optima found twice (Esty 1983). The most that U may
be, at 95 %, is the largest with

    (n U - n1)^2 <= 1.645^2 (n U (1 - U) + 2 n2)

and at least 3 / n: the score interval (Wilson 1927), which unlike n1 + 1.96 sd does not
shrink where few were found once. Measured in docs/measured/unseen_share.md. It speaks
of these starts and this way of solving only, never of all optima.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.lanes.answers import LaneAnswers

Array = NDArray[np.float64]

APART = 0.08
"""Root mean square distance of scaled states above which two answers are two optima."""
_STILL = 1e-6
"""A state that moves by less, in parts of its size, stays."""
FEASIBLE = 1e-6
"""Largest violation, in the NLP's numbers near one, of an answer that counts."""
_SURE = 1.6448536269514722
"""Standard deviations below which a normal number is in 95 %."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Optimum:
    """One local optimum that was found.

    Attributes:
        lane: Number of the best answer in it.
        cost: Of that.
        count: Number of answers in it.
    """

    lane: int
    cost: float
    count: int


@dataclass(frozen=True, kw_only=True, slots=True)
class Unseen:
    """Share of answers that would be an optimum not seen yet.

    Attributes:
        share: The estimate.
        most: Upper end of its 95 % interval, whose lower end is 0: a share that is
            larger would have shown more optima found once in 95 % of all cases.
        answers: Number of answers that it is from, those without an optimum left out.
    """

    share: float
    most: float
    answers: int


def distinct_optima(
    answers: LaneAnswers,
    *,
    apart: float = APART,
    stand_for: NDArray[np.int64] | None = None,
) -> list[Optimum]:
    """Return the optima among answers that are feasible, the cheapest first.

    Args:
        answers: Of lanes.
        apart: Root mean square distance above which two are distinct.
        stand_for: How many answers each of them stands for, shape (n,): earlier ones
            of which only the best was kept; None means one each.
    """
    each = np.ones(answers.cost.size, np.int64) if stand_for is None else stand_for
    number = optimum_of(answers, apart=apart)
    optima = []
    for one in range(int(number.max(initial=-1)) + 1):
        lanes = np.flatnonzero(number == one)
        best = int(lanes[answers.cost[lanes].argmin()])
        cost, count = float(answers.cost[best]), int(each[lanes].sum())
        optima.append(Optimum(lane=best, cost=cost, count=count))
    return optima


def optimum_of(answers: LaneAnswers, *, apart: float = APART) -> NDArray[np.int64]:
    """Return the number of each answer's optimum, -1 where it is infeasible.

    The cheapest answer is an optimum, and so is each that is apart from all cheaper
    ones that are. The others belong to the nearest.

    Args:
        answers: Of lanes.
        apart: Root mean square distance above which two are distinct.
    """
    ended = np.isfinite(answers.cost) & (answers.violation <= FEASIBLE)
    feasible = np.flatnonzero(ended)
    order = feasible[np.argsort(answers.cost[feasible], kind="stable")]
    number = np.full(answers.cost.size, -1, dtype=np.int64)
    if not order.size:
        return number
    points = paths(answers, int(order[0]))
    first: list[int] = []
    for lane in order.tolist():
        away = np.sqrt(np.mean((points[first] - points[lane]) ** 2, axis=1))
        if first and away.min() <= apart:
            number[lane] = away.argmin()
        else:
            number[lane] = len(first)
            first.append(lane)
    return number


def paths(answers: LaneAnswers, cheapest: int) -> Array:
    """Return the paths of answers, a row each, in parts of how far one moves states.

    Args:
        answers: Of lanes.
        cheapest: Number of that one.
    """
    moved = np.ptp(answers.states[:, :, cheapest], axis=1)
    size = np.where(moved > _STILL, moved, 1.0)  # Of what stays: its natural size.
    scaled = answers.states / size[:, None, None]
    return np.ascontiguousarray(scaled.reshape(-1, answers.cost.size).T)


def unseen_share(counts: Sequence[int]) -> Unseen:
    """Return the share of answers that would be an optimum not seen yet.

    The estimate is n1 / n with n1 optima found once among n answers; the end of its
    interval is said at the head.

    Args:
        counts: How often each optimum was found.

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
