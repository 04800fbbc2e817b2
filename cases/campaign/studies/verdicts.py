"""Verdict on a claim by several runs."""

import math
import statistics
from collections.abc import Sequence
from enum import StrEnum

import numpy as np

from swarmstart.cases.campaign.judging.statistics import (
    LEVEL,
    fewest_pairs,
    signed_rank_p,
    too_few,
)
from swarmstart.cases.campaign.running.claims import holds
from swarmstart.cases.format.kind import NEVER, Measure

MOST_RATIO = 1e6
"""Ratio of a pair if, for example, one of its runs never settles."""


class Verdict(StrEnum):
    """Verdict on a claim, or on a part of it."""

    HOLDS = "holds"
    IN_PART = "in part"
    FAILS = "does not hold"
    NO_DIFFERENCE = "no difference shown"
    NOT_SHOWN = "not shown"
    NOT_JUDGED = "not judged"
    BESIDE = "shown beside"
    MET = "an assumption, met here"
    UNMET = "an assumption, not met here"


def verdict_of_seeds(
    values: Sequence[Measure],
    relation: str,
    bound: float | None,
    *,
    width: float = 0.0,
    share: float = 1.0,
    reason: str = "",
) -> tuple[Verdict, str]:
    """Return the verdict of runs on a claim, and how many runs support the claim.

    Args:
        values: Value of the measure for each seed.
        relation: A key of `claims.RELATIONS`.
        bound: The bound; None means "not defined".
        width: With "==", the largest difference from the bound that counts as equal.
        share: Part of the seeds in which the relation must hold.
        reason: Reason why a measure can be undefined, as in `claims.holds`.

    Returns:
        The verdict, and words on it: the number of supporting runs, or the reason why
        the claim is not judged. The words are empty if all runs support the claim, or
        none does.
    """
    found = [
        holds(value, relation, bound, width=width, reason=reason) for value in values
    ]
    if None in found:
        return Verdict.NOT_JUDGED, f"not defined: {reason}"
    kept = found.count(True)
    of = f"{kept} of {len(found)} runs" if 0 < kept < len(found) else ""
    if kept >= share * len(values):
        return Verdict.HOLDS, of
    return (Verdict.IN_PART if kept else Verdict.FAILS), of


def paired_verdict(
    ratios: Sequence[float], relation: str, bound: float | None
) -> tuple[Verdict, str]:
    """Return the verdict of pairs of runs on a claim, and the test in words.

    A signed-rank test must show a difference before the median ratio is compared. It
    tests the logarithms of the ratios, so that half and double have equal weight, or
    the ratios minus 1 if a measure changes its sign. With too few pairs the claim is
    not judged, and the words give the reason.

    Args:
        ratios: Ratios of the pairs.
        relation: A key of `claims.RELATIONS`.
        bound: The bound of the ratio.
    """
    fewest = fewest_pairs()
    if len(ratios) < fewest:
        return Verdict.NOT_JUDGED, too_few(len(ratios), "pair", fewest)
    values = np.clip(ratios, -MOST_RATIO, MOST_RATIO)
    if (values >= 0).all():
        # A ratio of 0 counts like the inverse of the largest one.
        differences = np.log(np.maximum(values, 1 / MOST_RATIO))
    else:
        differences = values - 1.0
    p = signed_rank_p(differences.tolist())
    test = f"{len(ratios)} pairs, Wilcoxon p = {p:.2g}"
    if p > LEVEL:
        return Verdict.NO_DIFFERENCE, test
    kept = holds(statistics.median(ratios), relation, bound)
    return Verdict.HOLDS if kept else Verdict.FAILS, test


def median_of(values: Sequence[Measure], *, reason: str) -> float | None:
    """Return the median over the seeds; None if a measure is not defined.

    Args:
        values: Value of the measure for each seed.
        reason: Reason why a measure can be undefined; with NEVER it counts as infinite.
    """
    # What never happens is later than anything, so it has a place in the order.
    known = [math.inf if v is None and reason == NEVER else v for v in values]
    numbers = [float(v) for v in known if isinstance(v, int | float)]
    return statistics.median(numbers) if len(numbers) == len(values) else None


def ratio(first: Measure, second: Measure, *, reason: str) -> float | None:
    """Return a run's measure divided by that of the run it is compared with.

    Args:
        first: The measure of the run.
        second: The measure of the other run; lists have no ratio.
        reason: Reason why a measure can be undefined; with NEVER it counts as infinite.

    Returns:
        The ratio. It is 1 if both are equal, even if they are 0 or infinite, and None
        if one is not defined.
    """
    both = []
    for value in (first, second):
        if isinstance(value, list) or (value is None and reason != NEVER):
            return None
        both.append(math.inf if value is None else float(value))
    above, below = both
    # Also 0 / 0 and inf / inf, which have no value.
    if above == below:
        return 1.0
    return above / below if below else math.copysign(math.inf, above)


def of_guarantee(verdict: Verdict, test: str) -> tuple[Verdict, str]:
    """Return the verdict of runs on a guarantee, which they can only refute."""
    if verdict is Verdict.HOLDS:
        return Verdict.NOT_SHOWN, "flights are examples, not a proof"
    if verdict is Verdict.IN_PART:
        return Verdict.FAILS, f"one exception refutes a guarantee; {test}"
    return verdict, test


def of_assumption(verdict: Verdict) -> Verdict:
    """Return the verdict on an assumption, which is no claim."""
    if verdict is Verdict.NOT_JUDGED:
        return verdict
    return Verdict.MET if verdict is Verdict.HOLDS else Verdict.UNMET


def verdict_of_parts(parts: Sequence[Verdict]) -> Verdict:
    """Return the verdict of all parts of a claim together.

    Parts with the verdict "shown beside" do not count. The claim is "not judged" if any
    other part is not judged. If verdicts differ, the claim holds "in part" if any part
    holds at least in part; else it "does not hold" if any part does not.
    """
    judged = set(parts) - {Verdict.BESIDE}
    if Verdict.NOT_JUDGED in judged or not judged:
        return Verdict.NOT_JUDGED
    if len(judged) == 1:
        return judged.pop()
    some = {Verdict.HOLDS, Verdict.IN_PART} & judged
    if some:
        return Verdict.IN_PART
    return Verdict.FAILS if Verdict.FAILS in judged else Verdict.NO_DIFFERENCE
