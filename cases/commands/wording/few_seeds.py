"""The number of seeds that a comparison needs, told before it begins."""

from collections.abc import Sequence

from swarmstart.cases.campaign.judging.judgement import compared_pairs, fewest_seeds
from swarmstart.cases.campaign.studies.comparing import Contest
from swarmstart.cases.drawing.naming.quantities import plural


def too_few_seeds(contests: Sequence[Contest], seeds: int) -> str:
    """Return a sentence on seeds that are too few; empty if they are enough.

    Args:
        contests: The scenarios with their solvers.
        seeds: Number of seeds.
    """
    needed = max((_needed(contest, seeds) for contest in contests), default=0)
    if seeds >= needed:
        return ""
    return (
        f"{plural(seeds, 'seed')}: {needed} are needed before solvers are compared; "
        "this run shows costs only"
    )


def _needed(contest: Contest, seeds: int) -> int:
    """Return the number of seeds with which some pair of solvers can differ."""
    names = [entry.solver.name for entry in contest.entries]
    alone = [
        entry.solver.is_deterministic and not contest.is_seeded
        for entry in contest.entries
    ]
    pairs = compared_pairs(names, seeds) if names else []
    uncertain = sum(not (alone[i] and alone[j]) for i, j in pairs)
    return fewest_seeds(uncertain) if uncertain else 0
