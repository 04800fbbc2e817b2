"""Seconds until two methods find the best optimum with 95 % probability.

A method whose runs hit with probability p and take t seconds on average needs
t max(1, log(0.05) / log(1 - p)): after this many runs, at least one, the probability
that all have missed is 5 %.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from swarmstart.arrays import Array
from swarmstart.benchmarks.answer_runs import Run
from swarmstart.benchmarks.shipped_problems import WITHIN

SURE = 0.95
SELDOM = 0.3
"""Share of hits below which IPOPT's starts hit seldom."""
SOONER = 10
"""Required ratio of the seconds in that case."""
_COLD, _MORE = 1.3, 0.2
_SAMPLES = 2000


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Way:
    """Runs of one method.

    Attributes:
        runs: Their number.
        share: Fraction of them that hit.
        mean_s: Mean time of a run [s].
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
        """The seconds with the range of most samples, as text."""
        sign = "" if self.share else "> "
        return f"{sign}{_number(self.seconds)} ({_range(self.samples)})"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Raced:
    """Two methods, and the bar for their ratio.

    Attributes:
        ipopt: IPOPT from one random start after the other.
        solve: `solve` with one seed after the other.
        asked: The bar, in words.
        reached: Whether the bar is reached.
    """

    ipopt: Way
    solve: Way
    asked: str
    reached: bool

    @property
    def told(self) -> str:
        """The ratio of the two times with the range of most samples, as text."""
        times = self.ipopt.seconds / self.solve.seconds
        sign = "" if self.ipopt.share else "> "
        samples = self.ipopt.samples / self.solve.samples
        return f"{sign}{_number(times)} ({_range(samples)})"


def seconds_until(share: float, mean_s: float, runs: int) -> float:
    """Return the seconds until a hit with 95 % probability [s].

    Args:
        share: Fraction of the runs that hit; 0 counts as the largest probability with
            which no run hits in 5 % of all cases.
        mean_s: Mean time of a run [s].
        runs: Their number.
    """
    if share >= 1:
        return mean_s
    missed = 1 - share if share else (1 - SURE) ** (1 / runs)
    return mean_s * max(1.0, math.log(1 - SURE) / math.log(missed))


def way(seconds: Sequence[float], hits: Sequence[bool]) -> Way:
    """Return the summary of the runs of a method.

    Args:
        seconds: Time of each run [s].
        hits: Whether each run hit.
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
    """Return two methods, and whether the bar for their ratio is reached.

    Args:
        starts: Runs of IPOPT from random starts.
        start_hits: Whether they hit.
        answers: Runs of `solve`.
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
    """Return the seconds until a solve found its answer; all of them for a miss."""
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
