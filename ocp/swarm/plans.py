"""Committed plans of vehicles, and whether two of them may ever come too near.

All vehicles share a grid of times t_k = k h. A plan passes through a sample p_k at each
of them; between two samples it keeps to the chord within its bulge b_k,

    |p(t) - (1 - s) p_k - s p_{k+1}| <= b_k,    s = (t - t_k) / h.

A held acceleration a gives b = |a| h^2 / 8. The last sample is the centre of a ball,
the plan's rest, in which it stays for ever: the vehicle hovers, loiters or is held by a
terminal set. (The chord of the last piece ends at this centre, and the piece's bulge is
the distance from that chord.)

Two plans are clear of each other from a step on if at each later time the chords, and
at the end the rests, are farther apart than the radius plus both bulges. Chords are
straight and run at constant speed, so the least distance of two is that of a segment
from the origin. A plan with NaN is not clear of any other.

Positions are scaled beforehand such that the region around a vehicle that others must
not enter is a ball; its radius contains the error by which the vehicles may be off
their plans.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.machine_code import Count, kernel

GONE = -2
"""Number of the plan of a vehicle that has left: it is clear of every plan."""


class Plans(NamedTuple):
    """Plans, numbered by their rows; one that was proposed is never changed.

    There are only three arrays since compiled code counts the references to each: a
    fourth one would make a search three times as slow.

    Attributes:
        first: Steps of the first samples, shape (rows,).
        samples: Scaled positions [m], shape (rows, pieces + 1, 3).
        bulges: Bulge of each piece, a bound of the distance of the path from the
            straight line between two samples; and, as the last entry, the radius of the
            ball in which the plan stays for ever [m], shape (rows, pieces + 1).
    """

    first: Count
    samples: Array
    bulges: Array


def no_plans(rows: int, pieces: int) -> Plans:
    """Return empty rows for plans; a row is clear of no plan until it is written."""
    return Plans(
        first=np.zeros(rows, np.int64),
        samples=np.full((rows, pieces + 1, 3), np.nan),
        bulges=np.full((rows, pieces + 1), np.nan),
    )


def grown(plans: Plans, rows: int) -> Plans:
    """Return plans with room for more rows; existing plans keep their numbers."""
    more = no_plans(rows, plans.bulges.shape[1] - 1)
    return Plans(*(np.concatenate(pair) for pair in zip(plans, more, strict=True)))


def chosen(plans: Plans, rows: Sequence[int]) -> Plans:
    """Return some of the plans, in this order."""
    picked = np.array(rows, np.int64)
    return Plans(plans.first[picked], plans.samples[picked], plans.bulges[picked])


@kernel
def position(plan: int, step: int, plans: Plans, point: NDArray[np.float64]) -> float:
    """Write a plan's position at a step; return its bulge from there to the next step.

    Args:
        plan: Its row.
        step: Number of the time; before the plan's first sample the bulge is NaN.
        plans: All plans of the vehicles, each a row.
        point: Gets the position [m], shape (3,).
    """
    index = step - plans.first[plan]
    held = min(max(index, 0), plans.bulges.shape[1] - 1)
    for axis in range(3):
        point[axis] = plans.samples[plan, held, axis]
    return plans.bulges[plan, held] if index >= 0 else math.nan


@kernel
def may_meet(one: int, other: int, step: int, radius: float, plans: Plans) -> bool:
    """Return whether two plans may come within a radius at a step or later.

    Args:
        one: Row of a plan, or GONE for a vehicle that has left and meets no plan.
        other: Row of another plan, or GONE.
        step: Number of the time from which on the plans are compared.
        radius: Least distance of the two [m], scaled.
        plans: All plans of the vehicles, each a row.
    """
    if GONE in (one, other):
        return False
    last = max(plans.first[one], plans.first[other]) + plans.bulges.shape[1] - 1
    point, its = np.empty(3), np.empty(3)
    before, now = np.empty(3), np.empty(3)
    bulge = position(one, step, plans, point) + position(other, step, plans, its)
    for axis in range(3):
        before[axis] = point[axis] - its[axis]
    for k in range(step + 1, last + 1):
        following = position(one, k, plans, point) + position(other, k, plans, its)
        for axis in range(3):
            now[axis] = point[axis] - its[axis]
        if not _distance(before, now) >= radius + bulge:
            return True
        bulge = following
        before[:] = now
    return not _distance(before, before) >= radius + bulge


@kernel
def _distance(start: NDArray[np.float64], end: NDArray[np.float64]) -> float:
    """Return the distance of a segment from the origin; NaN if an end is NaN."""
    length, along = 0.0, 0.0
    for axis in range(3):
        part = end[axis] - start[axis]
        length += part * part
        along -= start[axis] * part
    share = min(1.0, max(0.0, along / length)) if length > 0 else 0.0
    squared = 0.0
    for axis in range(3):
        # Of both ends, so that a NaN in either of them is not lost.
        squared += ((1.0 - share) * start[axis] + share * end[axis]) ** 2
    return math.sqrt(squared)


@kernel
def least_gap(rows: Count, step: int, plans: Plans) -> float:
    """Return a lower bound of the distance of any two plans until the next step.

    Args:
        rows: Rows of the plans to compare, shape (n,).
        step: Number of the time.
        plans: All plans of the vehicles, each a row.
    """
    least = math.inf
    point, its = np.empty(3), np.empty(3)
    before, now = np.empty(3), np.empty(3)
    for place in range(1, rows.size):
        for other in range(place):
            bulge = position(rows[place], step, plans, point)
            bulge += position(rows[other], step, plans, its)
            before[:] = point - its
            position(rows[place], step + 1, plans, point)
            position(rows[other], step + 1, plans, its)
            now[:] = point - its
            least = min(least, _distance(before, now) - bulge)
    return least
