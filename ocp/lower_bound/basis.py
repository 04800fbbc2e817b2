"""Polynomials of time t and states x, as products of Chebyshev polynomials on a box.

Coefficients and box are inputs of the symbolic form, so that its derivatives are formed
once for all polynomials of a degree.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.stated.answer import Polynomial


@dataclass(frozen=True, eq=False)
class Basis:
    """All products of Chebyshev polynomials up to a total degree.

    Attributes:
        variables: Number of variables, t first.
        degree: Largest sum of exponents.
    """

    variables: int
    degree: int

    @cached_property
    def exponents(self) -> NDArray[np.int64]:
        """Exponents of each product, shape (size, variables); the first row is zero."""
        every = itertools.product(range(self.degree + 1), repeat=self.variables)
        kept = [e for e in every if sum(e) <= self.degree]
        return np.array(sorted(kept, key=lambda e: (sum(e), e)), dtype=np.int64)

    @property
    def size(self) -> int:
        """Number of products."""
        return len(self.exponents)

    def values(self, box: Box, points: Array) -> Array:
        """Return each product at each point, shape (N, size).

        Args:
            box: Box that the polynomials are scaled to.
            points: Shape (variables, N).
        """
        return self._products(self._powers(box.scaled(points)))

    def slopes(self, box: Box, points: Array) -> Array:
        """Return the derivatives of the products, shape (variables, N, size).

        Args:
            box: Box that the polynomials are scaled to.
            points: Shape (variables, N).
        """
        z = box.scaled(points)
        powers = self._powers(z)
        derived = np.zeros_like(powers)
        derived[:, 1:2] = 1.0
        for k in range(2, powers.shape[1]):
            # T_k = 2 z T_(k-1) - T_(k-2), differentiated.
            derived[:, k] = 2 * powers[:, k - 1] + 2 * z * derived[:, k - 1]
            derived[:, k] -= derived[:, k - 2]
        derived /= box.half[:, None, None]  # dz/dy.
        found = []
        for axis in range(self.variables):
            mixed = powers.copy()
            mixed[axis] = derived[axis]
            found.append(self._products(mixed))
        return np.array(found)

    def _powers(self, z: Array) -> Array:
        """Return T_k of each variable, shape (variables, degree + 1, N)."""
        powers = np.ones((self.variables, self.degree + 1, z.shape[1]))
        if self.degree:
            powers[:, 1] = z
        for k in range(2, self.degree + 1):
            powers[:, k] = 2 * z * powers[:, k - 1] - powers[:, k - 2]
        return powers

    def _products(self, powers: Array) -> Array:
        found = powers[0][self.exponents[:, 0]].copy()
        for axis in range(1, self.variables):
            found *= powers[axis][self.exponents[:, axis]]
        return np.asarray(found.T)

    @property
    def parameters(self) -> int:
        """Number of inputs of the symbolic form for the box and the coefficients."""
        return 2 * self.variables + self.size

    def expression(self, point: ca.SX, parameters: ca.SX) -> ca.SX:
        """Return the polynomial as an expression.

        Args:
            point: Symbols of the point, shape (variables, 1).
            parameters: Middle and half widths of the box, coefficients; shape
                (parameters, 1), see `packed`.
        """
        n = self.variables
        powers: list[list[ca.SX]] = []
        for axis in range(n):
            z = (point[axis] - parameters[axis]) / parameters[n + axis]
            row = [ca.SX(1), z]
            for k in range(2, self.degree + 1):
                row.append(2 * z * row[k - 1] - row[k - 2])
            powers.append(row)
        number = {tuple(e): j for j, e in enumerate(self.exponents.tolist())}

        def nested(axis: int, chosen: tuple[int, ...]) -> ca.SX:
            """Return the sum of the terms with given exponents in the first axes.

            The factors of the axes before `axis`, whose exponents are `chosen`, are
            left out; so nested sums need fewer products.
            """
            total = ca.SX(0)
            for k in range(self.degree + 1 - sum(chosen)):
                if axis < n - 1:
                    inner = nested(axis + 1, (*chosen, k))
                else:
                    inner = parameters[2 * n + number[(*chosen, k)]]
                total += inner * powers[axis][k] if k else inner
            return total

        return nested(0, ())

    def polynomial(self, box: Box, coefficients: Array) -> Polynomial:
        """Return a polynomial in the form that is stored as evidence."""
        return Polynomial(
            middle=box.middle,
            half=box.half,
            exponents=self.exponents,
            coefficients=coefficients.copy(),
        )


@dataclass(frozen=True, eq=False)
class Box:
    """A box that Chebyshev polynomials are scaled to.

    Attributes:
        middle: Middle of each side, shape (variables,).
        half: Half widths, shape (variables,), > 0.
    """

    middle: Array
    half: Array

    @classmethod
    def around(cls, lower: Array, upper: Array) -> Box:
        """Return the box between two corners; sides of length 0 are widened."""
        half = (upper - lower) / 2
        smallest = 1e-9 * max(1.0, float(np.abs([lower, upper]).max()))
        return cls((upper + lower) / 2, np.maximum(half, smallest))

    def scaled(self, points: Array) -> Array:
        """Return points, (variables, N), in coordinates in which the box is [-1, 1]."""
        return (points - self.middle[:, None]) / self.half[:, None]


def packed(polynomial: Polynomial) -> Array:
    """Return a polynomial's parameters for `Basis.expression`, (parameters,)."""
    return np.concatenate([polynomial.middle, polynomial.half, polynomial.coefficients])


def basis_of(polynomial: Polynomial) -> Basis:
    """Return the basis that a polynomial is written in."""
    exponents = polynomial.exponents
    return Basis(exponents.shape[1], int(exponents.sum(axis=1).max()))


def values_of(polynomial: Polynomial, points: Array) -> Array:
    """Return a polynomial's values at points (variables, N), shape (N,), in floats."""
    box = Box(polynomial.middle, polynomial.half)
    values = basis_of(polynomial).values(box, points)
    return np.asarray(values @ polynomial.coefficients)
