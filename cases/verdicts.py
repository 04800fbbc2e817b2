"""What several runs say of a claim."""

import statistics
from collections.abc import Sequence
from enum import StrEnum

import numpy as np

from swarmstart.cases.claims import holds
from swarmstart.cases.kind import Measure
from swarmstart.cases.statistics import LEVEL, fewest_pairs, signed_rank_p, too_few

MOST_RATIO = 1e6
"""Where one run of a pair never settles, say, the ratio is taken as this."""


class Verdict(StrEnum):
    """What is said of a claim, or of a part of it."""

    HOLDS = "holds"
    IN_PART = "in part"
    FAILS = "does not hold"
    NO_DIFFERENCE = "no difference shown"
    NOT_SHOWN = "not shown"
    NOT_JUDGED = "not judged"


def verdict_of_seeds(
    values: Sequence[Measure], relation: str, bound: float | None, *, share: float = 1.0
) -> Verdict:
    """Return what the runs say: whether enough of them are in the relation.

    Args:
        values: The measure of each seed.
        relation: A key of `claims.RELATIONS`.
        bound: The bound; None: not defined.
        share: Part of the seeds that must be.
    """
    kept = sum(bool(holds(value, relation, bound)) for value in values)
    if kept >= share * len(values):
        return Verdict.HOLDS
    return Verdict.IN_PART if kept else Verdict.FAILS


def paired_verdict(
    ratios: Sequence[float], relation: str, bound: float | None
) -> tuple[Verdict, str]:
    """Return what pairs of runs say, and the test.

    A difference must show in a signed-rank test before the median ratio is compared: of
    the ratios' logarithms, so that half and double weigh the same, or where a measure
    changes its sign of the ratios less 1.

    Args:
        ratios: Of the pairs.
        relation: A key of `claims.RELATIONS`.
        bound: The bound of the ratio.
    """
    fewest = fewest_pairs()
    if len(ratios) < fewest:
        return Verdict.NOT_JUDGED, too_few(len(ratios), "pair", fewest)
    values = np.clip(ratios, -MOST_RATIO, MOST_RATIO)
    if (values >= 0).all():
        differences = np.log(np.maximum(values, 1 / MOST_RATIO))
    else:
        differences = values - 1.0
    p = signed_rank_p(differences.tolist())
    test = f"{len(ratios)} pairs, Wilcoxon p = {p:.2g}"
    if p > LEVEL:
        return Verdict.NO_DIFFERENCE, test
    kept = holds(statistics.median(ratios), relation, bound)
    return Verdict.HOLDS if kept else Verdict.FAILS, test


def verdict_of_parts(parts: Sequence[Verdict]) -> Verdict:
    """Return what the parts of a claim say together.

    Nothing as long as a part could not be judged; of different answers, "in part" where
    any part holds, at least in part; else "does not hold" where any does not.
    """
    if Verdict.NOT_JUDGED in parts:
        return Verdict.NOT_JUDGED
    judged = set(parts)
    if len(judged) == 1:
        return parts[0]
    some = {Verdict.HOLDS, Verdict.IN_PART} & judged
    if some:
        return Verdict.IN_PART
    return Verdict.FAILS if Verdict.FAILS in judged else Verdict.NO_DIFFERENCE
