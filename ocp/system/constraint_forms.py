"""Forms in which users write constraints: relations, expressions, pairs.

x[0] <= 1        a relation
x[0] - 1         an expression alone, which must be zero
(x[0], 1)        at the end only: an expression and its value
"""

from typing import cast

import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import shortened
from swarmstart.ocp.system.constraints import (
    Constraint,
    PathConstraint,
    TerminalConstraint,
    limited,
)
from swarmstart.ocp.system.separation import Connection, Separation


def known_scales(constraint: Constraint) -> Array:
    """Return the scale of each row: as given, else the width of a range, else NaN."""
    if constraint.scale is not None:
        return np.asarray(constraint.scale, dtype=np.float64)
    rows = constraint.rows(constraint.expression)
    with np.errstate(invalid="ignore"):
        width = rows.upper - rows.lower
    return np.where(np.isfinite(width) & (width > 0), width, np.nan)


def label(constraint: Constraint) -> str:
    """Return the name of a constraint, or its shortened expression."""
    return constraint.name or shortened(constraint.expression)


def as_path(constraint: object) -> Constraint:
    """Return a path constraint; convert a relation or an expression into one.

    Raises:
        InvalidProblemError: If the entry is in none of these forms.
    """
    if isinstance(constraint, TerminalConstraint):
        raise InvalidProblemError(
            "constraints must hold path constraints; a TerminalConstraint belongs in "
            "the list `terminal`"
        )
    stated = limited("a path constraint", constraint)
    if stated is not None:
        expression, lower, upper = stated
        name = shortened(constraint)
        return PathConstraint(
            expression=expression, lower=lower, upper=upper, name=name
        )
    if not all(hasattr(constraint, n) for n in ("expression", "excess", "smooth")):
        raise InvalidProblemError(
            "constraints must hold PathConstraint, Separation, Connection, relations "
            f"such as x[0] <= 1 or expressions, got {shortened(constraint)}"
        )
    return cast(Constraint, constraint)


def as_terminal(constraint: object) -> TerminalConstraint:
    """Return a terminal constraint, converted from another form if necessary.

    Raises:
        InvalidProblemError: If the entry is in none of these forms.
    """
    if isinstance(constraint, TerminalConstraint):
        return constraint
    if isinstance(constraint, PathConstraint | Separation | Connection):
        raise InvalidProblemError(
            "terminal must hold terminal constraints, got a "
            f"{type(constraint).__name__}: use TerminalConstraint(expression=..., "
            "lower=..., upper=...)"
        )
    stated = limited("a terminal constraint", constraint)
    if stated is not None:
        expression, lower, upper = stated
        return TerminalConstraint(expression=expression, lower=lower, upper=upper)
    if isinstance(constraint, tuple) and len(constraint) == 2:  # noqa: PLR2004
        expression, value = constraint
        return TerminalConstraint(expression=expression, lower=value, upper=value)
    raise InvalidProblemError(
        "terminal must hold TerminalConstraint, relations, expressions or pairs "
        f"(expression, value), got {shortened(constraint)}"
    )
