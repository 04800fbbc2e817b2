"""Lower bounds over the controls, and over a box.

The least of b u + q u^2 over u in [lo, hi], q >= 0, is not evaluated: for any number v
in [lo, hi], with beta = b + 2 q v and w = u - v,

    b u + q u^2 = b v + q v^2 + beta w + q w^2

and beta w + q w^2 >= -beta^2 / (4 q) for all w. As lo - v <= w <= hi - v, it is also
>= -D. For beta > 0 let W = v - lo, for beta < 0 W = hi - v, and in each case R an upper
bound of |beta|. Then

    D = R^2 / (4 q)  if R <= 2 q W,  else W (R - q W),

and D is the larger of its two values, one for each sign of beta. If v is near the
minimiser at the box's middle, beta is small in the first bound, and -beta^2 / (4 q)
joins the quadratic part of the Taylor model. The second bound is better if the
minimiser is at an end of [lo, hi], or if q is small or 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from swarmstart.terminal_set.checker.evaluation import rounded
from swarmstart.terminal_set.checker.models import (
    GROWTH,
    ROUNDING,
    TINY,
    Array,
    Model,
)
from swarmstart.terminal_set.checker.search import pulls


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """The term b u + q u^2 of one control u.

    Attributes:
        factor: b, over boxes.
        q: The factor q of the square, at least 0.
        lower: Lower bound of u.
        upper: Upper bound of u.
    """

    factor: Model
    q: Fraction
    lower: float
    upper: float


@dataclass(frozen=True, slots=True, eq=False)
class Least:
    """Bounds of the least value over the controls, as functions of (t, x).

    Attributes:
        below: Models whose lower bounds are lower bounds of the least value.
        at: Models of the values at some admissible controls, which are not below the
            least value.
        pull: Estimate of how much worse the bound is because of the width of the box in
            each variable, in addition to the variation of `below`, shape (d, N); a box
            is cut along the variable of the largest estimate.
    """

    below: Model
    at: Model
    pull: Array


def least_over_controls(fixed: Model, terms: list[Term]) -> Least:
    """Return bounds of `fixed` plus the least values of all terms.

    Args:
        fixed: Part that no control changes.
        terms: A term for each control.
    """
    d, count = fixed.algebra.d, fixed.error.size
    pull = np.zeros((d, count))
    below, at = fixed, fixed
    for term in terms:
        # NaN if it is beyond floats. Its rounding changes the least by a part of q u^2,
        # at most 2 q v^2 + 2 q (u - v)^2: less than the reserves of `shifted` and of D.
        q, _ = rounded(term.q)
        v = _choice(term, q)
        chosen = term.factor.scaled(v).shifted(q * v * v)
        below, at = below + chosen, at + chosen
        below, lost = _less_loss(below, term, q, v)
        pull += lost
    return Least(below, at, pull)


def _choice(term: Term, q: float) -> Array:
    """Return v within the bounds, near the minimiser at the middle."""
    b = term.factor.middle
    if q > 0.0:
        with np.errstate(all="ignore"):
            v = np.clip(-b / (2.0 * q), term.lower, term.upper)
    else:
        v = np.where(b > 0.0, term.lower, term.upper)
    # Any number within the bounds is a valid v.
    return np.where(np.isnan(v), term.lower, v)


def _less_loss(below: Model, term: Term, q: float, v: Array) -> tuple[Model, Array]:
    """Return the model less the bound of -(beta w + q w^2), and its pull."""
    b = term.factor
    beta = b.middle + 2.0 * q * v
    doubt = ROUNDING * (np.abs(b.middle) + 2.0 * q * np.abs(v)) + TINY
    # `doubt` and `spread` exceed the sums' roundings; the models' errors all others.
    above = np.maximum(beta + b.spread + doubt, 0.0)
    under = np.maximum(b.spread - beta + doubt, 0.0)
    flat = np.maximum(_most(above, v - term.lower, q), _most(under, term.upper - v, q))
    bends = np.zeros(flat.shape, dtype=bool)
    if q > 0.0:
        bends = np.maximum(above, under) ** 2 / (4.0 * q) <= flat
    lost = np.where(bends, 0.0, flat)
    width = term.upper - term.lower
    pull = np.where(bends | (flat == 0.0), 0.0, width) * pulls(b)
    below = below.widened(lost)
    if bends.any():
        kappa = np.where(bends, 1.0 / (4.0 * q), 0.0)
        below = _less_square(below, b, kappa, np.abs(beta) + doubt)
    return below, pull


def _most(R: Array, W: Array, q: float) -> Array:
    """Return D; 0 * inf is NaN, which rightly stands for an unknown bound."""
    if not q > 0.0:
        return W * R
    with np.errstate(all="ignore"):
        return np.where(R <= 2.0 * q * W, R**2 / (4.0 * q), W * (R - q * W))


def _less_square(below: Model, b: Model, kappa: Array, offset: Array) -> Model:
    """Return below - kappa (offset + the moving part of b)^2, offset in +-.

    With l the linear part and e bounding the rest, the square is <= l^2 + 2|l|e + e^2.
    """
    d, c = b.algebra.d, below.coefficients.copy()
    slopes = b.coefficients[1 : 1 + d]
    for i in range(d):
        for j in range(i, d):
            exponents = [0] * d
            exponents[i] += 1
            exponents[j] += 1
            place = b.algebra.numbers[tuple(exponents)]
            c[place] -= kappa * slopes[i] * slopes[j] * (1.0 if i == j else 2.0)
    reach = b.sums[1]
    rest = offset + b.sums[2:].sum(axis=0) + b.error
    # What is subtracted is rounded, and has no reserve yet.
    lost = kappa * (2.0 * reach * rest + rest * rest + ROUNDING * reach * reach)
    return Model(below.algebra, c, (below.error + lost) * GROWTH + TINY)
