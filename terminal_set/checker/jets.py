"""Truncated polynomials with ball coefficients: values, gradients, Taylor terms.

A jet a_0 + sum_k a_k m_k over nilpotent monomials m_k multiplies by
(ab)_k = a_0 b_k + a_k b_0 + sum over pairs m_i m_j = m_k of a_i b_j,
and a function of it is g(a) = g(a_0) + g'(a_0) N + g''(a_0)/2 N^2 with N = a - a_0,
since in every algebra used here N^3 = 0. With a ball for a_0, the coefficients enclose
the derivatives over that ball. None is a coefficient that is exactly zero.

Balls are those of Arb (Johansson (2017), IEEE Trans. Computers 66(8)).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from flint import arb

_WHOLE = 1023  # largest whole exponent raised by multiplication


def square(a: arb) -> arb:
    """The square by its ends: in ball arithmetic [-1, 1] times itself is [-1, 1]."""
    low, high = a.abs_lower(), a.abs_upper()
    return (low * low).union(high * high)


def absolute(a: arb) -> arb:
    """The absolute value by its ends."""
    return a.abs_lower().union(a.abs_upper())


def whole_power(a: arb, n: int) -> arb:
    """The n-th power by its ends, for whole n of either sign."""
    if n < 0:
        return 1 / whole_power(a, -n)
    if n % 2:
        return (a.lower() ** n).union(a.upper() ** n)
    return (a.abs_lower() ** n).union(a.abs_upper() ** n) if n else arb(1)


@dataclass(frozen=True, kw_only=True, slots=True)
class Algebra:
    """The monomials, and those of their products that are not zero.

    Attributes:
        monomials: Number of monomials beside 1.
        pairs: (i, j, k) for each product m_i m_j = m_k that is kept.
    """

    monomials: int
    pairs: tuple[tuple[int, int, int], ...] = ()

    def constant(self, value: arb | float) -> Jet:
        """The jet of a constant."""
        return Jet(self, [arb(value), *([None] * self.monomials)])

    def variable(self, value: arb, slopes: dict[int, arb]) -> Jet:
        """The jet value + sum_k slopes[k] m_k, k from 1."""
        return Jet(self, [value, *(slopes.get(k + 1) for k in range(self.monomials))])


VALUES = Algebra(monomials=0)
RAY = Algebra(monomials=2, pairs=((1, 1, 2),))  # s, s^2
RAY_AND_TIME = Algebra(  # s, s^2, t, t s
    monomials=4, pairs=((1, 1, 2), (1, 3, 4), (3, 1, 4))
)


class Jet:
    """A truncated polynomial; never changed once made."""

    __slots__ = ("algebra", "coefficients")

    def __init__(self, algebra: Algebra, coefficients: list[arb | None]) -> None:
        """Keep the list, without a copy."""
        self.algebra = algebra
        self.coefficients = coefficients

    @property
    def value(self) -> arb:
        """The coefficient of 1."""
        value = self.coefficients[0]
        return arb(0) if value is None else value

    def slope(self, k: int) -> arb:
        """The coefficient of m_k."""
        slope = self.coefficients[k]
        return arb(0) if slope is None else slope

    def __add__(self, other: Jet) -> Jet:
        """Coefficient by coefficient."""
        return Jet(
            self.algebra,
            [
                b if a is None else (a if b is None else a + b)
                for a, b in zip(self.coefficients, other.coefficients, strict=True)
            ],
        )

    def __neg__(self) -> Jet:
        """Coefficient by coefficient."""
        return Jet(self.algebra, [None if a is None else -a for a in self.coefficients])

    def __sub__(self, other: Jet) -> Jet:
        """Coefficient by coefficient."""
        return self + (-other)

    def scaled(self, factor: arb | float) -> Jet:
        """The jet times a constant."""
        return Jet(
            self.algebra, [None if a is None else a * factor for a in self.coefficients]
        )

    def __mul__(self, other: Jet) -> Jet:
        """The truncated product."""
        if self is other:
            return squared(self)
        a0, b0 = self.value, other.value
        result: list[arb | None] = [a0 * b0]
        for a, b in zip(self.coefficients[1:], other.coefficients[1:], strict=True):
            if a is None:
                result.append(None if b is None else a0 * b)
            else:
                result.append(a * b0 if b is None else a * b0 + a0 * b)
        for i, j, k in self.algebra.pairs:
            left, right = self.coefficients[i], other.coefficients[j]
            if left is not None and right is not None:
                result[k] = _plus(result[k], left * right)
        return Jet(self.algebra, result)

    def composed(self, value: arb, first: arb, second: Callable[[], arb]) -> Jet:
        """A function of the jet from its value and derivatives at a_0.

        Args:
            value: g(a_0).
            first: g'(a_0).
            second: Called for g''(a_0) if the algebra needs it.

        Returns:
            g of the jet.
        """
        result: list[arb | None] = [value]
        result += [None if a is None else first * a for a in self.coefficients[1:]]
        half = None
        for i, j, k in self.algebra.pairs:
            left, right = self.coefficients[i], self.coefficients[j]
            if left is not None and right is not None:
                half = second() / 2 if half is None else half
                # Narrower than the product of a ball and itself.
                term = square(left) if i == j else left * right
                result[k] = _plus(result[k], half * term)
        return Jet(self.algebra, result)


def _plus(a: arb | None, b: arb) -> arb:
    return b if a is None else a + b


def squared(a: Jet) -> Jet:
    """The square."""
    return a.composed(square(a.value), 2 * a.value, lambda: arb(2))


def inverse(a: Jet) -> Jet:
    """1/a."""
    r = 1 / a.value
    return a.composed(r, -square(r), lambda: 2 * whole_power(r, 3))


def _sine(a: Jet) -> Jet:
    sine, cosine = a.value.sin_cos()
    return a.composed(sine, cosine, lambda: -sine)


def _cosine(a: Jet) -> Jet:
    sine, cosine = a.value.sin_cos()
    return a.composed(cosine, -sine, lambda: -cosine)


def _tangent(a: Jet) -> Jet:
    t = a.value.tan()
    first = 1 + square(t)
    return a.composed(t, first, lambda: 2 * t * first)


def _exponential(a: Jet) -> Jet:
    e = a.value.exp()
    return a.composed(e, e, lambda: e)


def _logarithm(a: Jet) -> Jet:
    r = 1 / a.value
    return a.composed(a.value.log(), r, lambda: -square(r))


def _root(a: Jet) -> Jet:
    r = a.value.sqrt()
    return a.composed(r, 1 / (2 * r), lambda: -1 / (4 * whole_power(r, 3)))


def _arctangent(a: Jet) -> Jet:
    d = 1 / (1 + square(a.value))
    return a.composed(a.value.atan(), d, lambda: -2 * a.value * square(d))


def _hyperbolic_tangent(a: Jet) -> Jet:
    t = a.value.tanh()
    d = 1 - square(t)
    return a.composed(t, d, lambda: -2 * t * d)


def _absolute(a: Jet) -> Jet:
    if a.value > 0:
        return a
    if a.value < 0:
        return -a
    # The mean-value theorem holds with some slope between those of both sides of the
    # kink; a second derivative does not exist there.
    return a.composed(absolute(a.value), arb(-1).union(arb(1)), lambda: arb("nan"))


def _larger(a: Jet, b: Jet) -> Jet:
    if a.value > b.value:
        return a
    if a.value < b.value:
        return b
    result: list[arb | None] = [a.value.max(b.value)]
    for k in range(1, a.algebra.monomials + 1):
        # Of first derivatives alone, one between both sides is right: see `_absolute`.
        smooth = not a.algebra.pairs
        result.append(a.slope(k).union(b.slope(k)) if smooth else arb("nan"))
    return Jet(a.algebra, result)


def _smaller(a: Jet, b: Jet) -> Jet:
    return -_larger(-a, -b)


def _power(a: Jet, b: Jet) -> Jet:
    exponent = b.value
    constant = all(slope is None for slope in b.coefficients[1:])
    if not (constant and exponent.is_exact()):
        return _exponential(b * _logarithm(a))
    if not (exponent.is_integer() and abs(exponent) < _WHOLE):
        value = (exponent * a.value.log()).exp()
        first = exponent * ((exponent - 1) * a.value.log()).exp()
        return a.composed(
            value, first, lambda: exponent * (exponent - 1) * value / square(a.value)
        )
    n = int(float(exponent))
    first = n * whole_power(a.value, n - 1) if n else arb(0)
    return a.composed(
        whole_power(a.value, n),
        first,
        lambda: n * (n - 1) * whole_power(a.value, n - 2) if n * (n - 1) else arb(0),
    )


OPERATIONS: dict[str, Callable[..., Jet]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a * inverse(b),
    "pow": _power,
    "fmin": _smaller,
    "fmax": _larger,
    "neg": lambda a: -a,
    "sq": squared,
    "twice": lambda a: a.scaled(2),
    "inv": inverse,
    "fabs": _absolute,
    "sqrt": _root,
    "sin": _sine,
    "cos": _cosine,
    "tan": _tangent,
    "exp": _exponential,
    "log": _logarithm,
    "atan": _arctangent,
    "tanh": _hyperbolic_tangent,
}


def combination(rows: Sequence[Sequence[arb]], jets: Sequence[Jet]) -> list[Jet]:
    """The matrix `rows` times a vector of jets."""
    result = []
    for row in rows:
        total = jets[0].scaled(row[0])
        for factor, jet in zip(row[1:], jets[1:], strict=True):
            total = total + jet.scaled(factor)
        result.append(total)
    return result
