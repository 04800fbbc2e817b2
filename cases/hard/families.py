"""Families of hard problems, and the draws of them that are shipped.

Each shipped file is the text that `draw` once returned. It is stored, and not drawn
again, since the numbers that NumPy draws from a seed may change with its version.
"""

import inspect
from collections.abc import Callable, Mapping
from typing import Any

import yaml

from swarmstart.arguments import a_count
from swarmstart.cases.format.document import counted
from swarmstart.cases.hard.arms import arms
from swarmstart.cases.hard.crossing import crossing
from swarmstart.cases.hard.currents import currents
from swarmstart.cases.hard.discs import discs
from swarmstart.cases.hard.draws import Mapped
from swarmstart.cases.hard.gears import gears
from swarmstart.cases.hard.reorientation import reorientation
from swarmstart.cases.hard.swing_up import swing_up
from swarmstart.cases.hard.walls import walls
from swarmstart.errors import InvalidArgumentError

FAMILIES: dict[str, Callable[..., Mapped]] = {
    "walls": walls,
    "discs": discs,
    "swing_up": swing_up,
    "currents": currents,
    "crossing": crossing,
    "arms": arms,
    "reorientation": reorientation,
    "gears": gears,
}
"""Name of a family -> its function of sizes and seed, which returns a document."""
Draw = tuple[str, Mapping[str, int], int]
"""A family, its sizes and a seed."""
MOST = 100
"""Largest size."""

SHIPPED: dict[str, Draw] = {
    **{f"walls_{n}": ("walls", {"walls": n, "gaps": 2}, 1) for n in (2, 4, 6, 8)},
    **{f"discs_{n}": ("discs", {"discs": n}, 1) for n in (8, 16, 30)},
    **{f"swing_up_{n}": ("swing_up", {"percent": n}, 1) for n in (30, 20, 10)},
    **{f"currents_{n}": ("currents", {"vortices": n}, 1) for n in (4, 8, 16)},
    **{f"crossing_{n}": ("crossing", {"vehicles": n}, 1) for n in (2, 4, 6, 8)},
    **{f"arms_{n}": ("arms", {"links": n, "discs": 3}, 1) for n in (2, 3, 4)},
    **{f"reorientation_{n}": ("reorientation", {"cones": n}, 1) for n in (1, 2, 4)},
    **{f"gears_{n}": ("gears", {"intervals": n}, 1) for n in (6, 8, 10)},
}
"""Name of a shipped problem, without `hard/` -> the draw."""


def draw(family: str, *, seed: int, **sizes: int) -> str:
    """Return a problem of a family as YAML, to be saved and run.

    Args:
        family: A name of `FAMILIES`.
        seed: Seed of the draw; the same seed gives the same problem, with the same
            version of NumPy.
        sizes: Sizes of the family, from 1 to 100, such as walls=4, gaps=2.

    Returns:
        A document of `kind: problem`. Its title says the number of the draw: if a draw
        is impossible, the next one follows from the same stream of random numbers.

    Raises:
        InvalidArgumentError: If the family is unknown, or a size is missing, unknown
            or out of range.
        ImpossibleDrawError: If no draw of that size is possible.

    Example:
        >>> from swarmstart.cases.hard import draw
        >>> print(draw("walls", walls=4, gaps=2, seed=3).splitlines()[1])
        title: Cross 4 walls with 2 gaps each (draw 1 of seed 3)
    """
    if family not in FAMILIES:
        raise InvalidArgumentError("family", family, f"one of {', '.join(FAMILIES)}")
    function = FAMILIES[family]
    names = [name for name in inspect.signature(function).parameters if name != "seed"]
    if sizes.keys() != {*names}:
        wanted = f"the {counted(len(names), 'size')} {', '.join(names)} of {family}"
        raise InvalidArgumentError("sizes", sizes, wanted)
    for name, value, allowed in (
        ("seed", seed, a_count(most=2**63 - 1)),
        *((name, value, a_count(least=1, most=MOST)) for name, value in sizes.items()),
    ):
        if not allowed.accepts(value):
            raise InvalidArgumentError(name, value, allowed.allowed)
    return text_of(function(seed=int(seed), **sizes))


def shipped_text(name: str) -> str:
    """Draw a shipped problem again, and return it as YAML.

    Args:
        name: A name of `SHIPPED`.
    """
    family, sizes, seed = SHIPPED[name]
    return draw(family, seed=seed, **sizes)


def text_of(document: Mapping[str, Any]) -> str:
    """Return a document as YAML in which lists and small mappings take one line."""
    return yaml.safe_dump(
        dict(document), sort_keys=False, default_flow_style=None, width=100
    )
