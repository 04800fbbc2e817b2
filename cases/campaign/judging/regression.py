"""Regression test: is a solver worse in a newer comparison than in an older one?

For each solver on each scenario the changes of success rate, costs and seconds are
compared with a margin:

    worse      the 90 percent interval of the change lies beyond the margin
    better     the interval lies beyond the margin on the other side
    same       the whole interval lies within the margin
    unknown    anything else: more seeds would tell

Thus a solver that is not worse is called worse in far less than 5 percent of the rows.
The change of costs and seconds is the median of the seeds' relative differences (Hodges
and Lehmann), with the interval of the signed-rank test; the change of the success rate
is that of paired shares. Pairs are formed by seed, or by order if the two comparisons
share few seeds, which is equivalent for independent runs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.cases.campaign.judging.runs import ROUND_OFF
from swarmstart.cases.campaign.judging.statistics import (
    SAME,
    median,
    median_interval,
    share_interval,
    too_few,
)
from swarmstart.errors import SwarmstartError

Content = Mapping[str, Any]
MARGIN = 0.1
FEWEST = 6
BETTER, AS_BEFORE, WORSE, UNKNOWN = "better", "same", "worse", "unknown"
SUCCESS, COST, SECONDS = "success rate", "median cost", "P50 seconds"
_FAR = 1e6
"""Relative change of the cost that stands for the loss of a feasible answer."""


class InvalidMarginError(SwarmstartError, ValueError):
    """A margin of a regression test is not between 0 and 1."""


@dataclass(frozen=True, slots=True)
class Change:
    """Change of one quantity.

    Attributes:
        quantity: "success rate", "median cost" or "P50 seconds".
        before: Value in the older comparison; None if it has none.
        now: Value in the newer comparison; None if it has none.
        verdict: "better", "same", "worse" or "unknown".
        words: Reason in words.
    """

    quantity: str
    before: float | None
    now: float | None
    verdict: str
    words: str


def regression(
    old: Content, new: Content, margin: float = MARGIN, *, against: str = ""
) -> dict[str, Any]:
    """Return the changes of all solvers since an older comparison.

    Args:
        old: Content of the older comparison, as from `content_of` or `read_comparison`.
        new: Content of the newer comparison.
        margin: Largest change that counts as "same": relative for costs and seconds, a
            difference for success rates; above 0, below 1.
        against: Origin of the older comparison, in words.

    Returns:
        {"against", "margin", "rows", "is_regression"}: "rows" has a row for each
        scenario, solver and quantity of the older comparison; "is_regression" is true
        if any row is "worse".

    Raises:
        InvalidMarginError: If the margin is not between 0 and 1.
    """
    require_margin(margin)
    rows = [
        {"scenario": scenario, "solver": solver, **asdict(change)}
        for scenario, solver, changes in _changes(old, new, margin)
        for change in changes
    ]
    return {
        "against": against,
        "margin": margin,
        "rows": rows,
        "is_regression": any(row["verdict"] == WORSE for row in rows),
    }


def require_margin(margin: float) -> None:
    """Validate a margin.

    Raises:
        InvalidMarginError: If it is not between 0 and 1.
    """
    if not 0 < margin < 1:
        raise InvalidMarginError(
            f"expected a margin above 0 % and below 100 %, found {100 * margin:g} %"
        )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Both:
    """A solver on a scenario, before and now, run by run.

    Attributes:
        costs: Costs, shape (2, pairs); infinite if infeasible.
        seconds: Times, shape (2, pairs); infinite if a run failed.
        success: Whether near the best known of both, shape (2, pairs).
        rows: Its rows in both.
        is_certain: Whether each has one deterministic run.
    """

    costs: Array
    seconds: Array
    success: NDArray[np.bool_]
    rows: tuple[Content, Content]
    is_certain: bool

    @property
    def count(self) -> int:
        """Number of pairs."""
        return int(self.costs.shape[1])

    @property
    def is_reproduced(self) -> bool:
        """True if every older run has exactly the same cost in the newer comparison."""
        everything = self.count == len(self.rows[0]["costs"])
        return everything and bool((self.costs[0] == self.costs[1]).all())


def _changes(
    old: Content, new: Content, margin: float
) -> Iterator[tuple[str, str, list[Change]]]:
    """Yield scenario, solver and its change, in the older one's order."""
    now = {s["name"]: s for s in new["scenarios"]}
    for scenario in old["scenarios"]:
        name = scenario["name"]
        rows = {row["solver"]: row for row in now.get(name, {}).get("rows", [])}
        for row in scenario["rows"]:
            later = rows.get(row["solver"])
            reason = _not_comparable(old, new, row, later)
            if later is None or reason:
                yield name, row["solver"], _unknown(row, later, reason)
                continue
            both = _both(old, new, (scenario, now[name]), (row, later))
            yield (
                name,
                row["solver"],
                [
                    _success_change(both, margin),
                    _cost_change(both, margin),
                    _seconds_change(both, margin, _clocks_differ(old, new)),
                ],
            )


def _not_comparable(
    old: Content, new: Content, row: Content, later: Content | None
) -> str:
    """Return the reason why two rows cannot be compared; empty if they can."""
    if later is None:
        return "not in the newer comparison"
    if old["budget"] != new["budget"]:
        return "another budget"
    if old["near"] != new["near"]:
        return "another distance counts as near"
    if row["settings"] != later["settings"]:
        return "other settings of scenario or solver"
    if row["deterministic"] != later["deterministic"]:
        return "deterministic in one of them only"
    return ""


def _clocks_differ(old: Content, new: Content) -> str:
    """Return the reason why seconds cannot be compared; empty if they can."""
    if old["is_noisy"] or new["is_noisy"]:
        return "a machine was busy"
    kept = ("processor", "cores", "system")
    before, now = (
        {tuple(str(one.get(key)) for key in kept) for one in content["machines"]}
        for content in (old, new)
    )
    if not before or not now:
        return "a machine is not known"
    return "" if before == now else "another machine"


def _unknown(row: Content, later: Content | None, reason: str) -> list[Change]:
    quantities = (
        (SUCCESS, _rate),
        (COST, lambda one: median(_filled(one["costs"]))),
        (SECONDS, lambda one: one["seconds_p50"]),
    )
    return [
        Change(
            quantity,
            value(row),
            None if later is None else value(later),
            UNKNOWN,
            f"not compared: {reason}",
        )
        for quantity, value in quantities
    ]


def _rate(row: Content) -> float | None:
    return row["near"][0] / row["runs"] if row["runs"] else None


def _filled(values: Sequence[float | None]) -> Array:
    """Return numbers, with infinity for missing ones."""
    return np.array([math.inf if v is None else v for v in values], dtype=np.float64)


def _both(
    old: Content,
    new: Content,
    scenarios: tuple[Content, Content],
    rows: tuple[Content, Content],
) -> _Both:
    """Return the paired runs of a solver on a scenario."""
    costs = [_filled(row["costs"]) for row in rows]
    seconds = [_filled(row["seconds"]) for row in rows]
    chosen = _pairs([old["seeds"], new["seeds"]], [len(each) for each in costs])
    costs = [each[at] for each, at in zip(costs, chosen, strict=True)]
    seconds = [each[at] for each, at in zip(seconds, chosen, strict=True)]
    # The best known of both decides, so a success means the same in both.
    least = _least(scenarios, chosen)
    paired = np.array(costs)
    sizes = np.abs(paired[np.isfinite(paired)])
    slack = ROUND_OFF * float(sizes.max(initial=0.0))
    limit = least + np.maximum(old["near"][0] * np.abs(least), slack)
    return _Both(
        costs=paired,
        seconds=np.array(seconds),
        success=np.isfinite(paired) & (paired <= limit),
        rows=rows,
        is_certain=all(row["deterministic"] and row["runs"] == 1 for row in rows),
    )


def _least(scenarios: tuple[Content, Content], chosen: Any) -> Array:
    """Return the best known cost of both for each pair, or for its seed."""
    drawn = [scenario["bests"] for scenario in scenarios]
    if None in drawn:
        return np.atleast_1d(_filled([s["best_cost"] for s in scenarios]).min())
    paired = [_filled(each)[at] for each, at in zip(drawn, chosen, strict=True)]
    least: Array = np.array(paired).min(axis=0)
    return least


def _pairs(seeds: Sequence[Sequence[int]], counts: Sequence[int]) -> Any:
    """Return the pairs of runs: those of the same seed, or else in their order."""
    if counts[0] == len(seeds[0]) and counts[1] == len(seeds[1]):
        places = {seed: k for k, seed in enumerate(seeds[1])}
        common = [(k, places[s]) for k, s in enumerate(seeds[0]) if s in places]
        # Else runs are paired in their order: too few seeds are in both.
        if len(common) >= min(FEWEST, *counts):
            return np.array(common).T
    shared = np.arange(min(counts))
    return shared, shared


def _success_change(both: _Both, margin: float) -> Change:
    before, now = (float(each.mean()) for each in both.success)
    change = partial(Change, SUCCESS, before, now)
    if both.is_reproduced:
        return change(AS_BEFORE, _reproduced(both))
    if both.is_certain:
        # One run without chance in each: the change itself.
        low = high = now - before
    elif both.count < FEWEST:
        return change(UNKNOWN, _few(both))
    else:
        gained = int((both.success[1] & ~both.success[0]).sum())
        lost = int((both.success[0] & ~both.success[1]).sum())
        low, high = share_interval(gained, lost, both.count)
    # A higher rate is better, a higher cost worse.
    return change(
        _verdict(-high, -low, margin, margin),
        _interval_words(low, high, "points", both),
    )


def _verdict(low: float, high: float, margin: float, less: float) -> str:
    """Return the verdict on a change for which less is better.

    Args:
        low: Lower end of its interval.
        high: Upper end of its interval.
        margin: Increase that is no regression.
        less: Decrease that is no improvement.
    """
    if low > margin:
        return WORSE
    if high < -less:
        return BETTER
    return AS_BEFORE if low >= -less and high <= margin else UNKNOWN


def _cost_change(both: _Both, margin: float) -> Change:
    before, now = (median(each) for each in both.costs)
    change = partial(Change, COST, before, now)
    if both.is_reproduced:
        return change(AS_BEFORE, _reproduced(both))
    if not np.isfinite(both.costs).any():
        return change(UNKNOWN, "no feasible answer, before and now")
    if both.count < FEWEST and not both.is_certain:
        return change(UNKNOWN, _few(both))
    relative = _relative(both.costs)
    if relative is None:
        return change(UNKNOWN, "not compared: the cost is about 0")
    low, high = median_interval(relative)
    return change(
        # A decrease by m / (1 + m) makes up for an increase by m.
        _verdict(low, high, margin, margin / (1 + margin)),
        _interval_words(low, high, "%", both),
    )


def _relative(costs: Array) -> Array | None:
    """Return changes relative to the cost; None if that is about 0.

    Args:
        costs: Costs before and now, shape (2, pairs).
    """
    old, new = costs
    finite = np.isfinite(old), np.isfinite(new)
    # Relative to the usual cost: single costs can be near 0.
    first = old[finite[0]] if finite[0].any() else new[finite[1]]
    sizes = np.abs(costs[np.isfinite(costs)])
    size = abs(median(first) or 0.0)
    if size <= SAME * float(sizes.max(initial=0.0)):
        return None
    found = np.where(finite[0] & ~finite[1], _FAR, 0.0)
    found = np.where(finite[1] & ~finite[0], -_FAR, found)
    both = finite[0] & finite[1]
    found[both] = (new[both] - old[both]) / size
    found[np.abs(found) <= SAME] = 0.0
    return found


def _seconds_change(both: _Both, margin: float, reason: str) -> Change:
    before, now = (row["seconds_p50"] for row in both.rows)
    change = partial(Change, SECONDS, before, now)
    if reason:
        return change(UNKNOWN, f"not compared: {reason}")
    if both.count < FEWEST:
        return change(UNKNOWN, _few(both))
    # Its logarithm below would be infinite.
    if not (both.seconds > 0).all():
        return change(UNKNOWN, "not compared: a run took no time")
    known = np.isfinite(both.seconds)
    logs = np.log(np.where(known, both.seconds, 1.0))
    # 1 if the run fails only now, -1 if it failed only before.
    lost = known[0] * 1.0 - known[1] * 1.0
    ratios = np.where(known.all(axis=0), logs[1] - logs[0], math.log(_FAR) * lost)
    low, high = (math.expm1(end) for end in median_interval(ratios))
    return change(
        _verdict(low, high, margin, margin / (1 + margin)),
        _interval_words(low, high, "%", both),
    )


def _reproduced(both: _Both) -> str:
    if both.is_certain:
        return "the same cost again"
    seeds = "the one seed" if both.count == 1 else f"all {both.count} seeds"
    return f"the same costs again in {seeds}"


def _few(both: _Both) -> str:
    return f"not compared: {too_few(both.count, 'seed', FEWEST)}"


def _interval_words(low: float, high: float, unit: str, both: _Both) -> str:
    if both.is_certain:
        return f"{_shown(high)} {unit}, one run each"
    return f"{_shown(low)} to {_shown(high)} {unit} in 90 % ({both.count} pairs)"


def _shown(part: float) -> str:
    if abs(part) >= _FAR / 10:
        return "beyond measure"
    return f"{100 * part:+.3g}"
