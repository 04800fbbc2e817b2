"""The least over controls is bounded from below, and tightly if it is smooth."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.terminal_set.checker.lower_bound.least import (
    Term,
    least_over_controls,
)
from swarmstart.terminal_set.checker.models import Algebra, Model, algebra_of
from swarmstart.terminal_set.checker.search import lowest


def random_model(rng: np.random.Generator, algebra: Algebra, count: int) -> Model:
    size = rng.choice([1e-3, 0.1, 1.0, 10.0], size=count)
    shape = (len(algebra.monomials), count)
    return Model(algebra, rng.normal(size=shape) * size, rng.uniform(0, 0.1, count))


def values(model: Model, s: Array, off: Array) -> Array:
    """Values at s, shape (d, N), with a share of the error in [-1, 1]."""
    powers = np.prod(s[None] ** model.algebra.monomials[:, :, None], axis=1)
    total: Array = (powers * model.coefficients).sum(axis=0) + off * model.error
    return total


@pytest.mark.parametrize("q", [0.0, 1e-9, 0.02, 1.0, 50.0])
@pytest.mark.parametrize("d", [1, 2, 3])
def test_no_control_and_no_point_is_below_the_bound(q: float, d: int) -> None:
    rng = np.random.default_rng(d)
    algebra, count = algebra_of(d), 200
    fixed = random_model(rng, algebra, count)
    factors = [random_model(rng, algebra, count) for _ in range(2)]
    bounds = [(-1.0, 2.0), (0.5, 0.5 + 3 * q)]
    terms = [
        Term(factor, Fraction(q), *limits)
        for factor, limits in zip(factors, bounds, strict=True)
    ]
    least = least_over_controls(fixed, terms)
    lower = lowest(least.below)
    closest = np.full(count, np.inf)
    for trial in range(150):
        s = rng.uniform(-1, 1, size=(d, count))
        s = np.where(rng.random(s.shape) < 0.4, np.sign(s), s)
        off = rng.choice([-1.0, 1.0, 0.0], size=count)
        total = values(fixed, s, -np.ones(count))
        for term in terms:
            b = values(term.factor, s, off)
            v = -b / (2 * q) if q else np.where(b > 0, -np.inf, np.inf)
            u = np.clip(v, term.lower, term.upper)
            if trial % 2:
                u = rng.uniform(term.lower, term.upper, count)
            total = total + b * u + q * u * u
        closest = np.minimum(closest, total - lower)
    assert (closest >= 0.0).all()
    assert (least.at.upper >= lower).all()


def test_a_perfect_square_is_bounded_by_zero_over_any_box() -> None:
    # x^2 + min over u of (2 x u + u^2) = 0: u = -x, within the bounds.
    algebra = algebra_of(1)
    x = algebra.variable(0, np.array([0.3, -1.0]), np.array([0.5, 0.9]))
    term = Term(x.scaled(2.0), Fraction(1), -10.0, 10.0)
    lower = lowest(least_over_controls(x * x, [term]).below)
    assert (np.abs(lower) < 1e-8).all()


def test_a_switch_costs_what_the_worse_control_costs() -> None:
    # min over |u| <= 1 of b u = -|b|, b in [-.1, .3].
    algebra = algebra_of(1)
    b = algebra.variable(0, np.array([0.1]), np.array([0.2]))
    least = least_over_controls(
        algebra.constant(np.zeros(1)), [Term(b, Fraction(0), -1.0, 1.0)]
    )
    assert -0.5 - 1e-9 <= lowest(least.below)[0] <= -0.3


def test_where_a_control_is_clipped_all_over_nothing_is_lost() -> None:
    algebra = algebra_of(1)
    b = algebra.variable(0, np.array([5.0]), np.array([1.0]))
    for q in (0, 1):
        term = Term(b, Fraction(q), -1.0, 1.0)
        least = least_over_controls(b, [term])  # b + min(b u + q u^2) = q
        assert lowest(least.below)[0] == pytest.approx(q, abs=1e-10)


def test_what_is_not_known_is_not_bounded() -> None:
    algebra = algebra_of(1)
    b = algebra.constant(np.array([np.nan, 1.0]))
    for q in (0, 1):
        term = Term(b, Fraction(q), -1.0, 1.0)
        with np.errstate(all="ignore"):
            lower = lowest(least_over_controls(b, [term]).below)
        assert not lower[0] > -np.inf
        assert np.isfinite(lower[1])


def test_the_square_of_a_sum_is_subtracted_whole() -> None:
    # min over u of (s_0 + s_1) u + u^2 = -(s_0 + s_1)^2 / 4, at least -1.
    algebra = algebra_of(2)
    zero, one = np.zeros(1), np.ones(1)
    b = algebra.variable(0, zero, one) + algebra.variable(1, zero, one)
    least = least_over_controls(
        algebra.constant(zero), [Term(b, Fraction(1), -9.0, 9.0)]
    )
    assert lowest(least.below)[0] == pytest.approx(-1.0, abs=1e-8)
