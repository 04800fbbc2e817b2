"""Curves of solvers: best cost and reached targets over effort, performance profiles.

history   the best cost so far on a scenario: lowest, median, highest of the runs
ecdf      the share of (seed, target) pairs reached, for 51 targets between the best
          known cost and the worst first value; their distances from the best known
          cost are in equal ratios
profile   the share of instances on which a solver is near the fastest:

    rho_s(ratio) = share of instances in which t(s) <= ratio * min over solvers of t

rho_s is the profile of the solver s, and t(s) its effort to reach the target, infinite
if it never did. An instance that no solver has reached counts in the total, but for no
solver. The order of two solvers in a profile can change if a third one is left out
(Gould and Scott 2016).

Source: Dolan and More (2002), Benchmarking optimization software with performance
profiles, Mathematical Programming 91; Gould and Scott (2016), A note on performance
profiles for benchmarking software, ACM Transactions on Mathematical Software 43.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.cases.campaign.judging.running_time import (
    Courses,
    costs_at,
    marks_up_to,
    reached,
    shares_reached,
    targets_between,
)
from swarmstart.cases.campaign.judging.runs import ROUND_OFF, Asked, Runs
from swarmstart.cases.campaign.judging.statistics import bands, resampled

DIGITS = 6
"""Significant digits of the numbers of a curve."""

RATIOS = 41
MOST_RATIO = 1e6
"""Largest ratio of a profile."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Curves:
    """Marks of the effort, targets and bootstrap weights, the same for all solvers."""

    marks: Array
    targets: Array
    weights: Array
    seeds: int

    @classmethod
    def of(
        cls,
        runs: Sequence[Runs],
        best: float,
        limits: Array,
        asked: Asked,
        rng: np.random.Generator,
    ) -> Curves:
        """Return what the curves share; random numbers are drawn even if unused.

        Args:
            runs: Runs of all solvers.
            best: The least known cost; infinite if no cost is known.
            limits: Largest costs that count as near `best`, shape (2,).
            asked: Seeds and resamples.
            rng: Source of the random numbers of the bootstrap.
        """
        seeds = len(asked.seeds)
        # Drawn in any case, so that no later draw depends on the histories.
        weights = resampled(seeds, resamples=asked.resamples, rng=rng)
        courses = [one.evaluations for one in runs if _has_history(one)]
        ends = np.array([end for one in courses for end in one.ends])
        finite = ends[np.isfinite(ends)]
        worst = max((_worst_first(one) for one in courses), default=-math.inf)
        targets = np.empty(0)
        if math.isfinite(best) and math.isfinite(worst):
            # Equal ratios need a first distance above 0, also if the best cost is 0.
            nearest = max(float(limits[1] - best), ROUND_OFF * abs(worst))
            if nearest > 0:
                targets = targets_between(best, worst, nearest)
        marks = marks_up_to(float(finite.max())) if len(finite) else np.empty(0)
        return cls(marks=marks, targets=targets, weights=weights, seeds=seeds)

    def history(self, runs: Runs) -> dict[str, Any] | None:
        """Return the best cost so far at marks: lowest, median, highest of the runs."""
        if not _has_history(runs) or not len(self.marks):
            return None
        costs = np.sort(costs_at(runs.evaluations, self.marks), axis=0)
        return {
            "evaluations": rounded(self.marks),
            "cost": {
                "low": rounded(costs[0]),
                "median": rounded(_middle(costs)),
                "high": rounded(costs[-1]),
            },
            "seconds": rounded(_seconds_at(runs, self.marks)),
        }

    def ecdf(self, runs: Runs) -> dict[str, Any] | None:
        """Return the share of (seed, target) pairs reached at each mark, with its band.

        The band is that of 95 percent, from resampled seeds. Without resamples, or if
        one run counts for every seed, both of its ends are the share itself.
        """
        if not _has_history(runs) or not len(self.marks) or not len(self.targets):
            return None
        spent = reached(runs.evaluations, self.targets)
        shares = shares_reached(spent, self.marks)
        mean = shares.mean(axis=0)
        low, high = mean, mean
        # One run that counts for every seed has no band.
        if len(shares) == self.seeds and len(self.weights):
            low, high = bands(self.weights @ shares)
        return {
            "evaluations": rounded(self.marks),
            "share": rounded(mean),
            "low": rounded(low),
            "high": rounded(high),
        }


def _has_history(runs: Runs) -> bool:
    return any(result.get("history") for result in runs.results)


def _worst_first(courses: Courses) -> float:
    """Return the worst first feasible cost of the runs."""
    return float(courses.first_costs().max(initial=-math.inf))


def _seconds_at(runs: Runs, marks: Array) -> Array:
    """Return the median time of the runs at marks of evaluations.

    A run that has ended keeps its last time.
    """
    counts, clock = runs.evaluations, runs.seconds
    # The histories have evaluations, but no seconds.
    if counts.spent.shape != clock.spent.shape:
        return np.full(len(marks), math.nan)
    place = (counts.spent[:, :, None] <= marks).sum(axis=1) - 1
    when = np.take_along_axis(clock.spent, np.maximum(place, 0), axis=1)
    return _middle(np.sort(when, axis=0))


def _middle(rising: Array) -> Array:
    """Return medians of sorted columns; infinite if one of the middle two is."""
    count = len(rising)
    # Halved before they are added: the sum of huge costs would be infinite.
    middle: Array = rising[(count - 1) // 2] / 2 + rising[count // 2] / 2
    return middle


def rounded(values: ArrayLike) -> list[float | None]:
    """Return numbers of a curve with six digits; None for those that are not finite."""
    return [
        float(f"{v:.{DIGITS}g}") if math.isfinite(v) else None
        for v in np.ravel(values).tolist()
    ]


def relative_times(times: ArrayLike) -> Array:
    """Return times divided by the least time of each instance.

    Args:
        times: Times of solvers to a target, shape (solvers, instances), positive;
            infinite if the target was never reached.

    Returns:
        Ratios, shape (solvers, instances), at least 1; infinite if never reached.
    """
    spent = np.asarray(times, dtype=np.float64)
    least = spent.min(axis=0)
    known = np.isfinite(least)
    ratios = np.full(spent.shape, np.inf)
    # A time of 0 belongs to a mark before the first step: take the smallest number.
    floor = np.finfo(np.float64).tiny
    ratios[:, known] = np.maximum(spent[:, known], floor) / np.maximum(
        least[known], floor
    )
    return ratios


def ratios_of(relative: Array) -> Array:
    """Return 41 ratios at which profiles are drawn, with equally spaced logarithms."""
    finite = relative[np.isfinite(relative)]
    most = min(max(2.0, float(finite.max(initial=1.0))), MOST_RATIO)
    # The last ratio is beyond the round-off of the largest finite one.
    ratios: Array = np.geomspace(1.0, most * (1 + 1e-9), RATIOS)
    return ratios


def performance_profile(relative: Array, ratios: ArrayLike) -> Array:
    """Return the share of instances within each ratio of the fastest.

    Args:
        relative: Ratios from `relative_times`, shape (solvers, instances).
        ratios: Ratios to the fastest, shape (ratios,), at least 1.

    Returns:
        Shape (solvers, ratios).
    """
    shares: Array = _within(relative, ratios).mean(axis=1)
    return shares


def _within(relative: Array, ratios: ArrayLike) -> Array:
    """Return 1 if an instance is within a ratio, else 0."""
    within: Array = (relative[:, :, None] <= np.asarray(ratios)).astype(np.float64)
    return within


def profile_bands(
    relative: Array, ratios: Array, groups: list[Array]
) -> tuple[Array, Array]:
    """Return 95 percent bands of a profile, from seeds resampled within each scenario.

    Thus the bands tell about other seeds on these scenarios, not about other scenarios.

    Args:
        relative: Ratios from `relative_times`, shape (solvers, instances), with the
            instances of a scenario side by side.
        ratios: Ratios at which the profile is computed, shape (ratios,).
        groups: For each scenario the weights of its seeds from `resampled`, shape
            (resamples, seeds).

    Returns:
        Lower and upper end of the bands, shape (solvers, ratios) each.
    """
    weights = np.concatenate([group / len(groups) for group in groups], axis=1)
    # With `optimize` it is a product of matrices, which BLAS computes.
    means = np.einsum("bi,sir->bsr", weights, _within(relative, ratios), optimize=True)
    return bands(means)
