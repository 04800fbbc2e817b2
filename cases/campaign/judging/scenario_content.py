"""Results of solvers on one scenario, as plain data for tables and pages.

The best known cost is the least verified one here, or one given from elsewhere if that
is lower. A run that failed, that a limit of time has ended, or that has no feasible
answer counts in all numbers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.cases.campaign.judging.curves import Curves
from swarmstart.cases.campaign.judging.judgement import Finding, Pair, Results, judged
from swarmstart.cases.campaign.judging.running_time import (
    Courses,
    expected_running_time,
    reached,
)
from swarmstart.cases.campaign.judging.runs import (
    FIRST_ROUND_OFF,
    ROUND_OFF,
    About,
    Asked,
    Runs,
    is_false_success,
    number,
    plain,
)
from swarmstart.cases.campaign.judging.statistics import (
    SAME,
    median,
    quantile,
    wilson_interval,
)
from swarmstart.ocp import BoundKind, OptimalityGap


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Judged:
    """Runs of all solvers on one scenario, with their comparisons.

    Attributes:
        runs: Runs of each solver.
        best: The least known cost; infinite if no cost is known.
        bests: The least known cost of each seed, shape (seeds,): all the same, unless
            each seed is a problem of its own.
        limits: Costs up to which an answer is near the best, shape (2, seeds), one row
            for each distance in `Asked.near`.
        costs: Costs seed by seed, shape (solvers, seeds).
        pairs: Comparisons of pairs of solvers.
        is_seeded: Whether each seed is a problem of its own.
    """

    runs: tuple[Runs, ...]
    best: float
    bests: Array
    limits: Array
    costs: Array
    pairs: tuple[Pair, ...]
    is_seeded: bool = False

    def near(self, runs: Runs, which: int) -> NDArray[np.bool_]:
        """Return whether each run of a solver ends near the best.

        Args:
            runs: Runs of the solver.
            which: Index of the distance in `Asked.near`.
        """
        limits = self.limits[which, : len(runs.costs)]
        return np.isfinite(limits) & (runs.costs <= limits)

    def times_to(self, runs: Runs, courses: Courses, which: int) -> Array:
        """Return the effort of each run to come near the best; infinite if never.

        If each seed is a problem of its own, the effort of a whole run is returned for
        each run that ends near the best.
        """
        if self.is_seeded:
            return np.where(self.near(runs, which), courses.ends, np.inf)
        limits = self.limits[which : which + 1, 0]
        if not math.isfinite(limits[0]):
            return np.full(len(runs.costs), np.inf)
        spent = reached(courses, limits)[:, 0]
        return np.where(np.isnan(spent), np.inf, spent)


def judged_scenario(
    runs: Sequence[Runs],
    asked: Asked,
    *,
    known_cost: float | None = None,
    judges_seconds: bool = False,
    is_seeded: bool = False,
) -> Judged:
    """Return the runs of solvers on one scenario with their comparisons.

    Args:
        runs: Runs of each solver; the others are compared with the first.
        asked: Settings of the comparison.
        known_cost: Best known cost from elsewhere.
        judges_seconds: Whether seconds are compared.
        is_seeded: Whether each seed is a problem of its own.
    """
    seeds = len(asked.seeds)
    costs = np.array([one.for_seeds(one.costs, seeds) for one in runs])
    best = min(float(costs.min(initial=math.inf)), _given(known_cost))
    bests = costs.min(axis=0) if is_seeded else np.full(seeds, best)
    slack = slack_of(runs, costs)
    # Else round-off would decide which solver is the best, and the tests.
    costs = np.where(costs <= bests + slack, bests, costs)
    limits = np.array(
        [bests + np.maximum(near * np.abs(bests), slack) for near in asked.near]
    )
    seconds = np.array([one.for_seeds(one.clock, seeds) for one in runs])
    pairs = judged(
        Results(
            names=tuple(one.name for one in runs),
            deterministic=tuple(one.is_deterministic for one in runs),
            costs=costs,
            near=np.isfinite(costs) & (costs <= limits[0]),
            seconds=seconds if judges_seconds else None,
            near_words=asked.near_words,
            sense=sense_of(runs),
        )
    )
    return Judged(
        runs=tuple(runs),
        best=best,
        bests=bests,
        limits=limits,
        costs=costs,
        pairs=tuple(pairs),
        is_seeded=is_seeded,
    )


def slack_of(runs: Sequence[Runs], costs: Array) -> float:
    """Return the difference of costs that counts as round-off.

    If the best cost is about 0, costs differ by round-off of the terms in their sum.
    The size of these terms is not known from the answers, but from the first costs of
    the histories.

    Args:
        runs: Runs of each solver.
        costs: Verified costs, infinite if infeasible.
    """
    finite = np.abs(costs[np.isfinite(costs)])
    first = [one.evaluations.first_costs() for one in runs]
    known = np.abs(np.concatenate([[0.0], *first]))
    usual = float(np.median(known[known > 0])) if (known > 0).any() else 0.0
    return max(ROUND_OFF * float(finite.max(initial=0.0)), FIRST_ROUND_OFF * usual)


def _given(cost: float | None) -> float:
    return cost if cost is not None and math.isfinite(cost) else math.inf


def sense_of(runs: Sequence[Runs]) -> int:
    """Return -1 if the user maximises, else 1."""
    # Failed runs have no sense, and take that of the others.
    senses = {result.get("sense", 1) for one in runs for result in one.results}
    return -1 if -1 in senses else 1


def scenario_content(
    name: str, found: Judged, asked: Asked, about: About, *, rng: np.random.Generator
) -> dict[str, Any]:
    """Return the results of solvers on one scenario."""
    best = found.best if math.isfinite(found.best) else None
    winner = _winner(found)
    curves = Curves.of(found.runs, found.best, found.limits[:, 0], asked, rng)
    against_first = {p.a: p for p in found.pairs if p.b == found.runs[0].name}
    return {
        "name": name,
        "title": about.title,
        "kind": about.kind,
        "variant": about.variant,
        "of": about.of or _first(found, "of") or "plan",
        "sense": sense_of(found.runs),
        "best_cost": best,
        "bests": plain(found.bests) if found.is_seeded else None,
        "best_by": winner[0].name if winner else None,
        "known_cost": about.known_cost,
        "known_from": about.known_from,
        "bound": _bound(about.bound, best, asked, sense_of(found.runs)),
        "rows": [
            _row(runs, found, asked, curves, against_first.get(runs.name))
            for runs in found.runs
        ],
        "pairs": [_pair(pair) for pair in found.pairs],
        "answer": _answer(winner),
    }


def _bound(
    given: Mapping[str, Any] | None, best: float | None, asked: Asked, sense: int
) -> dict[str, Any] | None:
    """Return the lower bound of the cost, compared with the best known cost."""
    if given is None:
        return None
    value = given["value"]
    size = max(abs(value or 0.0), abs(best or 0.0))
    beside = OptimalityGap(
        kind=BoundKind(given["kind"]),
        value=None if value is None else sense * value,
        reason=str(given.get("reason", "")),
        sense=sense,
        cost=None if best is None else sense * best,
        tolerance=asked.near[1] * size,
    )
    return {**given, "gap": beside.gap, "words": beside.told("the best known")}


def _first(found: Judged, key: str) -> Any:
    values = (r.get(key) for runs in found.runs for r in runs.results)
    return next((value for value in values if value), None)


def _winner(found: Judged) -> tuple[Runs, int] | None:
    """Return solver and run of the best known cost; None if it is from elsewhere.

    Of solvers whose costs agree to 1e-6 the first one counts.
    """
    if not math.isfinite(found.best):
        return None
    enough = found.best + SAME * abs(found.best)
    for runs in found.runs:
        if float(runs.costs.min(initial=math.inf)) <= enough:
            return runs, int(runs.costs.argmin())
    return None


def _answer(winner: tuple[Runs, int] | None) -> dict[str, Any] | None:
    if winner is None:
        return None
    runs, place = winner
    plan = runs.results[place].get("plan")
    if plan is None:
        return None
    return {"solver": runs.name, "seed": runs.seeds[place], "plan": plan}


def _row(
    runs: Runs, found: Judged, asked: Asked, curves: Curves, pair: Pair | None
) -> dict[str, Any]:
    """Return the results of one solver."""
    costs, alone = runs.costs, runs.is_deterministic
    near = [int(found.near(runs, k).sum()) for k in range(len(asked.near))]
    seconds, counts = runs.seconds.ends, runs.evaluations.ends
    claimed = np.array([number(r.get("claimed_cost")) for r in runs.results])
    word = np.array([bool(r.get("claimed_feasible")) for r in runs.results])
    wrong = [is_false_success(r, asked.near[0]) for r in runs.results]
    return {
        "solver": runs.name,
        "deterministic": alone,
        "settings": runs.entry.settings_key,
        "runs": len(costs),
        "failed": [one.failure for one in runs.outcomes if one.failure],
        "cut": sum(bool(getattr(one, "was_cut", False)) for one in runs.outcomes),
        "feasible": int(np.isfinite(costs).sum()),
        "claimed_feasible": int(word.sum()),
        "false_successes": sum(map(bool, wrong)),
        "near": near,
        # A run without chance has a result, and no rate.
        "near_intervals": None
        if alone
        else [list(wilson_interval(count, len(costs))) for count in near],
        "costs": plain(costs),
        "gaps": plain(_gaps(costs, found.bests[: len(costs)])),
        "claimed": plain(claimed),
        "seconds": plain(runs.clock),
        "build_seconds": [_or_none(r, "build_seconds") for r in runs.results],
        "compile_seconds": [_or_none(r, "compile_seconds") for r in runs.results],
        # A failed run has a number only for the running times: its budget.
        "evaluations": plain(np.where(runs.has_answer, counts, np.nan)),
        "seconds_p50": quantile(runs.clock, 0.5),
        "seconds_p99": quantile(runs.clock, 0.99),
        "evaluations_median": median(counts[runs.has_answer & np.isfinite(counts)]),
        "ert_evaluations": _ert(found, runs, runs.evaluations),
        "ert_seconds": _ert(found, runs, runs.seconds) if np.isfinite(seconds).any()
        else [None] * len(found.limits),
        "against_first": _against(pair),
        "history": curves.history(runs),
        "ecdf": curves.ecdf(runs),
        "measures": _measures(runs),
        "step_seconds": _step_seconds(runs),
    }  # fmt: skip


def _or_none(result: Mapping[str, Any], key: str) -> float | None:
    value = number(result.get(key))
    return value if math.isfinite(value) else None


def _gaps(costs: Array, bests: Array) -> Array:
    """Return relative distances from the best known; NaN without one."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        off = costs - bests
        # A best cost of 0 that is met: the distance is 0, not 0 / 0.
        relative: Array = np.where(off == 0, 0.0, off / np.abs(bests))
    return np.where(np.isfinite(bests), relative, np.nan)


def _ert(found: Judged, runs: Runs, courses: Courses) -> list[float | None]:
    """Return the expected running times to the costs that are near the best."""
    times = [
        expected_running_time(found.times_to(runs, courses, which), courses.ends)
        for which in range(len(found.limits))
    ]
    return [None if t is None or not math.isfinite(t) else t for t in times]


def _against(pair: Pair | None) -> dict[str, Any]:
    if pair is None:
        none = {"words": "", "p": None, "effect": None, "shift": None, "verdict": ""}
        return {**none, "success": None, "seconds": None}
    content = _pair(pair)
    return {
        "words": pair.cost.words,
        **{key: content[key] for key in ("p", "effect", "shift", "verdict")},
        "success": content["success"],
        "seconds": content["seconds"],
    }


def _pair(pair: Pair) -> dict[str, Any]:
    return {
        "a": pair.a,
        "b": pair.b,
        "p": pair.cost.p,
        "p_alone": pair.cost.p_alone,
        "differing": pair.cost.pairs,
        "effect": pair.effect,
        "shift": pair.shift,
        "verdict": pair.cost.verdict,
        "words": pair.cost.words,
        "success": _finding(pair.success),
        "seconds": None if pair.seconds is None else _finding(pair.seconds),
    }


def _finding(finding: Finding) -> dict[str, Any]:
    content = asdict(finding)
    return {**content, "differing": content.pop("pairs")}


def _measures(runs: Runs) -> dict[str, dict[str, Any]]:
    """Return lowest, median and highest of each measure of closed-loop runs.

    Each entry of a list is a measure of its own, counted from 1.
    """
    found: dict[str, list[float]] = {}
    for place, result in enumerate(runs.results):
        for name, value in (result.get("measures") or {}).items():
            several = isinstance(value, list | tuple)
            for k, one in enumerate(value if several else [value], 1):
                own = f"{name} {k}" if several else name
                found.setdefault(own, [math.nan] * len(runs.results))
                found[own][place] = number(one)
    content = {}
    for name, values in found.items():
        known = np.array([value for value in values if math.isfinite(value)])
        content[name] = {
            "low": float(known.min()) if len(known) else None,
            "median": median(known),
            "high": float(known.max()) if len(known) else None,
            "undefined": len(values) - len(known),
        }
    return content


def _step_seconds(runs: Runs) -> dict[str, float | None] | None:
    """Return the time of a step: the median of P50, else the worst of the runs."""
    every = [r["step_seconds"] for r in runs.results if r.get("step_seconds")]
    if not every:
        return None
    known = {
        key: [v for v in (number(one.get(key)) for one in every) if math.isfinite(v)]
        for key in ("p50", "p99", "max", "dt")
    }
    return {
        key: (median(values) if key == "p50" else max(values, default=None))
        for key, values in known.items()
    }
