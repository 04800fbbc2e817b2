"""Schedule of a lane's outer loop: new multipliers, growing weights, the end.

A lane renews its multipliers when its inner steps have converged. A weight grows
thirtyfold unless its rows came ten times nearer to their limits; the tolerance of the
next inner steps is a hundredth of the last.

Source: Howell, Jackson and Manchester (2019), ALTRO; Andreani et al. (2007), ALGENCAN,
the schedule of weights.
"""

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

FEASIBLE = 1e-7
"""Violation, in the NLP's scaled numbers, at which a lane is done."""
_HEAVIEST = 1e9
_HARDLY, _FAR = 0.9, 1e-3
_ROUNDING = 1e-3


@dataclass(frozen=True, kw_only=True, slots=True)
class LaneOptions:
    """Options of the outer loop: limits, tolerances and growth of weights.

    Attributes:
        inner: Largest number of steps between new multipliers.
        outer: Largest number of new multipliers.
        most: Largest total number of steps of a lane.
        factor: Factor by which a weight grows.
        first_tolerance: Relative decrease of the augmented Lagrangian at which the
            first inner steps end.
        tolerance: The same for the last inner steps.
        heaviest: Weight at which a lane that comes no nearer to its limits is given up.
    """

    inner: int = 60
    outer: int = 25
    most: int = 500
    factor: float = 30.0
    first_tolerance: float = 1e-2
    tolerance: float = 1e-6
    heaviest: float = 1e6


class Schedule(NamedTuple):
    """The state of a lane in its outer loop.

    Attributes:
        tolerance: See LaneOptions.
        r: Weight of the rows of intervals and start.
        r_end: Weight of the rows of the end.
        broken: Violation of the rows' complementarity when the multipliers were last
            renewed.
        broken_end: The same of the end.
        renewed: Number of times that multipliers were renewed.
    """

    tolerance: ca.SX
    r: ca.SX
    r_end: ca.SX
    broken: ca.SX
    broken_end: ca.SX
    renewed: ca.SX


def renewed(
    now: Schedule, broken: ca.SX, broken_end: ca.SX, options: LaneOptions
) -> tuple[Schedule, ca.SX]:
    """Return the state of a lane after new multipliers, and whether it has ended.

    Args:
        now: Its state before.
        broken: Violation of its rows' complementarity with the multipliers so far.
        broken_end: The same of the end.
        options: Conditions at which lanes end.
    """
    before, after = ca.fmax(now.broken, now.broken_end), ca.fmax(broken, broken_end)
    last = now.tolerance <= options.tolerance * (1 + _ROUNDING)
    heavy = ca.fmax(now.r, now.r_end) >= options.heaviest
    stuck = ca.logic_and(after > _HARDLY * before, after > _FAR)
    given_up = ca.logic_or(ca.logic_and(heavy, stuck), now.renewed >= options.outer)
    done = ca.logic_or(ca.logic_and(last, after <= FEASIBLE), given_up)
    return Schedule(
        tolerance=ca.fmax(0.01 * now.tolerance, options.tolerance),
        r=_heavier(now.r, broken, now.broken, options),
        r_end=_heavier(now.r_end, broken_end, now.broken_end, options),
        broken=broken,
        broken_end=broken_end,
        renewed=now.renewed + 1,
    ), done


def _heavier(
    weight: ca.SX, broken: ca.SX, before: ca.SX, options: LaneOptions
) -> ca.SX:
    slow = ca.logic_and(broken > 0.1 * before, broken > FEASIBLE)
    return ca.if_else(slow, ca.fmin(weight * options.factor, _HEAVIEST), weight)
