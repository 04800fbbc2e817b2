"""Taylor models on NumPy arrays: cubic polynomials with a rigorous error over a box.

A function over the box y = middle + radius * s, s in [-1, 1]^d, is enclosed by

    sum over monomials m of c_m s^m  +  [-error, error],   degree of m <= ORDER

The coefficients are floats; all rounding and truncation is added to the error, so that
the enclosure holds for real arithmetic (Berz and Makino (1998), Reliable Computing
4(4), "Verified integration of ODEs using differential algebraic methods on high-order
Taylor models"). A batch of boxes is computed at once, one per column.

A function g of a model a = a_0 + N, with |N| <= rho over the box, is

    sum for k <= ORDER of g_k N^k  +  g^(ORDER+1)(xi) / (ORDER+1)! N^(ORDER+1)

with g_k = g^(k)(a_0)/k! and xi within rho of a_0 (Taylor, Lagrange's remainder).

Rounding is bounded as follows. A float sum of fewer than 50 products of two floats has
an error below 2^-46 times the sum of the products' absolute values (Higham (2002),
section 3.1: gamma_51 < 2^-47), and an underflow below TINY. Sums and products of
nonnegative floats, as in the errors themselves, have a relative error below 2^-40, so
that a factor GROWTH makes them upper bounds.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ORDER = 3
ROUNDING = 2.0**-46
GROWTH = 1.0 + 2.0**-40
TINY = 1e-200
ELEMENTARY = 2.0**-44
"""Relative error of the float formulas of g_k: 16 ulp and a few roundings."""


class Series(NamedTuple):
    """Taylor series of a function g about a number a_0, one for each box.

    Attributes:
        factors: g_0, ..., g_ORDER at a_0, each (N,).
        last: Upper bound of |g^(ORDER+1)| / (ORDER+1)! over the box.
        sizes: For each factor a size, (N,): the error of the factor is at most
            ELEMENTARY times this size.
    """

    factors: list[Array]
    last: Array
    sizes: list[Array]


@dataclass(frozen=True, eq=False)
class Algebra:
    """The monomials in d variables up to ORDER, and their products.

    Attributes:
        d: Number of variables.
    """

    d: int

    @cached_property
    def monomials(self) -> NDArray[np.int64]:
        """Exponents, shape (M, d): 1, s_0, ..., s_d-1, then degree 2, degree 3."""
        powers = itertools.product(range(ORDER + 1), repeat=self.d)
        kept = [e for e in powers if sum(e) <= ORDER]
        kept.sort(key=lambda e: (sum(e), [-power for power in e]))
        return np.array(kept, dtype=np.int64).reshape(len(kept), self.d)

    @cached_property
    def degrees(self) -> NDArray[np.int64]:
        """Degree of each monomial, shape (M,)."""
        found: NDArray[np.int64] = self.monomials.sum(axis=1)
        return found

    @cached_property
    def starts(self) -> NDArray[np.int64]:
        """Index of the first monomial of each degree, shape (ORDER + 1,)."""
        return np.searchsorted(self.degrees, np.arange(ORDER + 1))

    @cached_property
    def numbers(self) -> dict[tuple[int, ...], int]:
        """Exponents -> index of the monomial."""
        return {tuple(map(int, e)): i for i, e in enumerate(self.monomials)}

    @cached_property
    def products(self) -> list[NDArray[np.int64]]:
        """Indices of products of two monomials, an array for each monomial i.

        Entry j is the index of the product with monomial j; products of a degree above
        ORDER are left out.
        """
        table = []
        for i, e in enumerate(self.monomials):
            most = ORDER - self.degrees[i]
            partners = self.monomials[self.degrees <= most]
            table.append(np.array([self.numbers[tuple(map(int, e + f))]
                                   for f in partners]))  # fmt: skip
        return table

    def constant(self, value: Array, error: Array | float = 0.0) -> Model:
        """Return the model of a number for each box, shape (N,)."""
        coefficients = np.zeros((len(self.monomials), value.size))
        coefficients[0] = value
        return Model(self, coefficients, np.zeros(value.size) + error)

    def variable(self, axis: int, middle: Array, radius: Array) -> Model:
        """Return middle + radius s_axis, exactly."""
        model = self.constant(middle)
        model.coefficients[1 + axis] = radius
        return model


@lru_cache(maxsize=8)
def algebra_of(d: int) -> Algebra:
    """Return the algebra in d variables, made once."""
    return Algebra(d)


class Model:
    """A batch of enclosures of functions f; it must not be changed after use.

    Attributes:
        algebra: The algebra of the monomials s^m.
        coefficients: Coefficients c_m, shape (M, N).
        error: Bound of the error, shape (N,), >= 0; NaN if nothing is known.
    """

    __slots__ = ("_sums", "algebra", "coefficients", "error")

    def __init__(self, algebra: Algebra, coefficients: Array, error: Array) -> None:
        """Keep the arrays, without a copy."""
        self.algebra = algebra
        self.coefficients = coefficients
        self.error = error
        self._sums: Array | None = None

    @property
    def sums(self) -> Array:
        """Sum of |c_m| over monomials of each degree, rounded up, (ORDER + 1, N)."""
        if self._sums is None:
            sizes = np.abs(self.coefficients)
            starts = [*self.algebra.starts, len(sizes)]
            pairs = itertools.pairwise(starts)
            self._sums = np.array([sizes[a:b].sum(axis=0) for a, b in pairs])
            self._sums *= GROWTH
        return self._sums

    @property
    def size(self) -> Array:
        """Upper bound of sum |c_m|, shape (N,)."""
        return np.asarray(self.sums.sum(axis=0) * GROWTH)

    @property
    def spread(self) -> Array:
        """Upper bound of |f - c_0| over the box, shape (N,)."""
        return np.asarray((self.sums[1:].sum(axis=0) + self.error) * GROWTH)

    @property
    def middle(self) -> Array:
        """c_0, shape (N,)."""
        return np.asarray(self.coefficients[0])

    @property
    def lower(self) -> Array:
        """Lower bound of f over each box, shape (N,)."""
        return down(self.middle - self.spread, self.middle, self.spread)

    @property
    def upper(self) -> Array:
        """Upper bound of f over each box, shape (N,)."""
        return -down(-self.middle - self.spread, self.middle, self.spread)

    def __add__(self, other: Model) -> Model:
        """Coefficient by coefficient."""
        total = self.coefficients + other.coefficients
        return self._rounded(total, self.error + other.error, other)

    def __sub__(self, other: Model) -> Model:
        """Coefficient by coefficient."""
        total = self.coefficients - other.coefficients
        return self._rounded(total, self.error + other.error, other)

    def __neg__(self) -> Model:
        """Coefficient by coefficient, exactly."""
        return Model(self.algebra, -self.coefficients, self.error)

    def _rounded(self, total: Array, error: Array, other: Model) -> Model:
        rounded = ROUNDING * (self.size + other.size)
        return Model(self.algebra, total, (error + rounded) * GROWTH + TINY)

    def number(self, value: Array | float, error: Array | float = 0.0) -> Model:
        """A number known to within an error, over the same boxes."""
        return self.algebra.constant(0.0 * self.error + value, error)

    def scaled(self, factor: Array | float, off: float = 0.0) -> Model:
        """The model times a float known to within `off`; arrays hold one per box."""
        size = np.abs(factor)
        error = (size * self.error + ROUNDING * size * self.size) * GROWTH + TINY
        scaled = Model(self.algebra, self.coefficients * factor, error)
        return scaled.widened((self.size + self.error) * off) if off else scaled

    def absolute(self) -> Model:
        """The absolute value |a| of this model a.

        If the sign of a is not known, |a| is enclosed in l a + [0, M] with a number l
        in [-1, 1] and an upper bound M of |a| - l a. As |a| - l a is convex, it is
        largest at one end of the range of a.
        """
        low, high = self.lower, self.upper
        with np.errstate(all="ignore"):
            slope = np.clip((high + low) / (high - low), -1.0, 1.0)
        # 0 if the sign is known, where the slope is clipped.
        half = 0.5 * np.maximum(high * (1.0 - slope), -low * (1.0 + slope))
        return self.scaled(slope).shifted(half, half)

    def composed(self, of: Callable[[Array, Model], Series]) -> Model:
        """The model of g(f), for a function g.

        Args:
            of: Function (numbers a_0, model) -> Taylor series of g about a_0, with a
                bound of its remainder over the model's range.
        """
        factors, last, sizes = of(self.middle, self)
        moving = self.coefficients.copy()
        moving[0] = 0.0
        rest = Model(self.algebra, moving, self.error)
        total = rest.scaled(factors[ORDER])
        for k in range(ORDER - 1, 0, -1):
            total = total.shifted(factors[k]) * rest
        total = total.shifted(factors[0])
        rho = rest.spread
        # Lagrange's remainder, the factors' errors, and underflow. Powers of rho alone
        # could underflow where their products with large factors do not.
        error = last
        for size in reversed(sizes):
            error = error * rho + ELEMENTARY * size
        return total.widened(error + TINY * rho**ORDER)

    def shifted(self, constant: Array | float, error: Array | float = 0.0) -> Model:
        """The model plus a float known to within an error, or arrays of one per box."""
        moved = self.coefficients.copy()
        moved[0] += constant
        rounded = ROUNDING * (np.abs(constant) + np.abs(self.coefficients[0]))
        total = (self.error + error + rounded) * GROWTH + TINY
        return Model(self.algebra, moved, total)

    def widened(self, error: Array) -> Model:
        """The model with more error."""
        total = (self.error + error) * GROWTH + TINY
        return Model(self.algebra, self.coefficients, total)

    def __mul__(self, other: Model) -> Model:
        """The product; what exceeds ORDER goes to the error."""
        a, b = self.coefficients, other.coefficients
        product = a[0] * b
        for i, targets in enumerate(self.algebra.products[1:], start=1):
            product[targets] += a[i] * b[: targets.size]
        p, q = self.sums, other.sums
        # Products of a degree above ORDER, by the sums of their factors' sizes.
        cut = np.zeros_like(p[0])
        for i in range(1, ORDER + 1):
            for j in range(ORDER + 1 - i, ORDER + 1):
                cut += p[i] * q[j]
        mine, its = self.size, other.size
        # (p + e)(q + f) - p q = p f + e (q + f).
        error = cut + mine * other.error + self.error * (its + other.error)
        error = (error + ROUNDING * mine * its) * GROWTH + TINY
        return Model(self.algebra, product, error)


def down(value: Array, *parts: Array) -> Array:
    """Return a value lowered by at least the rounding error of its sum.

    Args:
        value: A float sum or difference of the parts.
        parts: Its parts.
    """
    size = sum(np.abs(part) for part in parts)
    lowered: Array = value - (ROUNDING * size + TINY)
    # The subtraction itself is rounded: one float lower is below its exact value.
    return np.nextafter(lowered, -np.inf)
