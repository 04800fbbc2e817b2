"""Polynomials of a certificate: exact values, and Taylor models over boxes.

With y = (t, x), T_n the Chebyshev polynomial of degree n, and E = `exponents`,

    V(y) = sum over j of coefficients[j] * product over a of T_E[j][a](z_a),
    z = (y - middle) / half

About the middle z0 of a box, T_n(z0 + r) = sum over p of T_n^[p] r^p with the
derivatives T_n^[p] = (d/dz)^p T_n / p! at z0, from the recurrence T_(n+1) = 2 z T_n -
T_(n-1), differentiated. So V is expanded about the middle to its full degree, exactly
except for rounding, and terms that cancel do so before anything is bounded. Terms
beyond the order of the models are bounded by the sum of their absolute values.

Rounding: each T_n^[p] is computed by the recurrence as a ball, with a middle and a
radius. All further steps are sums of products of these middles with the coefficients.
In d variables the result is off by at most ((1 + share)^d - 1 + rounding) times the
same sum with absolute values, where `share` is the largest ratio of a sum of radii to
the sum of absolute values in the same row.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from swarmstart.terminal_set.checker.file_content import Vector
from swarmstart.terminal_set.checker.lower_bound.certificate_file import Step
from swarmstart.terminal_set.checker.models import (
    GROWTH,
    ORDER,
    TINY,
    Algebra,
    Array,
    Model,
)

_ROUNDING = 2.0**-43  # 1024 roundings; rows of the sums have 41 entries at most, d <= 8


def exact_value(step: Step, point: Vector) -> Fraction:
    """Return the polynomial at a point (t, x), without any rounding.

    Args:
        step: Step with the polynomial.
        point: The point, shape (1 + n,).
    """
    rows = []
    for a, value in enumerate(point):
        z = (Fraction(value) - Fraction(step.middle[a])) / Fraction(step.half[a])
        row = [Fraction(1), z]
        for _ in range(max((e[a] for e in step.exponents), default=0)):
            row.append(2 * z * row[-1] - row[-2])
        rows.append(row)
    total = Fraction(0)
    for exponents, coefficient in zip(step.exponents, step.coefficients, strict=True):
        term = Fraction(coefficient)
        for row, e in zip(rows, exponents, strict=True):
            term *= row[e]
        total += term
    return total


class Expansion:
    """The Taylor expansion of a polynomial about the middles of boxes.

    Attributes:
        algebra: Algebra of the models it makes; its first variables are (t, x). The
            polynomial does not depend on further ones (controls).
    """

    def __init__(
        self, step: Step, algebra: Algebra, middle: Array, radius: Array
    ) -> None:
        """Expand a polynomial.

        Args:
            step: Step with the polynomial.
            algebra: Algebra of the models.
            middle: Middles of the boxes, floats, shape (d, N).
            radius: Radii of the boxes, shape (d, N).
        """
        self.algebra = algebra
        half = np.array(step.half)[:, None]
        self.radius = (
            radius[: len(half)] / half
        )  # its rounding counts as the powers' own
        self.dimensions = len(step.middle)
        shape = [
            1 + max((e[a] for e in step.exponents), default=0)
            for a in range(self.dimensions)
        ]
        tensor = np.zeros(shape)
        excess = np.zeros(shape)
        for e, coefficient in zip(step.exponents, step.coefficients, strict=True):
            tensor[e] += coefficient  # a product given twice counts twice
            excess[e] += abs(coefficient)
        self._sizes = excess
        tables = [
            _table(middle[a], step.middle[a], step.half[a], size)
            for a, size in enumerate(shape)
        ]
        self._tables = [table for table, _ in tables]
        self._radii = [radii for _, radii in tables]
        self._taylor = _contracted(tensor, self._tables)
        self._half = step.half

    def value(self) -> Model:
        """Return the polynomial as models."""
        return self._model(None)

    def derivative(self, axis: int) -> Model:
        """Return the polynomial's derivative by t (axis 0) or a state as models."""
        return self._model(axis)

    def _model(self, axis: int | None) -> Model:
        taylor = self._taylor
        if axis is not None:
            orders = np.arange(taylor.shape[1 + axis], dtype=np.float64)
            wide = [1] * taylor.ndim
            wide[1 + axis] = -1
            taylor = np.moveaxis(taylor * orders.reshape(wide), 1 + axis, 1)[:, 1:]
            taylor = np.moveaxis(taylor, 1, 1 + axis)
        count = taylor.shape[0]
        for a in range(self.dimensions):
            powers = _powers(self.radius[a], taylor.shape[1 + a])
            wide = [count] + [1] * self.dimensions
            wide[1 + a] = -1
            taylor = taylor * powers.reshape(wide)
        flat = taylor.reshape(count, -1)
        coefficients = np.zeros((len(self.algebra.monomials), count))
        rest = np.ones(flat.shape[1], dtype=bool)
        for k, place in enumerate(np.ndindex(taylor.shape[1:])):
            if sum(place) <= ORDER:
                unused = (0,) * (self.algebra.d - self.dimensions)
                coefficients[self.algebra.numbers[(*place, *unused)]] = flat[:, k]
                rest[k] = False
        error = np.abs(flat[:, rest]).sum(axis=1) if rest.any() else np.zeros(count)
        total = (error + self._noise(axis)) * GROWTH + TINY
        found = Model(self.algebra, coefficients, total)
        if axis is None:
            return found
        # 1/half is a rounded float; `scaled` allows for many more roundings than that.
        return found.scaled(1.0 / self._half[axis])

    def _noise(self, axis: int | None) -> Array:
        """Return upper bounds of the rounding of all sums, shape (N,)."""
        share, rows = np.zeros(self.radius.shape[1]), []
        for a in range(self.dimensions):
            table, radii = np.abs(self._tables[a]), self._radii[a]
            size = table.shape[2]
            weights, shift = np.ones(size), 0
            if a == axis:
                weights, shift = np.arange(size, dtype=np.float64), 1
            powers = np.zeros((len(share), size))
            powers[:, shift:] = _powers(self.radius[a], size - shift)
            powers *= weights
            off = np.einsum("nep,np->ne", radii, powers)
            row = np.einsum("nep,np->ne", table + radii, powers)
            # 0 for the derivative of T_0, and a divisor below; a larger row is valid
            # too.
            row = np.maximum(row, 1.0)
            share = np.maximum(share, (off / row).max(axis=1))
            rows.append(row)
        total = self._sizes[None]
        for row in rows:
            total = np.einsum("ne,ne...->n...", row, np.broadcast_to(
                total, (len(row), *total.shape[1:])))  # fmt: skip
        factor = np.expm1(self.dimensions * np.log1p(share)) + _ROUNDING
        noise: Array = np.asarray(factor * total * GROWTH, dtype=np.float64)
        return noise


def _powers(radius: Array, count: int) -> Array:
    """Return radius^0, ..., shape (N, count)."""
    powers = np.ones((radius.size, count))
    for p in range(1, count):
        powers[:, p] = powers[:, p - 1] * radius
    return powers


def _table(y: Array, middle: float, half: float, size: int) -> tuple[Array, Array]:
    """Return T_n^[p] at z(y) and radii of balls about them, each (N, size, size)."""
    z = (y - middle) / half
    z_radius = np.abs(z) * 2.0**-50  # A difference and a quotient are rounded.
    table = np.zeros((y.size, size, size))
    radii = np.zeros_like(table)
    table[:, 0, 0] = 1.0
    if size > 1:
        table[:, 1, 0], radii[:, 1, 0] = z, z_radius
        table[:, 1, 1] = 1.0
    reach = np.abs(z)[:, None]
    for e in range(2, size):
        last, before = table[:, e - 1], table[:, e - 2]
        lowered = np.zeros_like(last)
        lowered[:, 1:] = last[:, :-1]
        off = np.zeros_like(last)
        off[:, 1:] = radii[:, e - 1, :-1]
        table[:, e] = 2.0 * z[:, None] * last + 2.0 * lowered - before
        size_of = 2.0 * reach * np.abs(last) + 2.0 * np.abs(lowered) + np.abs(before)
        radius = 2.0 * (reach + z_radius[:, None]) * radii[:, e - 1] + 2.0 * off
        radius += radii[:, e - 2] + 2.0 * z_radius[:, None] * np.abs(last)
        radii[:, e] = (radius + 2.0**-50 * size_of) * GROWTH + TINY
    return table, radii


def _contracted(tensor: Array, tables: list[Array]) -> Array:
    """Return the Taylor coefficients, shape (N, size_0, size_1, ...)."""
    count = len(tables[0])
    total = np.broadcast_to(tensor[None], (count, *tensor.shape))
    for a, table in enumerate(tables):
        moved = np.moveaxis(total, 1 + a, 1)
        flat = moved.reshape(count, moved.shape[1], -1)
        mixed = np.matmul(table.transpose(0, 2, 1), flat)
        total = np.moveaxis(mixed.reshape(count, -1, *moved.shape[2:]), 1, 1 + a)
    return np.ascontiguousarray(total)
