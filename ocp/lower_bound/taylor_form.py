"""Taylor forms of functions over boxes, in intervals rounded outwards.

For a function q on a box with the middle m and the half widths r, with d = y - m,

    q(y) = q(m) + g'd + d'Hd / 2 + R,
    |R| <= sum over i <= j <= k of (number of orders of i, j, k) |q_ijk| r_i r_j r_k / 6

The gradient g and the Hessian H are intervals that hold their values at m; the bound of
the remainder R takes the third derivatives q_ijk over the whole box. If q contains a
polynomial, its coefficients are inputs, so that derivatives are formed once for all
polynomials.

Source: Neumaier (1990), Interval Methods for Systems of Equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.terminal_set.interval_arithmetic import (
    PADDING,
    Derivatives,
    middle_and_radius,
)


@dataclass(frozen=True, slots=True, eq=False)
class Expansion:
    """Expansions of k functions of d coordinates about the middles of m boxes.

    Attributes:
        reach: Half widths of the boxes, shape (d, m).
        value: Value of each function at the middle, shape (k, m).
        value_radius: Error bounds of the values, shape (k, m).
        slope: First derivatives, shape (k, d, m).
        bend: Second derivatives, one for each pair i <= j, shape (k, pairs, m).
        rest: Remainder: third order, and the radii of slopes and bends times the reach,
            shape (k, m).
        pull: For each coordinate, the part of `rest` that shrinks if boxes are cut
            along it, shape (k, d, m).
    """

    reach: Array
    value: Array
    value_radius: Array
    slope: Array
    bend: Array
    rest: Array
    pull: Array


class TaylorForm:
    """Taylor forms of several functions of a point, with parameters."""

    def __init__(
        self, functions: Sequence[ca.SX], point: ca.SX, parameters: ca.SX
    ) -> None:
        """Form the derivatives.

        Args:
            functions: Scalars in the point and the parameters.
            point: Coordinates of the boxes, shape (d, 1).
            parameters: Symbols of numbers given with the boxes, shape (p, 1).

        Raises:
            UnknownIntervalOperationError: If an operation has no interval form, or its
                derivatives jump.
        """
        self.coordinates, self.functions = int(point.numel()), len(functions)
        derivatives = Derivatives(functions, point, parameters)
        self.pairs, self._triples = derivatives.pairs, derivatives.triples
        self._low, self._third = derivatives.of(0, 1, 2), derivatives.of(3)
        # Orders of iii, of iij and of ijk, by the number of different entries.
        orders = {1: 1.0, 2: 3.0, 3: 6.0}
        self._orders = np.array([orders[len(set(one))] / 6 for one in self._triples])

    def expanded(self, lower: Array, upper: Array, parameters: Array) -> Expansion:
        """Return the Taylor expansions of the functions about the middles of boxes.

        Args:
            lower: Lower corners, shape (d, m).
            upper: Upper corners, same shape.
            parameters: Values of the parameters, shape (p,).
        """
        d, k, count = self.coordinates, self.functions, lower.shape[1]
        middle = (lower + upper) / 2
        # The middle is rounded, so one half may be longer than the other.
        reach = np.maximum(upper - middle, middle - lower) * (1 + PADDING)
        given = np.repeat(parameters[:, None], count, axis=1)
        at = np.vstack([middle, given])
        # Intervals without width: only rounding makes the results wider.
        center, radius = middle_and_radius(*self._low(at, at))
        size = 1 + d + len(self.pairs)
        center, radius = (part.reshape(k, size, count) for part in (center, radius))
        rest, pull = self._third_order(lower, upper, given, reach)
        with np.errstate(invalid="ignore", over="ignore"):
            unsure = radius[:, 1 : 1 + d] * reach
            pull += unsure
            rest += unsure.sum(axis=1)
            for number, (i, j) in enumerate(self.pairs):
                # A pair i < j stands for both orders, which cancels the 1/2 of d'Hd /
                # 2.
                area = reach[i] * reach[j] * (0.5 if i == j else 1.0)
                term = radius[:, 1 + d + number] * area
                rest += term
                pull[:, i] += term
                pull[:, j] += term
        return Expansion(
            reach=reach,
            value=center[:, 0],
            value_radius=radius[:, 0],
            slope=center[:, 1 : 1 + d],
            bend=center[:, 1 + d :],
            rest=rest,
            pull=pull,
        )

    def _third_order(
        self, lower: Array, upper: Array, given: Array, reach: Array
    ) -> tuple[Array, Array]:
        """Return bounds of the third-order terms, (k, m), and each axis' part."""
        low, high = self._third(np.vstack([lower, given]), np.vstack([upper, given]))
        most = np.maximum(np.abs(low), np.abs(high))
        most = most.reshape(self.functions, len(self._triples), -1)
        rest = np.zeros((self.functions, lower.shape[1]))
        pull = np.zeros((self.functions, *lower.shape))
        with np.errstate(invalid="ignore", over="ignore"):
            for number, (i, j, k) in enumerate(self._triples):
                cube = self._orders[number] * (reach[i] * reach[j] * reach[k])
                term = most[:, number] * cube
                rest += term
                for axis in (i, j, k):
                    pull[:, axis] += term
        return rest, pull


def least_quadratic(
    slope: Array, bend: Array, reach: Array, pairs: Sequence[tuple[int, int]]
) -> tuple[Array, Array]:
    """Return lower bounds of g'd + d'Hd / 2 over |d| <= reach.

    Each axis alone is exact; mixed terms are subtracted at their largest size. The
    caller must allow for rounding errors.

    Args:
        slope: g, shape (d, m).
        bend: H for each pair i <= j, shape (pairs, m).
        reach: Half widths of the boxes, shape (d, m).
        pairs: Pairs (i, j) of coordinates, i <= j, in the order of `bend`.

    Returns:
        Bounds, shape (m,); variation of the function along each axis, (d, m).
    """
    total, spread = np.zeros(reach.shape[1]), np.zeros_like(reach)
    for number, (i, j) in enumerate(pairs):
        H = bend[number]
        if i != j:
            shared = np.abs(H) * reach[i] * reach[j]
            total -= shared
            spread[i] += shared
            spread[j] += shared
            continue
        g, r = np.abs(slope[i]), reach[i]
        least = -g * r + H * r * r / 2
        with np.errstate(divide="ignore", invalid="ignore"):
            inside = (H > 0) & (g < H * r)  # The vertex of the parabola.
            total += np.where(inside, -g * g / (2 * H), least)
        spread[i] += g * r + np.abs(H) * r * r / 2
    return total, spread
