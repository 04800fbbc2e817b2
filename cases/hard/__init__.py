"""Hard problems: families of optimal-control problems with many optima by construction.

    from swarmstart.cases.hard import draw
    text = draw("walls", walls=4, gaps=2, seed=3)   # a problem in YAML

Those that are shipped are run by their names, such as `swarmstart run hard/walls_4`.
"""

from typing import TYPE_CHECKING

from swarmstart.doors import door

if TYPE_CHECKING:
    from swarmstart.cases.hard.draws import ImpossibleDrawError as ImpossibleDrawError
    from swarmstart.cases.hard.families import (
        FAMILIES as FAMILIES,
    )
    from swarmstart.cases.hard.families import (
        SHIPPED as SHIPPED,
    )
    from swarmstart.cases.hard.families import (
        draw as draw,
    )
    from swarmstart.cases.hard.families import (
        shipped_text as shipped_text,
    )

_NAMES = {
    "draws": "ImpossibleDrawError",
    "families": "FAMILIES SHIPPED draw shipped_text",
}
_HOMES, __getattr__, __dir__ = door(__name__, _NAMES)
__all__ = list(_HOMES)
