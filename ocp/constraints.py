"""What a trajectory must respect, and by how much it does not.

Every constraint names one `expression` in the problem's symbols. Its values at the
two ends of a check (a part of a control interval, see problem.py) give

- `excess(start, end)`: a number >= 0, 0 = respected, for the population search; it is
  summed over the checks (the "violation" of an individual), and
- `inequalities(value)`: smooth g(value) <= 0 for the NLP of the polish.

Disc and Separation demand |r| >= d of a relative position r. On points, r is taken at
the end of the check; on the segment, at the nearest point of the straight line between
the two relative positions, which catches what passes between two samples:

    t* = clip(-a'(b - a) / |b - a|^2, 0, 1),   distance = |a + t* (b - a)|

Connection demands |r| <= d. Its largest value on a segment is at an end of it, so that
points and segment are the same.

Source: the chapter's (5.15), (5.16) for `measure="indicator"`, which counts 1 for each
violated check instead of measuring how far; the segment is ours.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.model import as_column

Measure = Literal["excess", "indicator"]
Along = Literal["points", "segments"]
Array = NDArray[np.float64]
Limit = float | Sequence[float] | Array
"""One number for all, or one for each row."""

# Below this squared length [m^2] a segment is a point; avoids 0/0 only.
_SHORTEST_SEGMENT = 1e-12


class Constraint(Protocol):
    """One inequality on the states, controls, parameters and signals."""

    @property
    def expression(self) -> ca.SX:
        """What is evaluated at each check, a column in the problem's symbols."""

    def excess(self, start: ca.SX, end: ca.SX) -> ca.SX:
        """Return by how much the values at a check's two ends break the constraint."""

    def inequalities(self, value: ca.SX) -> ca.SX:
        """Return g, shape (m, 1), with g <= 0 where the value is allowed."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Bounds:
    """Box bounds on controls, and on states at every check.

    Attributes:
        controls: (lower, upper), each a number or shape (nu,); None = unbounded.
        states: (lower, upper), each a number or shape (nx,), -inf and inf where a
            state is free; None = all free.
    """

    controls: tuple[Limit, Limit] | None = None
    states: tuple[Limit, Limit] | None = None


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PathConstraint:
    """lower <= expression <= upper at the end of every check.

    Attributes:
        expression: Column in the problem's symbols, shape (m, 1).
        lower: Lower limits, a number or shape (m,).
        upper: Upper limits, a number or shape (m,).
        scale: The excess is divided by it; the units in which it is measured.
        measure: "excess" (how far) or "indicator" (1 where broken).
    """

    expression: ca.SX
    lower: Limit = -np.inf
    upper: Limit = np.inf
    scale: float = 1.0
    measure: Measure = "excess"

    def __post_init__(self) -> None:
        """Bring the limits into the shape of the expression."""
        expression = as_column("expression", self.expression)
        object.__setattr__(self, "expression", expression)
        limits = limits_of(
            "path constraint", (self.lower, self.upper), expression.numel()
        )
        object.__setattr__(self, "lower", limits[0])
        object.__setattr__(self, "upper", limits[1])
        require_distance("scale", self.scale)
        require_choice("measure", self.measure, get_args(Measure))

    def excess(self, start: ca.SX, end: ca.SX) -> ca.SX:
        """Return the summed scaled excess at the check's end."""
        over = self.inequalities(end)
        if not over.numel():
            return ca.SX(0)
        if self.measure == "indicator":
            return ca.sum1(over > 0)
        return ca.sum1(ca.fmax(over, 0)) / self.scale

    def inequalities(self, value: ca.SX) -> ca.SX:
        """Return value - upper and lower - value where these are finite."""
        lower, upper = np.asarray(self.lower), np.asarray(self.upper)
        rows = [value[int(i)] - upper[i] for i in np.flatnonzero(np.isfinite(upper))]
        rows += [lower[i] - value[int(i)] for i in np.flatnonzero(np.isfinite(lower))]
        return ca.vertcat(ca.SX(0, 1), *rows)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Separation:
    """Keep a relative position at least `distance` away from the origin.

    Attributes:
        relative: Relative position in the problem's symbols, (2, 1) or (3, 1) [m].
        distance: Smallest allowed distance [m].
        margin: Added to the distance in the search [m].
        smooth_margin: Added to it in the NLP, which sees points only [m].
        along: "points" or "segments" between the ends of a check.
        measure: "excess" [m] or "indicator" (1 for each check at or below the limit).
    """

    relative: ca.SX
    distance: float
    margin: float = 0.0
    smooth_margin: float = 0.0
    along: Along = "points"
    measure: Measure = "excess"

    def __post_init__(self) -> None:
        """Refuse distances and choices that are none."""
        object.__setattr__(self, "relative", as_column("relative", self.relative))
        require_distance("distance", self.distance, self.margin, self.smooth_margin)
        require_choice("along", self.along, get_args(Along))
        require_choice("measure", self.measure, get_args(Measure))

    @property
    def expression(self) -> ca.SX:
        """The relative position."""
        return self.relative

    def excess(self, start: ca.SX, end: ca.SX) -> ca.SX:
        """Return how much too near [m], or 1 where at or below the limit (5.16)."""
        nearest = end if self.along == "points" else nearest_on_segment(start, end)
        limit = self.distance + self.margin
        if self.measure == "indicator":
            return ca.norm_2(nearest) <= limit
        return ca.fmax(limit - ca.norm_2(nearest), 0)

    def inequalities(self, value: ca.SX) -> ca.SX:
        """Return (d^2 - |r|^2) / 2d: metres near the limit, smooth everywhere."""
        limit = self.distance + self.smooth_margin
        return (limit**2 - ca.sumsqr(value)) / (2 * limit)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Connection:
    """Keep a relative position at most `distance` away from the origin.

    Attributes:
        relative: Relative position in the problem's symbols, (2, 1) or (3, 1) [m].
        distance: Largest allowed distance [m].
        margin: Taken off the distance, in the search and in the NLP [m].

    Source: the chapter's (5.34).
    """

    relative: ca.SX
    distance: float
    margin: float = 0.0

    def __post_init__(self) -> None:
        """Refuse distances that are none."""
        object.__setattr__(self, "relative", as_column("relative", self.relative))
        require_distance("distance", self.distance, self.margin)
        require_distance("distance less margin", self.distance - self.margin)

    @property
    def expression(self) -> ca.SX:
        """The relative position."""
        return self.relative

    def excess(self, start: ca.SX, end: ca.SX) -> ca.SX:
        """Return how much too far [m] at the check's end."""
        return ca.fmax(ca.norm_2(end) - (self.distance - self.margin), 0)

    def inequalities(self, value: ca.SX) -> ca.SX:
        """Return (|r|^2 - d^2) / 2d: metres near the limit, smooth everywhere."""
        limit = self.distance - self.margin
        return (ca.sumsqr(value) - limit**2) / (2 * limit)


def disc(  # noqa: PLR0913 - the options of Separation
    position: ca.SX,
    *,
    centre: Limit,
    radius: float,
    margin: float = 0.0,
    smooth_margin: float = 0.0,
    along: Along = "points",
    measure: Measure = "excess",
) -> Separation:
    """Return the constraint to stay outside a disc (or ball) that does not move.

    Args:
        position: Position in the problem's symbols, shape (2, 1) or (3, 1) [m].
        centre: Its centre, same shape [m].
        radius: Its radius [m].
        margin: See Separation.
        smooth_margin: See Separation.
        along: See Separation.
        measure: See Separation.
    """
    require_distance("radius", radius, margin, smooth_margin)
    position = as_column("position", position)
    fixed = np.asarray(centre, dtype=np.float64)
    if fixed.shape not in ((), (position.numel(),)):
        raise InvalidProblemError(
            f"centre must have shape ({position.numel()},), got {fixed.shape}"
        )
    return Separation(
        relative=position - ca.SX(fixed),
        distance=radius,
        margin=margin,
        smooth_margin=smooth_margin,
        along=along,
        measure=measure,
    )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class TerminalConstraint:
    """lower <= expression <= upper at the end of the horizon; equality by default.

    Attributes:
        expression: Column in states, parameters and signals, shape (m, 1).
        lower: Lower limits, a number or shape (m,).
        upper: Upper limits, a number or shape (m,).
        scale: The excess is divided by it.
    """

    expression: ca.SX
    lower: Limit = 0.0
    upper: Limit = 0.0
    scale: float = 1.0

    def __post_init__(self) -> None:
        """Bring the limits into the shape of the expression."""
        expression = as_column("terminal", self.expression)
        object.__setattr__(self, "expression", expression)
        limits = limits_of(
            "terminal constraint", (self.lower, self.upper), expression.numel()
        )
        object.__setattr__(self, "lower", limits[0])
        object.__setattr__(self, "upper", limits[1])
        require_distance("scale", self.scale)

    def excess(self, value: ca.SX) -> ca.SX:
        """Return the summed scaled distance from the allowed interval."""
        lower, upper = ca.SX(np.asarray(self.lower)), ca.SX(np.asarray(self.upper))
        return ca.sum1(ca.fmax(ca.fmax(lower - value, value - upper), 0)) / self.scale


def nearest_on_segment(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return the point of the segment from a to b that is nearest to the origin.

    Args:
        a: One end, shape (n, 1).
        b: The other end, shape (n, 1).
    """
    along = b - a
    length = ca.fmax(ca.sumsqr(along), _SHORTEST_SEGMENT)
    t = ca.fmin(ca.fmax(-ca.dot(a, along) / length, 0), 1)
    return a + t * along


def limits_of(role: str, limits: Sequence[Limit], size: int) -> tuple[Array, Array]:
    """Return (lower, upper) as read-only arrays of one size.

    Args:
        role: What the limits belong to, for the message.
        limits: The pair (lower, upper), each a number or shape (size,).
        size: Number of values limited.

    Raises:
        InvalidProblemError: If they do not broadcast, are not numbers, or cross.
    """
    try:
        lower, upper = (
            np.broadcast_to(np.asarray(v, dtype=np.float64), (size,)).copy()
            for v in limits
        )
    except (TypeError, ValueError) as error:
        raise InvalidProblemError(
            f"limits of the {role} must be a pair (lower, upper) of numbers or of "
            f"{size} numbers, got {limits!r}"
        ) from error
    if not np.all((lower <= upper) & (lower < np.inf) & (upper > -np.inf)):
        raise InvalidProblemError(
            f"limits of the {role} must have lower <= upper, lower below inf and "
            f"upper above -inf, got {lower} and {upper}"
        )
    lower.flags.writeable = upper.flags.writeable = False
    return lower, upper


def require_distance(role: str, distance: float, *margins: float) -> None:
    """Refuse a distance that is not positive, or a margin below zero, or infinity.

    Raises:
        InvalidProblemError: With the value given.
    """
    if not 0 < distance < np.inf:
        raise InvalidProblemError(f"{role} must be positive, got {distance}")
    for margin in margins:
        if not 0 <= margin < np.inf:
            raise InvalidProblemError(f"margins must be at least 0, got {margin}")


def require_choice(role: str, choice: str, allowed: Sequence[str]) -> None:
    """Refuse what is none of the allowed words.

    Raises:
        InvalidProblemError: With the value given and what is allowed.
    """
    if choice not in allowed:
        raise InvalidProblemError(
            f"{role} must be {' or '.join(allowed)}, got {choice!r}"
        )
