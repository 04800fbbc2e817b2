"""When a lane's multipliers are renewed, how its weights grow, and when it ends.

A lane renews its multipliers when it has converged inside. A weight grows thirtyfold
where its rows did not come ten times nearer to their limits; the tolerance of the next
inner steps is a hundredth of the last.

Source: Howell, Jackson and Manchester (2019), ALTRO; Andreani et al. (2007), ALGENCAN,
the schedule of weights.
"""

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

FEASIBLE = 1e-7
"""Violation, in the NLP's numbers near one, at which a lane is done."""
_HEAVIEST = 1e9
_HARDLY, _FAR = 0.9, 1e-3
_ROUNDING = 1e-3


@dataclass(frozen=True, kw_only=True, slots=True)
class LaneOptions:
    """When lanes end, and how their weights grow.

    Attributes:
        inner: Most steps between new multipliers.
        outer: Most new multipliers.
        most: Most steps of a lane in all.
        factor: What a weight grows by.
        first_tolerance: Relative fall of the augmented Lagrangian that ends the inner
            steps, at first.
        tolerance: The same at last.
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
    """Where a lane stands in its outer loop.

    Attributes:
        tolerance: See LaneOptions.
        r: Weight of the rows of intervals and start.
        r_end: Weight of the rows of the end.
        broken: How far rows and multipliers were from fitting each other, when the
            multipliers were last renewed.
        broken_end: The same of the end.
        renewed: How often that was.
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
    """Return where a lane stands after new multipliers, and whether it has ended.

    Args:
        now: Where it stands.
        broken: How far its rows are from fitting the multipliers so far.
        broken_end: The same of the end.
        options: When lanes end.
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
