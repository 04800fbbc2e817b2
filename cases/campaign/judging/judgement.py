"""Tests of pairs of solvers on one scenario.

Two solvers are compared in three ways, seed by seed:

    cost       is the one cheaper? Wilcoxon's signed-rank test; an answer that is not
               feasible is costlier than any feasible one
    success    does it come near the best known in more seeds? McNemar's exact test
    seconds    is it faster? The signed-rank test of logarithms; only if asked for

All p values of a scenario are adjusted together (Holm), so that the chance of any false
claim about the scenario stays below 5 percent: 4 percent for cost and success, 1
percent for seconds. The shares are fixed, so that claims about costs never depend on
the load of a machine.

Two deterministic solvers are compared without a test, since nothing is random. A
deterministic solver has one run, which counts for each seed of the other solver; its
seconds are not compared.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.cases.campaign.judging.statistics import (
    LEVEL,
    chances_of_less,
    fewest_pairs,
    holm_of_those_that_can,
    median,
    sign_ps,
    signed_rank_ps,
    too_few,
    with_ties,
)
from swarmstart.cases.campaign.trials.solver_names import NULL_HYPOTHESIS

Flags = NDArray[np.bool_]
SECONDS_SHARE = 0.2
"""Shares that kinds of tests have in the chance of a false claim."""
# 2^(1 - 6) = 0.03 is below LEVEL, and 2^(1 - 5) = 0.06 is not.
FEWEST_SEEDS = 6
ALL_PAIRS_FROM = 20
"""Number of seeds from which all pairs are compared.

With fewer only those with the first solver and with the null hypothesis are compared,
since more tests at once show less.
"""
CHEAPER, COSTLIER, SHOWN_NONE, NOT_COMPARED = (
    *("cheaper", "costlier"),
    *("no difference shown", "not compared"),
)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Results:
    """Results of the solvers of one scenario, seed by seed.

    Attributes:
        names: Names of the solvers.
        deterministic: For each solver whether it has only one run; then all entries of
            its rows are those of this run.
        costs: Verified costs, shape (solvers, seeds); infinite if infeasible.
        near: Whether the cost is near the best known, shape (solvers, seeds).
        seconds: Times, shape (solvers, seeds), infinite if a run has not ended; None if
            they are not compared.
        near_words: Distance that counts as near, such as "1 %".
        sense: -1 if the user maximises; then a lower cost is called better, not
            cheaper.
    """

    names: tuple[str, ...]
    deterministic: tuple[bool, ...]
    costs: Array
    near: Flags
    seconds: Array | None = None
    near_words: str = "1 %"
    sense: int = 1


@dataclass(frozen=True, kw_only=True, slots=True)
class Finding:
    """Result of one test.

    Attributes:
        verdict: "cheaper", "more", "faster", ..., "no difference shown", or "not
            compared".
        p: p value adjusted for all tests of the scenario; None if there was no test.
        p_alone: p value without adjustment.
        pairs: Number of seeds that differ.
        words: The result in words.
    """

    verdict: str
    p: float | None = None
    p_alone: float | None = None
    pairs: int = 0
    words: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Pair:
    """Comparison of one solver with another.

    Attributes:
        a: The first solver.
        b: The second solver: "cheaper" means that a is cheaper than b.
        cost: Result for the costs.
        success: Result for coming near the best known cost.
        seconds: Result for the time; None if seconds are not compared.
        effect: Probability that an answer of a is cheaper than one of b; ties count
            half.
        shift: Median over the seeds of (cost of a - cost of b) / |cost of b|; None if
            it is infinite or not defined.
    """

    a: str
    b: str
    cost: Finding
    success: Finding
    seconds: Finding | None
    effect: float
    shift: float | None


def compared_pairs(names: Sequence[str], seeds: int) -> list[tuple[int, int]]:
    """Return the pairs of solvers to compare, chosen before any result.

    Args:
        names: Names of the solvers. Each is compared with the first one and with the
            null hypothesis, which is IPOPT from random starts, if it is among them.
        seeds: Number of seeds; from ALL_PAIRS_FROM seeds on, all pairs are compared.
    """
    first = [(k, 0) for k in range(1, len(names))]
    null = names.index(NULL_HYPOTHESIS) if NULL_HYPOTHESIS in names else 0
    beside = [(k, null) for k in range(len(names)) if k != null]
    every = [(k, j) for j, k in itertools.combinations(range(len(names)), 2)]
    pairs = dict.fromkeys(first)
    for pair in (*beside, *(every if seeds >= ALL_PAIRS_FROM else ())):
        if pair not in pairs and pair[::-1] not in pairs:
            pairs[pair] = None
    return list(pairs)


def fewest_seeds(pairs: int) -> int:
    """Return the least number of seeds with which a difference can be shown.

    Args:
        pairs: Number of pairs of solvers that are tested together.
    """
    # Two tests for each pair, of costs and of successes.
    return max(FEWEST_SEEDS, fewest_pairs(2 * pairs / (1 - SECONDS_SHARE)))


def judged(results: Results) -> list[Pair]:
    """Return comparisons of pairs of solvers, those with the first solver first."""
    seeds = results.costs.shape[1]
    pairs = compared_pairs(results.names, seeds)
    if not pairs:
        return []
    uncertain = [
        (i, j)
        for i, j in pairs
        if not (results.deterministic[i] and results.deterministic[j])
    ]
    needed = fewest_seeds(len(uncertain))
    if seeds < needed:
        few = f"not compared: {too_few(seeds, 'seed', needed)}"
        tests = {pair: _not_tested(results, few) for pair in uncertain}
    else:
        tests = _tested(results, uncertain)
    costs = with_ties(results.costs)
    one, other = (costs[list(side)] for side in zip(*pairs, strict=True))
    effects = chances_of_less(one, other)
    found = []
    for (i, j), effect in zip(pairs, effects, strict=True):
        cost, success, seconds = tests.get((i, j)) or _certain(results, i, j)
        found.append(
            Pair(
                a=results.names[i],
                b=results.names[j],
                cost=cost,
                success=success,
                seconds=seconds,
                effect=float(effect),
                shift=_shift(costs[i], costs[j]),
            )
        )
    return found


Three = tuple[Finding, Finding, Finding | None]


def _not_tested(results: Results, words: str) -> Three:
    none = Finding(verdict=NOT_COMPARED, words=words)
    return none, none, None if results.seconds is None else none


def _certain(results: Results, i: int, j: int) -> Three:
    """Return the comparison of two deterministic solvers: that of their one run."""
    one, other = with_ties(results.costs[[i, j], :1])[:, 0]
    sign = 0 if one == other else (-1 if one < other else 1)
    verdict = {0: SHOWN_NONE, -1: CHEAPER, 1: COSTLIER}[sign]
    word = {0: "the same cost", -1: _word(results, -1), 1: _word(results, 1)}[sign]
    # Two infinite costs are equal too, but there is no cost to call the same.
    if not min(one, other) < math.inf:
        word = "both are not feasible"
    cost = Finding(
        verdict=verdict,
        words=f"{word} (both deterministic, one run each)",
    )
    more = int(results.near[i, 0]) - int(results.near[j, 0])
    success = Finding(
        verdict={0: SHOWN_NONE, 1: "more", -1: "fewer"}[more],
        words="both deterministic, one run each",
    )
    return cost, success, None


def _tested(
    results: Results, pairs: Sequence[tuple[int, int]]
) -> dict[tuple[int, int], Three]:
    """Return the results of a scenario's tests, adjusted together."""
    differences = _differences(results.costs, pairs)
    near = results.near
    gained = np.array([(near[i] & ~near[j]).sum() for i, j in pairs])
    lost = np.array([(near[j] & ~near[i]).sum() for i, j in pairs])
    costs, successes = signed_rank_ps(differences), sign_ps(gained, lost)
    counts = [*(differences != 0).sum(axis=1), *(gained + lost)]
    adjusted = holm_of_those_that_can(
        [*costs, *successes], counts, share=1 - SECONDS_SHARE
    )
    timed = _tested_seconds(results, pairs)
    found: dict[tuple[int, int], Three] = {}
    for number, pair in enumerate(pairs):
        ps = (adjusted[number], float(costs[number]))
        cost = _cost_finding(results, differences[number], *ps)
        ps = (adjusted[len(pairs) + number], float(successes[number]))
        success = _success_finding(results, pair, *ps)
        found[pair] = cost, success, timed.get(pair)
    return found


def _differences(costs: Array, pairs: Sequence[tuple[int, int]]) -> Array:
    """Return differences of costs, shape (pairs, seeds), 0 for equal costs.

    The difference of a feasible and an infeasible answer is twice the largest other
    one.
    """
    tied = with_ties(costs)
    feasible = np.isfinite(tied)
    plain = np.where(feasible, tied, 0.0)
    # Division by a power of two is exact, and keeps differences of huge costs finite.
    plain = np.ldexp(plain, -int(np.frexp(np.abs(plain).max(initial=1.0))[1]))
    rows = []
    for i, j in pairs:
        both = feasible[i] & feasible[j]
        own = np.where(both, plain[i] - plain[j], 0.0)
        largest = np.abs(own).max(initial=0.0)
        far = 2 * largest if largest > 0 else 1.0
        # Two infeasible answers are a tie: the difference stays 0.
        rows.append(own + far * (feasible[j] * 1.0 - feasible[i] * 1.0) * ~both)
    return np.array(rows).reshape(len(pairs), costs.shape[1])


def _tested_seconds(
    results: Results, pairs: Sequence[tuple[int, int]]
) -> dict[tuple[int, int], Finding]:
    """Return the results of the tests of seconds; none for a deterministic solver."""
    seconds = results.seconds
    if seconds is None:
        return {}
    sure = results.deterministic
    # One time repeated for every seed would be one measurement counted many times.
    chosen = [(i, j) for i, j in pairs if not sure[i] and not sure[j]]
    # A clock can measure 0 s.
    logs = np.where(np.isfinite(seconds), np.log(np.maximum(seconds, 1e-9)), np.inf)
    if not chosen:
        return {}
    differences = _differences(logs, chosen)
    p = signed_rank_ps(differences)
    counts = (differences != 0).sum(axis=1)
    adjusted = holm_of_those_that_can(list(p), list(counts), share=SECONDS_SHARE)
    found = {}
    for number, pair in enumerate(chosen):
        less, more = _counts(differences[number])
        counted = f"faster in {less}, slower in {more} of {seconds.shape[1]} seeds"
        verdict = SHOWN_NONE
        if adjusted[number] <= LEVEL:
            verdict = "faster" if _direction(differences[number]) < 0 else "slower"
        found[pair] = Finding(
            verdict=verdict,
            p=adjusted[number],
            p_alone=float(p[number]),
            pairs=int(counts[number]),
            words=f"{verdict} ({counted}, p = {adjusted[number]:.2g})",
        )
    return found


def _counts(differences: Array) -> tuple[int, int]:
    return int((differences < 0).sum()), int((differences > 0).sum())


def _direction(differences: Array) -> float:
    """Return the sum of signed ranks, whose sign is the direction of the test."""
    from scipy.stats import rankdata

    kept = differences[differences != 0]
    return float((np.sign(kept) * rankdata(np.abs(kept))).sum())


def _word(results: Results, direction: float) -> str:
    words = (CHEAPER, COSTLIER) if results.sense > 0 else ("better", "worse")
    return words[0] if direction < 0 else words[1]


def _cost_finding(
    results: Results, differences: Array, p: float, p_alone: float
) -> Finding:
    less, more = _counts(differences)
    counted = (
        f"{_word(results, -1)} in {less}, {_word(results, 1)} in {more} of "
        f"{len(differences)} seeds"
    )
    verdict = word = SHOWN_NONE
    if p <= LEVEL:
        direction = _direction(differences)
        verdict = CHEAPER if direction < 0 else COSTLIER
        word = _word(results, direction)
    return Finding(
        verdict=verdict,
        p=p,
        p_alone=p_alone,
        pairs=less + more,
        words=f"{word} ({counted}, p = {p:.2g})",
    )


def _success_finding(
    results: Results, pair: tuple[int, int], p: float, p_alone: float
) -> Finding:
    near = results.near[list(pair)]
    one, other = (int(count) for count in near.sum(axis=1))
    verdict = SHOWN_NONE
    if p <= LEVEL:
        verdict = "more" if one > other else "fewer"
    said = f"in {verdict} seeds" if p <= LEVEL else "no difference shown"
    return Finding(
        verdict=verdict,
        p=p,
        p_alone=p_alone,
        pairs=int((near[0] != near[1]).sum()),
        words=f"within {results.near_words} of the best known: {said} "
        f"({one} against {other} of {near.shape[1]}, p = {p:.2g})",
    )


def _shift(costs: Array, others: Array) -> float | None:
    """Return the median relative difference; None if it is not defined."""
    known = np.isfinite(costs) | np.isfinite(others)
    if not known.any() or (others[known] == 0).any():
        return None
    own, other = costs[known], others[known]
    with np.errstate(invalid="ignore", over="ignore"):
        # Infinitely better than an infeasible answer.
        relative = np.where(np.isfinite(other), (own - other) / np.abs(other), -np.inf)
    return median(relative)
