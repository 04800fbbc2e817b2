"""All cases, and a seeded choice of them."""

from collections.abc import Callable, Sequence

import numpy as np

from swarmstart.tests.adversary.case import Case
from swarmstart.tests.adversary.problems import (
    aliases,
    bang_bang,
    between_checks,
    box_constrained,
    free_end_time,
    linear_quadratic,
    multimodal,
    no_solution,
    nonsmooth,
    origins,
    overflow,
    path_constrained,
    stiff,
)

CLASSES: dict[str, Callable[[], list[Case]]] = {
    module.KIND: module.cases
    for module in (
        linear_quadratic,
        box_constrained,
        bang_bang,
        overflow,
        no_solution,
        nonsmooth,
        path_constrained,
        multimodal,
        between_checks,
        free_end_time,
        stiff,
        aliases,
        origins,
    )
}


def all_cases(kinds: Sequence[str] = tuple(CLASSES)) -> list[Case]:
    """Return all cases of some classes, in their own units; the same on every call.

    Args:
        kinds: Keys of CLASSES.
    """
    return [case for kind in kinds for case in CLASSES[kind]()]


def chosen(
    cases: Sequence[Case], count: int, *, rng: np.random.Generator
) -> list[Case]:
    """Return so many of the cases, of each class in turn.

    Args:
        cases: To choose from.
        count: How many; all of them if there are fewer.
        rng: Source of all randomness.
    """
    shuffled = [cases[int(index)] for index in rng.permutation(len(cases))]
    seen: dict[str, int] = {}
    turns = []
    for case in shuffled:
        turns.append(seen.setdefault(case.kind, 0))
        seen[case.kind] += 1
    order = sorted(range(len(shuffled)), key=lambda index: turns[index])
    return [shuffled[index] for index in order[:count]]
