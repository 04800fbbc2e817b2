"""What several runs say of a claim."""

import statistics
from collections.abc import Sequence
from enum import StrEnum

from swarmstart.cases.claims import holds
from swarmstart.cases.kind import Measure
from swarmstart.cases.statistics import FEWEST_PAIRS, LEVEL, signed_rank_p, too_few


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

    A difference must show in a signed-rank test before the median ratio is compared.

    Args:
        ratios: Of the pairs.
        relation: A key of `claims.RELATIONS`.
        bound: The bound of the ratio.
    """
    if len(ratios) < FEWEST_PAIRS:
        return Verdict.NOT_JUDGED, too_few(len(ratios), "pair", FEWEST_PAIRS)
    p = signed_rank_p([ratio - 1.0 for ratio in ratios])
    test = f"{len(ratios)} pairs, Wilcoxon p = {p:.2g}"
    if p > LEVEL:
        return Verdict.NO_DIFFERENCE, test
    kept = holds(statistics.median(ratios), relation, bound)
    return Verdict.HOLDS if kept else Verdict.FAILS, test


def verdict_of_parts(parts: Sequence[Verdict]) -> Verdict:
    """Return what the parts of a claim say together.

    Nothing as long as a part could not be judged; of different answers, "in part" where
    any part holds, at least in part.
    """
    if Verdict.NOT_JUDGED in parts:
        return Verdict.NOT_JUDGED
    judged = set(parts)
    if len(judged) == 1:
        return parts[0]
    some = {Verdict.HOLDS, Verdict.IN_PART} & judged
    return Verdict.IN_PART if some else Verdict.FAILS
