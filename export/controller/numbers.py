"""Constants that the C file and the same controller in Python (`twin.py`) share."""

from enum import IntEnum

FIRST_MU, WARM_MU = 1e-2, 1e-6
"""First parameter of the central path from a seeded start, and from a shifted plan."""
CLOSE = 1e-6
"""Part of a plan's size by which a local optimum may cost more than the shifted plan
and still replace it."""
LITTLE = {"double": 1e-6, "single": 1e-3}
"""Part of the noise of a cost below which a shifted plan has nothing to gain."""
TURNS = 2
"""Largest number of trials of a local solve, for each of its steps."""


class Status(IntEnum):
    """Origin of the control of a step."""

    PLANNED = 0
    """The first control of a local optimum, found from the shifted last plan."""
    LINEAR = 1
    """The linear law, inside the terminal set."""
    SEARCHED = 2
    """The first control of the best answer from a seeded start."""
    SHIFTED = 3
    """The first control of the shifted last plan: nothing better was found."""
    INVALID = 4
    """The first control of the shifted last plan: an input was not finite."""
