"""The box a search is confined to, {x : lower <= x <= upper}, and rules at its bounds.

A coordinate that leaves the box is treated by one of these rules:

clip      onto the bound it crossed; a particle keeps its velocity, as in the chapter
absorb    onto the bound; a particle's velocity becomes zero (Clerc, SPSO 2007)
reflect   as far inside of the bound as it was outside, as often as it takes; a
          particle's velocity turns round with each reflection
midpoint  halfway between its last position and the bound; a velocity becomes zero
redraw    uniform between the bounds; a velocity becomes zero
none      it stays outside (for published results that had no bounds)

Under every rule but `none` the result lies in the box. `absorb` and `clip` differ only
in the velocity. A variable whose bounds are equal stays there under every rule, and its
velocity becomes zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arguments import a_count, checked, optional, reals
from swarmstart.arrays import Array
from swarmstart.errors import InvalidArgumentError, SwarmstartError, brief
from swarmstart.machine_code import Count, kernel

BoundHandling = Literal["clip", "absorb", "reflect", "midpoint", "redraw", "none"]
NAMES: tuple[str, ...] = get_args(BoundHandling)
CLIP, ABSORB, REFLECT, MIDPOINT, REDRAW, NONE = range(6)
CODES = {name: code for code, name in enumerate(NAMES)}


class InvalidBoxError(SwarmstartError, ValueError):
    """The bounds do not make a box.

    Attributes:
        lower: The lower bounds as given.
        upper: The upper bounds as given.
    """

    def __init__(self, message: str, *, lower: ArrayLike, upper: ArrayLike) -> None:
        """Store the message and the bounds."""
        super().__init__(message)
        self.lower = lower
        self.upper = upper


class InvalidPointsError(SwarmstartError, ValueError):
    """Points do not fit the box or the population they are meant for.

    Attributes:
        shape: Shape of the points as given.
    """

    def __init__(self, message: str, *, shape: tuple[int, ...]) -> None:
        """Store the message and the shape."""
        super().__init__(message)
        self.shape = shape


@checked(per_step=optional(a_count(least=1)), constant=a_count())
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Box:
    """Lower and upper bounds of the variables; copied and read-only.

    Attributes:
        lower: Lower bounds, shape (dim,), in the units of the variables.
        upper: Upper bounds, shape (dim,), none below its lower bound. A variable whose
            bounds are equal is fixed.
        per_step: Number of variables of one time step, if the variables are a sequence
            in time, step after step. None if they are not.
        constant: Number of variables that belong to no time step; they come last.

    Raises:
        InvalidBoxError: If the bounds are not vectors of one length or not finite, a
            lower bound is above its upper bound, or `per_step` does not divide the
            number of variables that belong to time steps.

    Example:
        >>> import numpy as np
        >>> import swarmstart as ss
        >>> box = ss.Box(lower=[-1, 0], upper=[1, 5])
        >>> box.dim, box.width.tolist()
        (2, [2.0, 5.0])
        >>> box.contains(np.array([[0.0, 0.0], [3.0, 7.0]])).tolist()
        [True, False]
    """

    lower: Array
    upper: Array
    per_step: int | None = None
    constant: int = 0

    def __post_init__(self) -> None:
        """Check the bounds, copy them and set them read-only."""
        for name in ("lower", "upper"):
            bound = _numbers(name, getattr(self, name))
            bound.setflags(write=False)
            object.__setattr__(self, name, bound)
        problem = _problem(self.lower, self.upper)
        if not problem and self.per_step is not None:
            if self.per_step < 1 or self.in_sequence % self.per_step:
                problem = (
                    f"per_step must divide {self.in_sequence}, got {self.per_step}"
                )
        if problem:
            raise InvalidBoxError(problem, lower=self.lower, upper=self.upper)

    @property
    def dim(self) -> int:
        """Number of variables."""
        return self.lower.size

    @property
    def in_sequence(self) -> int:
        """Number of variables that belong to time steps: all but `constant`."""
        return self.dim - self.constant

    @property
    def width(self) -> Array:
        """Upper minus lower bounds, shape (dim,), a new array."""
        return self.upper - self.lower

    @property
    def free(self) -> Count:
        """Indices of the variables that are not fixed; all indices if all are fixed.

        The array is never empty, so that algorithms need no special case.
        """
        free = np.flatnonzero(self.lower < self.upper)
        return free if free.size else np.arange(self.dim)

    @checked(InvalidArgumentError, points=reals())
    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return which points lie in the box, its boundary included.

        Args:
            points: One point, shape (dim,), or several as columns, shape (dim, k).

        Returns:
            One truth value for each point, shape () or (k,); NaN lies outside.

        Raises:
            InvalidPointsError: If the points do not have `dim` rows.
        """
        points = np.asarray(points, dtype=np.float64)
        if points.ndim not in (1, 2) or points.shape[0] != self.dim:
            raise InvalidPointsError(
                f"points must have shape ({self.dim},) or ({self.dim}, k), "
                f"got {points.shape}",
                shape=points.shape,
            )
        rows = points.reshape(self.dim, -1)
        inside = (rows >= self.lower[:, None]) & (rows <= self.upper[:, None])
        return np.asarray(inside.all(axis=0), dtype=np.bool_).reshape(points.shape[1:])


@kernel
def clip(value: float, lower: float, upper: float) -> float:
    """The nearest value in [lower, upper]."""
    if value < lower:
        return lower
    if value > upper:
        return upper
    return value


@kernel
def between(lower: float, upper: float, fraction: float) -> float:
    """Point at a fraction in [0, 1] of the way from lower to upper; never above."""
    return min(lower + (upper - lower) * fraction, upper)


def _problem(lower: Array, upper: Array) -> str:
    """Return what is wrong with the bounds; empty if nothing is."""
    if lower.ndim != 1 or lower.shape != upper.shape or lower.size == 0:
        return (
            "lower and upper must be vectors of one length, at least 1, "
            f"got shapes {lower.shape} and {upper.shape}"
        )
    for d, (low, high) in enumerate(zip(lower.tolist(), upper.tolist(), strict=True)):
        # The width must not overflow either: points are drawn as fractions of it.
        if not (low <= high and math.isfinite(high - low)):
            return (
                f"bounds of variable {d} must be finite, the lower not above the "
                f"upper, got [{low}, {high}]"
            )
    return ""


def _numbers(name: str, given: ArrayLike) -> Array:
    """Copy bounds; refuse anything but an array of numbers."""
    try:
        numbers = np.array(given)
        if numbers.dtype.kind not in "biuf":
            raise TypeError("text and complex numbers are not converted")
        return numbers.astype(np.float64)
    except (TypeError, ValueError) as error:
        problem = f"{name} must be a vector of numbers, got {brief(given)}"
        raise InvalidBoxError(problem, lower=given, upper=given) from error


@kernel
def repair(
    rule: int,
    value: float,
    origin: float,
    lower: float,
    upper: float,
    fraction: float,
) -> float:
    """Bring a coordinate back into [lower, upper].

    Args:
        rule: A code of CODES.
        value: The coordinate. NaN becomes a bound, or a new draw under `redraw`, and
            stays NaN under `none`.
        origin: Last position of the coordinate, in [lower, upper].
        lower: Lower bound.
        upper: Upper bound.
        fraction: Random number in [0, 1), which only `redraw` uses. The caller draws
            it, since a call with a generator costs ten times as much as one without.
    """
    if lower == upper:
        return lower
    if rule == NONE or lower <= value <= upper:
        return value
    if rule == REFLECT:
        return reflected(value, lower, upper)
    if rule == REDRAW:
        return between(lower, upper, fraction)
    # `clip` would return NaN, which is neither below nor above a bound.
    inside = clip(value, lower, upper) if not math.isnan(value) else lower
    if rule == MIDPOINT:
        return origin + 0.5 * (inside - origin)
    return inside


@kernel
def turned(
    rule: int, velocity: float, value: float, lower: float, upper: float
) -> float:
    """Return the velocity of a particle whose coordinate was repaired by a rule.

    Args:
        rule: A code of CODES.
        velocity: Velocity of the particle in this coordinate before the repair.
        value: The coordinate before the repair.
        lower: Lower bound.
        upper: Upper bound.
    """
    if lower == upper:
        return 0.0
    if lower <= value <= upper or rule in (CLIP, NONE):
        return velocity
    beyond = max(value - upper, lower - value)
    if rule == REFLECT and math.isfinite(beyond):
        crossed = np.ceil(beyond / (upper - lower))  # The number of reflections.
        return velocity if crossed % 2.0 == 0.0 else -velocity
    return 0.0


@kernel
def reflected(value: float, lower: float, upper: float) -> float:
    """Return the coordinate after all reflections at the bounds: a triangular wave.

    The result is the lower bound if the distance from the box overflows or is NaN, or
    if the bounds are equal.
    """
    width = upper - lower
    if (
        width == 0.0
        or not math.isfinite(value - lower)
        or not math.isfinite(2.0 * width)
    ):
        return lower
    # The remainder is at least 0, also for a value below the lower bound.
    beyond = (value - lower) % (2.0 * width)
    if beyond > width:
        beyond = 2.0 * width - beyond
    return clip(lower + beyond, lower, upper)  # The sum is rounded.
