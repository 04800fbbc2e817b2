"""Forty problems of the other classes, counted from far away.

Positions from the middle of the Earth, clocks since 1970, temperatures in kelvin: the
states of a problem are x + o, with o in turn a thousand, 5.8 million and a thousand
million times the states' ordinary sizes, of either sign. Half of them move one state
only. Each is judged as the problem that it was.
"""

from dataclasses import replace

import numpy as np

from swarmstart.tests.adversary.case import Case
from swarmstart.tests.adversary.problems import (
    bang_bang,
    between_checks,
    box_constrained,
    linear_quadratic,
    multimodal,
    no_solution,
    nonsmooth,
    path_constrained,
)

KIND = "origins"
FAR = (1e3, 5.8e6, 1e9)
_SOURCES = (
    linear_quadratic,
    box_constrained,
    bang_bang,
    no_solution,
    nonsmooth,
    path_constrained,
    multimodal,
    between_checks,
)
_EACH = 5


def cases() -> list[Case]:
    """Return all cases of the class, the same on every call."""
    rng = np.random.default_rng(58)
    made: list[Case] = []
    for source in _SOURCES:
        own = source.cases()
        for number in rng.choice(len(own), _EACH, replace=False).tolist():
            made.append(_moved(own[number], len(made), rng))
    return made


def _moved(case: Case, number: int, rng: np.random.Generator) -> Case:
    """Return a case from another origin."""
    far = FAR[number % len(FAR)]
    origin = far * case.truth.sizes * rng.choice([-1.0, 1.0], case.truth.sizes.size)
    if number % 2:
        origin[np.arange(origin.size) != rng.integers(origin.size)] = 0.0
    name = f"{case.kind}: {case.name} from {far:g}"
    return replace(case, name=name, kind=KIND, origin=origin)
