"""Bounds that hold at the checks, and are cut between them by the cheapest answer.

Few intervals, each seen at its end only: a thrown body that is caught before a wall,
and an oscillator under a ceiling. What is asked is that no answer is confirmed whose
path cuts the bound; with so few checks the cheapest mostly does, so that the class does
not count in the shares of what is solved.
"""

from dataclasses import replace

import numpy as np

from swarmstart.tests.adversary.case import Case
from swarmstart.tests.adversary.drawing import last, symmetric_limits
from swarmstart.tests.adversary.exact.convex import UnsolvedError
from swarmstart.tests.adversary.exact.held_linear import End, Linear
from swarmstart.tests.adversary.linear_case import linear_case
from swarmstart.tests.adversary.problems.path_constrained import wall

KIND = "between_checks"
GENERATED = 28
MOST_TRIES = 400


def _ceiling(rng: np.random.Generator) -> Linear:
    """Draw an oscillator that would swing above its ceiling."""
    frequency, speed = rng.uniform(2.0, 4.0), rng.uniform(1.5, 2.5)
    height = speed / frequency * rng.uniform(0.5, 0.8)
    return Linear(
        A=np.array([[0.0, 1.0], [-(frequency**2), 0.0]]), B=last(2), R=np.eye(1),
        x0=np.array([0.0, speed]), horizon=2.0, intervals=int(rng.integers(4, 8)),
        controls=symmetric_limits(np.full(1, 30.0)),
        end=End(np.eye(2), np.zeros(2), np.zeros(2)),
        states=(np.full(2, -np.inf), np.array([height, np.inf])),
    )  # fmt: skip


def cases() -> list[Case]:
    """Return all cases of the class, the same on every call."""
    rng = np.random.default_rng(17)
    made: list[Case] = []
    for _ in range(MOST_TRIES):
        number = len(made)
        linear = _ceiling(rng) if number % 2 else wall(rng)
        linear = replace(linear, intervals=int(rng.integers(4, 8)))
        name = f"{'ceiling' if number % 2 else 'wall'} {number}"
        try:
            case = linear_case(KIND, name, linear, is_counted=False)
        except UnsolvedError:
            continue
        # Its optimum holds at many points of the path, but not at all of them.
        made.append(replace(case, best=None))
        if len(made) == GENERATED:
            break
    return made
