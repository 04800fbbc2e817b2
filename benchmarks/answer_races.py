"""Seconds until the best optimum is found with 95 % probability, of two ways to it.

A way whose runs hit with the probability p and take t seconds on average wants
t max(1, log(0.05) / log(1 - p)): so many runs that all miss with 5 %, but one at least.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.benchmarks.answer_runs import Run
from swarmstart.benchmarks.shipped_problems import WITHIN

Array = NDArray[np.float64]

SURE = 0.95
SELDOM = 0.3
"""Share of hits below which IPOPT's starts hit seldom."""
SOONER = 10
"""How many times less is asked for there."""
_COLD, _MORE = 1.3, 0.2
_SAMPLES = 2000


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Way:
    """Runs of one way.

    Attributes:
        runs: Their number.
        share: Part of them that hit.
        mean_s: Seconds of one, on average [s].
        seconds: Until the best optimum is found [s].
        samples: The same of samples of the runs with replacement, shape (2000,) [s].
    """

    runs: int
    share: float
    mean_s: float
    seconds: float
    samples: Array

    @property
    def told(self) -> str:
        """Seconds, and the range of most samples."""
        sign = "" if self.share else "> "
        return f"{sign}{_number(self.seconds)} ({_range(self.samples)})"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Raced:
    """Two ways, and what is asked for.

    Attributes:
        ipopt: One random start after the other.
        solve: One seed after the other.
        asked: What is asked for, in words.
        reached: Whether it is so.
    """

    ipopt: Way
    solve: Way
    asked: str
    reached: bool

    @property
    def told(self) -> str:
        """How many times less the second takes, and the range of most samples."""
        times = self.ipopt.seconds / self.solve.seconds
        sign = "" if self.ipopt.share else "> "
        samples = self.ipopt.samples / self.solve.samples
        return f"{sign}{_number(times)} ({_range(samples)})"


def seconds_until(share: float, mean_s: float, runs: int) -> float:
    """Return the seconds until a hit with 95 % probability [s].

    Args:
        share: Part of the runs that hit; 0 counts as the largest that would give none
            in 5 % of all cases.
        mean_s: Of a run [s].
        runs: Their number.
    """
    if share >= 1:
        return mean_s
    missed = 1 - share if share else (1 - SURE) ** (1 / runs)
    return mean_s * max(1.0, math.log(1 - SURE) / math.log(missed))


def way(seconds: Sequence[float], hits: Sequence[bool]) -> Way:
    """Return what runs tell of a way.

    Args:
        seconds: Of each run [s].
        hits: Whether it hit.
    """
    spent, hit = np.array(seconds), np.array(hits, dtype=float)
    n = spent.size
    drawn = np.random.default_rng(0).integers(n, size=(_SAMPLES, n))
    samples = [
        seconds_until(float(hit[one].mean()), float(spent[one].mean()), n)
        for one in drawn
    ]
    share, mean = float(hit.mean()), float(spent.mean())
    return Way(
        runs=n,
        share=share,
        mean_s=mean,
        seconds=seconds_until(share, mean, n),
        samples=np.array(samples),
    )


def raced(
    starts: Sequence[Run],
    start_hits: Sequence[bool],
    answers: Sequence[Run],
    answer_hits: Sequence[bool],
) -> Raced:
    """Return two ways, and whether what is asked for is so.

    Args:
        starts: IPOPT's from random starts.
        start_hits: Whether they hit.
        answers: Those of `solve`.
        answer_hits: Whether they hit.
    """
    ipopt = way([run.wall_s for run in starts], start_hits)
    until = [_until(*one) for one in zip(answers, answer_hits, strict=True)]
    own = way(until, answer_hits)
    if ipopt.share < SELDOM:
        asked, most = f"{SOONER} times less", ipopt.seconds / SOONER
    elif has_several_optima([*starts, *answers]):
        asked, most = "not slower", ipopt.seconds
    else:
        once = float(np.median([run.zero_s or run.wall_s for run in answers]))
        most = _COLD * once + _MORE
        asked = f"at most {_number(most)} s"
    is_so = own.share > 0 and own.seconds <= most
    return Raced(ipopt=ipopt, solve=own, asked=asked, reached=is_so)


def _until(run: Run, hit: bool) -> float:
    """Return the seconds of a solve until it found its answer; of a miss all."""
    return run.wall_s if run.found_s is None or not hit else run.found_s


def has_several_optima(runs: Sequence[Run]) -> bool:
    """Return whether feasible answers differ."""
    costs = np.array([run.cost for run in runs if run.feasible])
    return bool(costs.size) and bool(np.ptp(costs) > WITHIN * np.abs(costs).min())


def _number(value: float) -> str:
    """Return two digits, or all before the point."""
    return f"{value:.2g}" if value < 100 else f"{value:,.0f}"


def _range(samples: Array) -> str:
    low, high = np.quantile(samples, [0.05, 0.95])
    return f"{_number(low)} to {_number(high)}"
