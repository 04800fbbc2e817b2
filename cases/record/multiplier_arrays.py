"""Conversion of an answer's multipliers to arrays without pickle, and back.

multipliers_costates, _controls, _states       as in Multipliers
multipliers_path_K, multipliers_terminal_K     of constraint K, with the names:
multipliers_path_names, multipliers_terminal_names
multipliers_decided, multipliers_decided_names
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.nlp import Multipliers

PREFIX = "multipliers_"
_PLAIN = ("costates", "controls", "states")
_BY_NAME = ("path", "terminal")


def multiplier_arrays(multipliers: Multipliers | None) -> dict[str, NDArray[Any]]:
    """Return multipliers as arrays by name; empty if no solver has converged."""
    if multipliers is None:
        return {}
    arrays: dict[str, NDArray[Any]] = {
        f"{PREFIX}{name}": getattr(multipliers, name) for name in _PLAIN
    }
    for part in _BY_NAME:
        rows: Mapping[str, Array] = getattr(multipliers, part)
        arrays[f"{PREFIX}{part}_names"] = _names(rows)
        arrays |= {f"{PREFIX}{part}_{k}": one for k, one in enumerate(rows.values())}
    arrays[f"{PREFIX}decided_names"] = _names(multipliers.decided)
    values = list(multipliers.decided.values())
    arrays[f"{PREFIX}decided"] = np.array(values, dtype=np.float64)
    return arrays


def multipliers_from(arrays: Mapping[str, NDArray[Any]]) -> Multipliers | None:
    """Return the multipliers among arrays of a record; None if there are none."""
    if f"{PREFIX}costates" not in arrays:
        return None
    by_name = {
        part: {
            str(name): arrays[f"{PREFIX}{part}_{k}"]
            for k, name in enumerate(arrays[f"{PREFIX}{part}_names"])
        }
        for part in _BY_NAME
    }
    names, values = arrays[f"{PREFIX}decided_names"], arrays[f"{PREFIX}decided"]
    return Multipliers(
        costates=arrays[f"{PREFIX}costates"],
        controls=arrays[f"{PREFIX}controls"],
        states=arrays[f"{PREFIX}states"],
        path=by_name["path"],
        terminal=by_name["terminal"],
        decided={str(n): float(v) for n, v in zip(names, values, strict=True)},
    )


def told(multipliers: Multipliers | None) -> dict[str, Any] | None:
    """Return the multipliers for a summary: each row summed over the horizon."""
    if multipliers is None:
        return None
    return {
        "path": {n: one.sum(axis=1).tolist() for n, one in multipliers.path.items()},
        "terminal": {n: one.tolist() for n, one in multipliers.terminal.items()},
        "decided": dict(multipliers.decided),
    }


def _names(of: Mapping[str, object]) -> NDArray[Any]:
    return np.array(list(of), dtype=np.str_)
