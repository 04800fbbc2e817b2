"""Conversion of multipliers to arrays without pickle, and back.

Arrays of an answer, or of the first plan of a run:

    multipliers_costates, _controls, _states       as in Multipliers
    multipliers_path_K, multipliers_terminal_K     of constraint K, with the names:
    multipliers_path_names, multipliers_terminal_names
    multipliers_decided, multipliers_decided_names

Arrays of the last plans of an interrupted run, used to start its next plans:

    dual_steps, dual_rows, dual_bounds

The arrays `dual_...` are kept for two steps: the last one, and the last one that the
mark (partial.json) counts, since a new mark is written after the arrays.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp import Plan, Step, Trajectory
from swarmstart.ocp.nlp import Duals, Multipliers, duals_of

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
    """Return multipliers as plain data, those of path constraints summed over time."""
    if multipliers is None:
        return None
    return {
        "path": {n: one.sum(axis=1).tolist() for n, one in multipliers.path.items()},
        "terminal": {n: one.tolist() for n, one in multipliers.terminal.items()},
        "decided": dict(multipliers.decided),
    }


def _names(of: Mapping[str, object]) -> NDArray[Any]:
    # Without the type an empty list would become floats.
    return np.array(list(of), dtype=np.str_)


def dual_arrays(trajectory: Trajectory, finished: int) -> dict[str, NDArray[Any]]:
    """Return the multipliers of the plans of two steps as arrays, padded with NaN.

    The two are the last step that the mark counts, and the last step of all.

    Args:
        trajectory: The finished steps.
        finished: Number of steps in the mark (partial.json); 0 if there is no mark.
    """
    count = len(trajectory.decisions)
    numbers = sorted({n - 1 for n in (finished, count) if 0 < n <= count})
    kept = [
        [_duals(plan) for plan in trajectory.decisions[number].plans]
        for number in numbers
    ]
    if not any(one is not None for row in kept for one in row):
        return {}
    return {
        "dual_steps": np.array(numbers),
        "dual_rows": _padded(kept, "rows"),
        "dual_bounds": _padded(kept, "bounds"),
    }


def with_duals(steps: list[Step], arrays: Mapping[str, NDArray[Any]]) -> list[Step]:
    """Return the steps; the plans of the last one get the multipliers in `arrays`."""
    if not steps or "dual_steps" not in arrays:
        return steps
    found = np.flatnonzero(arrays["dual_steps"] == len(steps) - 1)
    if not found.size:
        return steps
    rows, bounds = (arrays[name][found[0]] for name in ("dual_rows", "dual_bounds"))
    decision = steps[-1].decision
    is_new = arrays["plan_is_new"][len(steps) - 1]  # Other plans stay as they are.
    plans = tuple(
        replace(plan, duals=_unpadded(*both)) if new else plan
        for plan, new, *both in zip(decision.plans, is_new, rows, bounds, strict=True)
    )
    last = replace(steps[-1], decision=replace(decision, plans=plans))
    return [*steps[:-1], last]


def _duals(plan: Plan) -> Duals | None:
    # A plan that was read from a record has multipliers, but no point of an NLP.
    return plan.duals if plan.point is None else duals_of(plan.point)


def _padded(kept: Sequence[Sequence[Duals | None]], name: str) -> Array:
    """Return multipliers of plans, shape (steps, agents, most)."""
    none = np.empty(0)
    every = [[none if d is None else getattr(d, name) for d in row] for row in kept]
    most = max(values.size for row in every for values in row)
    found = np.full((len(every), len(every[0]), most), np.nan)
    for k, row in enumerate(every):
        for agent, values in enumerate(row):
            found[k, agent, : values.size] = values
    return found


def _unpadded(rows: Array, bounds: Array) -> Duals | None:
    """Return multipliers without the NaN at their ends; None if none were kept."""
    values = [one[~np.isnan(one)] for one in (rows, bounds)]
    # Bounds of variables are never empty; rows can be.
    return Duals(*values) if values[1].size else None
