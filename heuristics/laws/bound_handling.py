"""Rules for a coordinate that leaves the box.

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

import math
from typing import Literal, get_args

import numpy as np

from swarmstart.heuristics.laws.box import between, clip
from swarmstart.machine_code import kernel

BoundHandling = Literal["clip", "absorb", "reflect", "midpoint", "redraw", "none"]
NAMES: tuple[str, ...] = get_args(BoundHandling)
CLIP, ABSORB, REFLECT, MIDPOINT, REDRAW, NONE = range(6)
CODES = {name: code for code, name in enumerate(NAMES)}


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
        origin: Its last position, in [lower, upper].
        lower: Lower bound.
        upper: Upper bound.
        fraction: For `redraw` a random number in [0, 1), drawn by the caller: a call
            with a generator costs ten times one without.
    """
    if lower == upper:
        return lower
    if rule == NONE or lower <= value <= upper:
        return value
    if rule == REFLECT:
        return reflected(value, lower, upper)
    if rule == REDRAW:
        return between(lower, upper, fraction)
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
        velocity: Its velocity before.
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
        crossed = np.ceil(beyond / (upper - lower))
        return velocity if crossed % 2.0 == 0.0 else -velocity
    return 0.0


@kernel
def reflected(value: float, lower: float, upper: float) -> float:
    """Return the coordinate after all reflections at the bounds: a triangular wave.

    If the distance overflows or is NaN, or the bounds are equal, it is the lower bound.
    """
    width = upper - lower
    if (
        width == 0.0
        or not math.isfinite(value - lower)
        or not math.isfinite(2.0 * width)
    ):
        return lower
    beyond = (value - lower) % (2.0 * width)
    if beyond > width:
        beyond = 2.0 * width - beyond
    return clip(lower + beyond, lower, upper)
