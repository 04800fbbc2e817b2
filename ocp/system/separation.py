"""Distances to keep: separation from obstacles, connection to other agents.

Separation demands |r| >= d for a relative position r. With "points", r is evaluated at
the end of each check. With "segments", it is evaluated at the nearest point of the
straight line between the relative positions at both ends, so that a passage between two
samples is detected:

    t* = clip(-a'(b - a) / |b - a|^2, 0, 1),   distance = |a + t* (b - a)|

Connection demands |r| <= d. On a segment |r| is largest at one of its ends, so points
are sufficient.

Source: the chapter's (5.15), (5.16) for `measure="indicator"`, which counts 1 for each
violated check instead of the amount, and (5.34); the segment is an addition.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

import casadi as ca
import numpy as np

from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import as_symbolic_column, shortened
from swarmstart.ocp.common.limits import (
    Limit,
    require_choice,
    require_distance,
    scales_given,
    vector_of,
)
from swarmstart.ocp.system.constraints import Measure, Rows

Along = Literal["points", "segments"]

# Squared length, relative to the squared distance, below which a segment is a point;
# only avoids 0/0.
_SHORTEST_SEGMENT = 1e-24


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Separation:
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

    def rows(self, value: ca.SX) -> Rows:
        """Return |r| >= distance [m]."""
        return Rows(ca.norm_2(value), np.array([self.distance]), np.array([np.inf]))

    def smooth(self, value: ca.SX) -> Rows:
        """Return (|r|^2 - d^2) / 2d >= 0: metres near the limit, smooth everywhere."""
        limit = self.distance + self.smooth_margin
        over = (ca.sumsqr(value) - limit**2) / (2 * limit)
        return Rows(over, np.array([0.0]), np.array([np.inf]))

    def excess(self, start: ca.SX, end: ca.SX) -> ca.SX:
        """Return the distance by which r is too near [m]."""
        if self.along == "points":
            nearest = end
        else:
            shortest = _SHORTEST_SEGMENT * self.distance**2
            nearest = nearest_on_segment(start, end, shortest=shortest)
        return self.distance + self.margin - ca.norm_2(nearest)

    def indicated(self, excess: ca.SX) -> ca.SX:
        """Return 1 at or below the limit (5.16)."""
        return excess >= 0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Connection:
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
        require_distance("distance less margin", self.distance - self.margin)
        scale = self.distance if self.scale is None else self.scale
        object.__setattr__(self, "scale", scales_given("connection", scale, 1))

    @property
    def expression(self) -> ca.SX:
        """The relative position."""
        return self.relative

    def rows(self, value: ca.SX) -> Rows:
        """Return |r| <= distance [m]."""
        return Rows(ca.norm_2(value), np.array([-np.inf]), np.array([self.distance]))

    def smooth(self, value: ca.SX) -> Rows:
        """Return (|r|^2 - d^2) / 2d <= 0: metres near the limit, smooth everywhere."""
        limit = self.distance - self.margin
        over = (ca.sumsqr(value) - limit**2) / (2 * limit)
        return Rows(over, np.array([-np.inf]), np.array([0.0]))

    def excess(self, start: ca.SX, end: ca.SX) -> ca.SX:
        """Return the distance by which r is too far at the check's end [m]."""
        return ca.norm_2(end) - (self.distance - self.margin)

    def indicated(self, excess: ca.SX) -> ca.SX:
        """Return 1 beyond the limit."""
        return excess > 0


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
            f"centre must be {position.numel()} numbers, got {shortened(centre)}"
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


def _position(relative: ca.SX) -> ca.SX:
    """Return a relative position as a column.

    Raises:
        InvalidProblemError: If it is not a vector, or is empty.
    """
    column = as_symbolic_column("relative", relative)
    if not column.numel():
        raise InvalidProblemError("relative must have at least one row, got none")
    return column


def nearest_on_segment(a: ca.SX, b: ca.SX, *, shortest: float) -> ca.SX:
    """Return the point of the segment from a to b that is nearest to the origin.

    Args:
        a: One end, shape (n, 1).
        b: The other end, shape (n, 1).
        shortest: Squared length below which the segment is a point.
    """
    along = b - a
    length = ca.fmax(ca.sumsqr(along), shortest)
    t = ca.fmin(ca.fmax(-ca.dot(a, along) / length, 0), 1)
    return a + t * along
