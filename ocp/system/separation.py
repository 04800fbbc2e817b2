"""Distances to keep, and all other forms in which users write constraints.

Separation demands |r| >= d for a relative position r. With "points", r is evaluated at
the end of each check. With "segments", it is evaluated at the nearest point of the
straight line between the relative positions at both ends, so that a passage between two
samples is detected:

    t* = clip(-a'(b - a) / |b - a|^2, 0, 1),   distance = |a + t* (b - a)|

Connection demands |r| <= d. On a segment |r| is largest at one of its ends, so points
are sufficient.

Other constraints are converted from

    x[0] <= 1        a relation
    x[0] - 1         an expression alone, which must be zero
    (x[0], 1)        at the end only: an expression and its value

Source: the chapter's (5.15), (5.16) for `measure="indicator"`, which counts 1 for each
violated check instead of the amount, and (5.34); the segment is an addition.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, cast, get_args

import casadi as ca
import numpy as np

from swarmstart.arguments import checked, text
from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.expressions import EXPRESSION, as_symbolic_column, shortened
from swarmstart.ocp.common.limits import (
    Limit,
    require_choice,
    require_distance,
    scales_given,
    vector_of,
)
from swarmstart.ocp.common.pickling import Expressed
from swarmstart.ocp.system.constraints import (
    Constraint,
    Measure,
    PathConstraint,
    Rows,
    TerminalConstraint,
    limited,
)

Along = Literal["points", "segments"]
# Squared length, relative to the squared distance, below which a segment is a point;
# only avoids 0/0.
_SHORTEST_SEGMENT = 1e-24


@checked(refused, along=text(), measure=text(), name=text())
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Separation(Expressed):
    """Keep a relative position at least `distance` away from the origin.

    Attributes:
        relative: Relative position in the problem's symbols, shape (2, 1) or (3, 1)
            [m].
        distance: Smallest allowed distance [m].
        margin: Added to the distance in the search [m].
        smooth_margin: Added to the distance in the NLP, which sees points only [m].
        along: Where the distance is measured: at "points", the ends of the checks, or
            along "segments" between them.
        measure: "excess" or "indicator" (1 for each check at or below the limit).
        scale: Divisor of the excess [m]; None: the distance.
        name: Name in messages; empty: the expression.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> first, second = ca.SX.sym("first", 2), ca.SX.sym("second", 2)
        >>> apart = ss.Separation(relative=first - second, distance=5.0, margin=0.5)
        >>> rows = apart.rows(ca.DM([3.0, 4.0]))
        >>> float(rows.values), rows.lower
        (5.0, array([5.]))
    """

    relative: ca.SX
    distance: float
    margin: float = 0.0
    smooth_margin: float = 0.0
    along: Along = "points"
    measure: Measure = "excess"
    scale: Limit | None = None
    name: str = ""

    def __post_init__(self) -> None:
        """Validate the distances and the options."""
        object.__setattr__(self, "relative", _position(self.relative))
        require_distance("distance", self.distance, self.margin, self.smooth_margin)
        require_choice("along", self.along, get_args(Along))
        require_choice("measure", self.measure, get_args(Measure))
        scale = self.distance if self.scale is None else self.scale
        object.__setattr__(self, "scale", scales_given("separation", scale, 1))

    @property
    def expression(self) -> ca.SX:
        """The relative position."""
        return self.relative

    @checked(refused, value=EXPRESSION)
    def rows(self, value: ca.SX) -> Rows:
        """Return |r| and its limit, |r| >= distance, r the relative position [m]."""
        return Rows(ca.norm_2(value), np.array([self.distance]), np.array([np.inf]))

    @checked(refused, value=EXPRESSION)
    def smooth(self, value: ca.SX) -> Rows:
        """Return (|r|^2 - d^2) / 2d >= 0, r the relative position.

        d is the distance plus `smooth_margin`. Near the limit the value is in metres
        beyond it, and it is smooth everywhere.
        """
        limit = self.distance + self.smooth_margin
        over = (ca.sumsqr(value) - limit**2) / (2 * limit)
        return Rows(over, np.array([0.0]), np.array([np.inf]))

    @checked(refused, start=EXPRESSION, end=EXPRESSION)
    def excess(self, start: ca.SX, end: ca.SX) -> ca.SX:
        """Return the distance by which the relative position is too short [m]."""
        if self.along == "points":
            nearest = end  # The start is the end of the check before.
        else:
            shortest = _SHORTEST_SEGMENT * self.distance**2
            nearest = nearest_on_segment(start, end, shortest=shortest)
        return self.distance + self.margin - ca.norm_2(nearest)

    @checked(refused, excess=EXPRESSION)
    def indicated(self, excess: ca.SX) -> ca.SX:
        """Return 1 if the distance is at or below its limit, else 0 (5.16)."""
        return excess >= 0


@checked(refused, name=text())
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Connection(Expressed):
    """Keep a relative position at most `distance` away from the origin.

    Attributes:
        relative: Relative position in the problem's symbols, shape (2, 1) or (3, 1)
            [m].
        distance: Largest allowed distance [m].
        margin: Subtracted from the distance, in the search and in the NLP [m].
        scale: Divisor of the excess [m]; None: the distance.
        name: Name in messages; empty: the expression.

    Source: the chapter's (5.34).

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> leader, follower = ca.SX.sym("leader", 2), ca.SX.sym("follower", 2)
        >>> link = ss.Connection(relative=leader - follower, distance=50.0)
        >>> rows = link.rows(ca.DM([30.0, 40.0]))
        >>> float(rows.values), rows.upper
        (50.0, array([50.]))
    """

    relative: ca.SX
    distance: float
    margin: float = 0.0
    scale: Limit | None = None
    name: str = ""
    measure: Measure = field(default="excess", init=False)

    def __post_init__(self) -> None:
        """Validate the distances."""
        object.__setattr__(self, "relative", _position(self.relative))
        require_distance("distance", self.distance, self.margin)
        # `smooth` divides by it.
        require_distance("distance less margin", self.distance - self.margin)
        scale = self.distance if self.scale is None else self.scale
        object.__setattr__(self, "scale", scales_given("connection", scale, 1))

    @property
    def expression(self) -> ca.SX:
        """The relative position."""
        return self.relative

    @checked(refused, value=EXPRESSION)
    def rows(self, value: ca.SX) -> Rows:
        """Return |r| and its limit, |r| <= distance, r the relative position [m]."""
        return Rows(ca.norm_2(value), np.array([-np.inf]), np.array([self.distance]))

    @checked(refused, value=EXPRESSION)
    def smooth(self, value: ca.SX) -> Rows:
        """Return (|r|^2 - d^2) / 2d <= 0, r the relative position.

        d is the distance less `margin`. Near the limit the value is in metres beyond
        it, and it is smooth everywhere.
        """
        limit = self.distance - self.margin
        over = (ca.sumsqr(value) - limit**2) / (2 * limit)
        return Rows(over, np.array([-np.inf]), np.array([0.0]))

    @checked(refused, start=EXPRESSION, end=EXPRESSION)
    def excess(self, start: ca.SX, end: ca.SX) -> ca.SX:
        """Return by how much a relative position is too long at the check's end [m]."""
        return ca.norm_2(end) - (self.distance - self.margin)

    @checked(refused, excess=EXPRESSION)
    def indicated(self, excess: ca.SX) -> ca.SX:
        """Return 1 if the distance is above its limit, else 0."""
        return excess > 0


@checked(refused, along=text(), measure=text(), name=text())
def disc(  # noqa: PLR0913 - the options of Separation
    position: ca.SX,
    *,
    centre: Limit,
    radius: float,
    margin: float = 0.0,
    smooth_margin: float = 0.0,
    along: Along = "points",
    measure: Measure = "excess",
    scale: Limit | None = None,
    name: str = "",
) -> Separation:
    """Return the constraint to stay outside a fixed disc (or ball).

    Args:
        position: Position in the problem's symbols, shape (2, 1) or (3, 1) [m].
        centre: Centre of the disc, same shape [m].
        radius: Radius of the disc [m].
        margin: See Separation.
        smooth_margin: See Separation.
        along: See Separation.
        measure: See Separation.
        scale: See Separation.
        name: See Separation.

    Returns:
        A Separation from the centre.

    Raises:
        InvalidProblemError: If a shape does not fit or a number is invalid.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> position = ca.SX.sym("position", 2)
        >>> keep_out = ss.disc(position, centre=(2, 0.5), radius=0.8, along="segments")
        >>> keep_out.distance, keep_out.along
        (0.8, 'segments')
    """
    require_distance("radius", radius, margin, smooth_margin)
    position = as_symbolic_column("position", position)
    try:
        fixed = vector_of(centre)
    except (TypeError, ValueError) as error:
        raise InvalidProblemError(
            f"centre must be {position.numel()} numbers, got {shortened(centre)}; if "
            "it moves, give position - centre as the position, and 0 as the centre"
        ) from error
    if not np.isfinite(fixed).all():
        raise InvalidProblemError(f"centre must be finite, got {fixed}")
    if fixed.shape not in ((), (position.numel(),)):
        raise InvalidProblemError(
            f"centre must have shape ({position.numel()},), got {fixed.shape}"
        )
    return Separation(
        relative=position - ca.DM(fixed),
        distance=radius,
        margin=margin,
        smooth_margin=smooth_margin,
        along=along,
        measure=measure,
        scale=scale,
        name=name,
    )


def nearest_on_segment(a: ca.SX, b: ca.SX, *, shortest: float) -> ca.SX:
    """Return the point of the segment from a to b that is nearest to the origin.

    Args:
        a: One end, shape (n, 1).
        b: The other end, shape (n, 1).
        shortest: Squared length, above 0, that is used for a shorter segment, so that
            nothing is divided by 0. The result is then only near the nearest point.
    """
    along = b - a
    length = ca.fmax(ca.sumsqr(along), shortest)
    t = ca.fmin(ca.fmax(-ca.dot(a, along) / length, 0), 1)
    return a + t * along


def known_scales(constraint: Constraint) -> Array:
    """Return the scale of each row: as given, else the width of a range, else NaN."""
    if constraint.scale is not None:
        return np.asarray(constraint.scale, dtype=np.float64)
    rows = constraint.rows(constraint.expression)
    with np.errstate(invalid="ignore"):
        width = rows.upper - rows.lower
    return np.where(np.isfinite(width) & (width > 0), width, np.nan)


def label(constraint: Constraint) -> str:
    """Return the name of a constraint, or its expression."""
    return constraint.name or _named(constraint.expression)


def _named(expression: ca.SX) -> str:
    """Return an expression as a name, or its symbols.

    The symbols say more than the beginning of an expression that repeats its parts.
    """
    text = shortened(expression)
    if not (text.endswith("...") and str(expression).startswith("@")):
        return text
    names = sorted({str(s) for s in ca.symvar(expression)})
    return f"a constraint of {', '.join(names)}"


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
        name = _named(cast(ca.SX, constraint))
        return PathConstraint(
            expression=expression, lower=lower, upper=upper, name=name
        )
    # By its methods: users may write constraints of their own.
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


def _position(relative: ca.SX) -> ca.SX:
    """Return a relative position as a column.

    Raises:
        InvalidProblemError: If it is not a vector, or is empty.
    """
    column = as_symbolic_column("relative", relative)
    if not column.numel():
        raise InvalidProblemError("relative must have at least one row, got none")
    return column
