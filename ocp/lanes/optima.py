"""Distinct local optima among the answers of many local solves, counted.

Two answers are the same optimum where their states are within 0.08 of each other on the
way (root mean square), each state in parts of how far the cheapest answer moves it: as
near as 0.03 or as far as 0.15 gives the same counts on the problems tried. Mirror
images have one cost, and are two.

How much has not been seen: the share of answers that would be an optimum not among
these is estimated by the share of optima found once (Good 1953). It speaks of these
starts and this way of solving only, never of all optima.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.lanes.augmented import LaneAnswers

Array = NDArray[np.float64]

APART = 0.08
"""Root mean square distance of scaled states above which two answers are two optima."""
_STILL = 1e-6
"""A state that moves by less, in parts of its size, stays."""
FEASIBLE = 1e-6
"""Largest violation, in the NLP's numbers near one, of an answer that counts."""


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
        most: Upper end of its 95 % interval, whose lower end is 0.
        answers: Number of answers that it is from.
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
    feasible = np.flatnonzero(answers.violation <= FEASIBLE)
    order = feasible[np.argsort(answers.cost[feasible], kind="stable")]
    points = _points(answers, order)
    first: list[int] = []
    counts: list[int] = []
    for lane in order.tolist():
        away = np.sqrt(np.mean((points[first] - points[lane]) ** 2, axis=1))
        if first and away.min() <= apart:
            counts[int(away.argmin())] += int(each[lane])
        else:
            first.append(lane)
            counts.append(int(each[lane]))
    return [
        Optimum(lane=lane, cost=float(answers.cost[lane]), count=count)
        for lane, count in zip(first, counts, strict=True)
    ]


def _points(answers: LaneAnswers, order: NDArray[np.int64]) -> Array:
    """Return the paths of answers, a row each, in parts of the cheapest one's moves."""
    if not order.size:
        return np.empty((0, 0))
    moved = np.ptp(answers.states[:, :, order[0]], axis=1)
    size = np.where(moved > _STILL, moved, 1.0)  # Of what stays: its natural size.
    scaled = answers.states / size[:, None, None]
    return np.ascontiguousarray(scaled.reshape(-1, answers.cost.size).T)


def unseen_share(counts: list[int]) -> Unseen:
    """Return the share of answers that would be an optimum not seen yet.

    With n1 optima found once and n2 found twice among n answers: n1 / n, and above it
    1.96 sqrt(n1 + 2 n2) / n at most; 3 / n where n1 is 0 (the rule of three).

    Args:
        counts: How often each optimum was found.

    Source: Good (1953), The population frequencies of species and the estimation of
    population parameters; Esty (1983), A normal limit law for a nonparametric estimator
    of the coverage of a random sample.
    """
    n, once, twice = sum(counts), counts.count(1), counts.count(2)
    if not n:
        return Unseen(share=1.0, most=1.0, answers=0)
    share = once / n
    beyond = 1.96 * math.sqrt(once + 2 * twice) / n if once else 0.0
    return Unseen(share=share, most=min(1.0, max(share + beyond, 3 / n)), answers=n)
