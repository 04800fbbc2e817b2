"""Bounds that depend on parameters, signals and time, as path constraints.

    lower(p, s, t) <= x   ->   x - lower >= 0,        x <= upper   ->   x - upper <= 0

A bound that is a number stays a bound.
"""

import casadi as ca
import numpy as np

from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import as_column, require_known
from swarmstart.ocp.common.limits import Limit
from swarmstart.ocp.system.constraints import MovingLimit, PathConstraint

MOVING = "moving bounds of the "
"""Name of the path constraint of moving bounds, followed by "controls" or "states"."""
Limits = tuple[Limit, Limit]


def fixed_and_moving(
    role: str,
    limits: tuple[MovingLimit, MovingLimit] | None,
    symbols: ca.SX,
    known: dict[str, ca.SX],
) -> tuple[Limits, list[PathConstraint]]:
    """Split bounds into numbers and a path constraint for the others, if any.

    Args:
        role: "controls" or "states".
        limits: (lower, upper), each a number, an expression, or one of these for each
            symbol; None: no bounds.
        symbols: The bounded symbols, shape (n, 1).
        known: Columns of symbols that bounds may depend on, by their names in messages.

    Raises:
        InvalidProblemError: If a bound depends on other symbols, or their number is not
            that of the bounded symbols.
    """
    if limits is None:
        return (-np.inf, np.inf), []
    if not isinstance(limits, tuple | list) or not any(map(_is_moving, limits)):
        return limits, []  # type: ignore[return-value] # Checked as numbers.
    numbers, rows, sides = [], [], []
    for given, none, side in zip(limits, (-np.inf, np.inf), (1, -1), strict=True):
        column = _column(role, given, int(symbols.numel()))
        require_known(f"bounds of the {role}", column, known)
        fixed = np.full(column.numel(), none)
        for i in range(column.numel()):
            if column[i].is_constant():
                fixed[i] = float(column[i])
            else:
                rows.append(symbols[i] - column[i])
                sides.append(side)
        numbers.append(fixed)
    upward = np.array(sides) > 0
    constraint = PathConstraint(
        expression=ca.vertcat(*rows),
        lower=np.where(upward, 0.0, -np.inf),
        upper=np.where(upward, np.inf, 0.0),
        name=f"{MOVING}{role}",
    )
    return (numbers[0], numbers[1]), [constraint]


def _is_moving(limit: object) -> bool:
    """Return whether a limit is or contains an expression."""
    if isinstance(limit, ca.SX):
        return True
    several = limit if isinstance(limit, tuple | list) else ()
    return any(isinstance(one, ca.SX) for one in several)


def _column(role: str, given: object, size: int) -> ca.SX:
    """Return limits as a column of a given size."""
    column = as_column(f"bounds of the {role}", given)  # type: ignore[arg-type]
    if column.numel() not in (1, size):
        raise InvalidProblemError(
            f"bounds of the {role} must be one or {size} of them, got {column.numel()}"
        )
    return ca.vertcat(*[column] * (size // column.numel()))
