"""Doors of rooms: public names that are imported when they are first used.

A room's `__init__.py` lists its names twice, for type checkers and by home, and a test
holds one list against the other:

    if TYPE_CHECKING:
        from swarmstart.room.module import Name as Name

    _NAMES = {"module": "Name another_name"}
    _HOMES, __getattr__, __dir__ = door(__name__, _NAMES)
    __all__ = list(_HOMES)
"""

import importlib
import sys
from collections.abc import Callable, Mapping
from typing import Any


def door(
    room: str, names: Mapping[str, str], *, within: str = "."
) -> tuple[dict[str, str], Callable[[str], Any], Callable[[], list[str]]]:
    """Return a room's table name -> module, its `__getattr__` and its `__dir__`.

    Args:
        room: Full name of the room.
        names: Name of a module -> its public names, separated by spaces.
        within: Prefix of the names of the modules; "." is the room itself.
    """
    homes = {name: home for home, its in names.items() for name in its.split()}

    def import_name(name: str) -> Any:
        """Import a public name when it is first used."""
        if name in homes:
            home = importlib.import_module(f"{within}{homes[name]}", room)
            return getattr(home, name)
        raise AttributeError(f"module {room!r} has no attribute {name!r}")

    def list_names() -> list[str]:
        """List the public names."""
        known = vars(sys.modules[room])
        return [*homes, *(name for name in known if name.startswith("__"))]

    return homes, import_name, list_names
