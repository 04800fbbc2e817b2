"""Controls that take whole numbers only.

    search      a coordinate stands for the nearest whole number; the box reaches half a
                unit beyond the bounds, so that all numbers are equally likely
    relaxation  the NLP without the requirement; its optimum is, locally, a lower bound
    rounding    sum-up rounding: whole numbers w_k whose sums stay near those of the
                relaxed r_k,  w_k = nearest to r_k + sum over j < k of (r_j - w_j)
    descent     single numbers changed by one, or a unit moved to the next interval, as
                long as the cost falls

Source: Sager, Bock and Diehl (2012), The integer approximation error in mixed-integer
optimal control, Mathematical Programming 133, for sum-up rounding.
"""

from collections.abc import Mapping, Sequence
from typing import TypeVar

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError

_Symbolic = TypeVar("_Symbolic", ca.SX, ca.MX)
_HALF = 0.499999
"""Extension of the box of a search beyond the bounds."""


def integer_numbers(
    given: Sequence[int | str],
    names: Sequence[str],
    limits: Mapping[str, tuple[Array, Array] | None],
) -> tuple[int, ...]:
    """Return the numbers of the controls that take whole numbers, in order.

    Args:
        given: Numbers or names of controls.
        names: Names of all controls.
        limits: Lower and upper bounds of all controls, each (nu,), by their role.

    Raises:
        InvalidProblemError: If there is no such control, or its bounds are not whole
            numbers.
    """
    several = [given] if isinstance(given, int | str) else list(given)
    found = set()
    for one in several:
        if isinstance(one, str):
            known = one in names
        else:
            known = one in range(len(names)) and isinstance(one, int | np.integer)
        if isinstance(one, bool) or not known:
            raise InvalidProblemError(
                f"integer must name controls, some of {', '.join(names)}, or give "
                f"their numbers, got {one!r}"
            )
        found.add(names.index(one) if isinstance(one, str) else int(one))
    for role, sides in limits.items():
        for j in found if sides is not None else ():
            bounds = [float(side[j]) for side in sides or ()]
            if any(np.isfinite(b) and b != np.rint(b) for b in bounds):
                raise InvalidProblemError(
                    f"{role} of {names[j]!r}, which takes whole numbers, must be "
                    f"whole, got {bounds}"
                )
    return tuple(sorted(found))


def whole(
    controls: Array, integer: Sequence[int], limits: tuple[Array, Array]
) -> Array:
    """Return controls rounded to whole numbers if required; a copy.

    Args:
        controls: Shape (nu, N).
        integer: Numbers of the controls that take whole numbers.
        limits: Lower and upper bounds of all controls, each (nu,).
    """
    rounded, rows = controls.copy(), list(integer)
    lower, upper = (side[rows, None] for side in limits)
    rounded[rows] = np.clip(np.floor(controls[rows] + 0.5), lower, upper)
    return rounded


def whole_symbols(
    controls: _Symbolic, integer: Sequence[int], limits: tuple[Array, Array]
) -> _Symbolic:
    """Return the same for one column of symbols, shape (nu, 1)."""
    rows = ca.vertsplit(controls) if integer else []
    for j in integer:
        lower, upper = (float(side[j]) for side in limits)
        rounded = ca.floor(rows[j] + 0.5)
        rounded = ca.fmax(rounded, lower) if np.isfinite(lower) else rounded
        rows[j] = ca.fmin(rounded, upper) if np.isfinite(upper) else rounded
    return ca.vertcat(*rows) if integer else controls


def widened(limits: tuple[Array, Array], integer: Sequence[int]) -> tuple[Array, Array]:
    """Return bounds of a search that make all whole numbers equally likely."""
    lower, upper = (side.copy() for side in limits)
    rows = list(integer)
    lower[rows] -= _HALF
    upper[rows] += _HALF
    return lower, upper


def sum_up_rounded(
    relaxed: Array,
    integer: Sequence[int],
    limits: tuple[Array, Array],
    lengths: Sequence[int],
) -> Array:
    """Return whole-number controls whose sums stay near those of the relaxed ones.

    Args:
        relaxed: Relaxed controls of each block of intervals, shape (nu, blocks).
        integer: Numbers of the controls that take whole numbers.
        limits: Lower and upper bounds of all controls, each (nu,).
        lengths: Lengths of the blocks, in intervals.
    """
    rounded = relaxed.copy()
    for j in integer:
        behind = 0.0
        for k, length in enumerate(lengths):
            behind += relaxed[j, k] * length
            nearest = np.floor(behind / length + 0.5)
            rounded[j, k] = np.clip(nearest, limits[0][j], limits[1][j])
            behind -= rounded[j, k] * length
    return rounded


def neighbours(
    controls: Array, integer: Sequence[int], limits: tuple[Array, Array]
) -> Array:
    """Return the controls that differ by one unit, or by one moved unit; (k, nu, N)."""
    found = []
    for j in integer:
        for k in range(controls.shape[1]):
            for step in (1.0, -1.0):
                one = controls.copy()
                one[j, k] += step
                found.append(one)
                if k + 1 < controls.shape[1]:
                    both = one.copy()
                    both[j, k + 1] -= step
                    found.append(both)
    moved = np.array(found)
    lower, upper = (side[:, None] for side in limits)
    allowed = ((moved >= lower) & (moved <= upper)).all(axis=(1, 2))
    return np.asarray(moved[allowed])
