"""The least over controls is bounded from below, and tightly if it is smooth."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.terminal_set.checker.lower_bound.least import (
    Least,
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


def spread_of(b: Model, k: int) -> Fraction:
    rest = (abs(Fraction(float(c))) for c in b.coefficients[1:, k])
    return sum(rest, Fraction(float(b.error[k])))


def exact_loss(
    beta: Fraction, spread: Fraction, rooms: tuple[Fraction, Fraction], q: Fraction
) -> tuple[Fraction, bool | None]:
    """D, and whether it is the square of all of b; None if it is nearly either."""
    losses = []
    for reach, W in zip((beta + spread, spread - beta), rooms, strict=True):
        R = max(reach, Fraction(0))
        bends = q > 0 and R <= 2 * q * W
        losses.append((R, bends, R**2 / (4 * q) if bends else W * (R - q * W)))
    (less, other, _), (most, bends, _) = sorted(losses)
    is_sure = other == bends or most - less > Fraction(1, 10**9) * most
    return max(loss[2] for loss in losses), bends if is_sure else None


def assert_above(value: float, exact: Fraction, size: float) -> None:
    """The value is not below, and near."""
    assert exact <= Fraction(value) <= exact + Fraction(2, 10**11) * Fraction(size)


def rounding_of_square(
    least: Least, k: int, linear: tuple[Fraction, Fraction], q: Fraction, size: float
) -> Fraction:
    """The square of the linear part over 4 q is taken from the polynomial, no more."""
    first, second = linear
    squares: dict[tuple[int, ...], Fraction] = {
        (2, 0): first**2, (1, 1): 2 * first * second, (0, 2): second**2
    }  # fmt: skip
    off, algebra = Fraction(0), least.at.algebra
    for exponents, place in algebra.numbers.items():
        at, below = (
            Fraction(float(model.coefficients[place, k]))
            for model in (least.at, least.below)
        )
        one = abs(at - below - squares.get(exponents, Fraction(0)) / (4 * q))
        assert one <= Fraction(1e-12 * size) if exponents in squares else one == 0
        off += one
    return off


@pytest.mark.parametrize("q", [0.0, 1e-3, 0.1, 1.0, 50.0])
def test_what_is_lost_is_the_loss_of_exact_arithmetic(q: float) -> None:
    rng = np.random.default_rng(0)
    algebra, count, ends, exact = algebra_of(2), 600, (-1.0, 2.0), Fraction(q)
    fixed = random_model(rng, algebra, count)
    size = rng.choice([1e-6, 1e-2, 0.3, 1.0, 100.0], count) * max(q, 1e-2)
    b = random_model(rng, algebra, count)
    chosen = rng.choice([0.0, 1e-2, 1.0], b.coefficients.shape)
    share = rng.choice([0.0, 0.1], count)
    b = Model(algebra, size * chosen * b.coefficients, size * share * b.error)
    b.coefficients[0] *= rng.choice([1.0, 20.0, 500.0], count)
    least = least_over_controls(fixed, [Term(b, exact, *ends)])
    of_b = algebra.monomials.T @ np.abs(b.coefficients)
    kinds = []
    for k in range(count):
        v = np.clip(-b.middle[k] / (2 * q), *ends) if q else ends[int(b.middle[k] <= 0)]
        v = Fraction(float(v))
        beta = Fraction(float(b.middle[k])) + 2 * exact * v
        rooms = v - Fraction(ends[0]), Fraction(ends[1]) - v
        lost, bends = exact_loss(beta, spread_of(b, k), rooms, exact)
        kinds.append((bends, lost == 0))
        error = float(least.below.error[k])
        known = Fraction(float(fixed.error[k])) + abs(v) * Fraction(float(b.error[k]))
        whole = fixed.size[k] + fixed.error[k] + 3 * (b.size[k] + b.error[k] + 3 * q)
        moved = least.at.coefficients[:, k] - least.below.coefficients[:, k]
        if bends is False:
            assert_above(error, known + lost, whole)
            expected = 3.0 * of_b[:, k] if lost else np.zeros(2)
            np.testing.assert_allclose(least.pull[:, k], expected, rtol=1e-12)
            assert not moved.any()
        if bends:
            assert not least.pull[:, k].any()
            # The square of the linear part is in the polynomial, the rest in the error.
            first, second = (Fraction(float(c)) for c in b.coefficients[1:3, k])
            reach = abs(first) + abs(second)
            rest = spread_of(b, k) - reach + abs(beta)
            lost = (2 * reach * rest + rest**2) / (4 * exact)
            whole += float((reach + rest) ** 2 / exact)
            assert_above(error, known + lost, whole)
            off = rounding_of_square(least, k, (first, second), exact, whole)
            assert known + lost + off <= Fraction(error)
    for kind in [(False, False), (False, True), *[(True, False)] * (q > 0)]:
        assert kinds.count(kind) > 10


def test_the_chosen_control_minimises_at_the_middle() -> None:
    algebra = algebra_of(1)
    b = algebra.constant(np.array([-9.0, -1.0, 0.0, 1.0, 9.0, 0.0]))
    zero = algebra.constant(np.zeros(6))
    for q, least in (
        (0.0, [-18, -2, 0, -1, -9, 0]),
        (0.5, [-16, -0.5, 0, -0.5, -8.5, 0]),
    ):
        found = least_over_controls(zero, [Term(b, Fraction(q), -1.0, 2.0)])
        np.testing.assert_allclose(found.at.middle, least, atol=1e-15)
        np.testing.assert_allclose(lowest(found.below), least, atol=1e-11)
        assert (lowest(found.below) <= np.array(least)).all()
        assert (found.at.upper >= np.array(least)).all()


def test_each_control_is_lowered_by_itself() -> None:
    algebra = algebra_of(1)
    b = algebra.variable(0, np.array([0.5]), np.array([1.0]))
    term = Term(b, Fraction(0), -1.0, 1.0)
    one, two = (least_over_controls(b, [term] * n) for n in (1, 2))
    np.testing.assert_array_equal(two.pull, 2 * one.pull)
    # .5 + s - n (.5 + s), less 2 R = 2 (1 - .5) for each.
    assert lowest(one.below)[0] == pytest.approx(-1.0)
    assert lowest(two.below)[0] == pytest.approx(-0.5 - 1.0 - 2.0)
    assert two.at.middle[0] == pytest.approx(-0.5)


@pytest.mark.parametrize("q", [Fraction(1, 3), Fraction(2, 3), Fraction(1, 10)])
def test_a_weight_between_two_floats_is_rounded_down_in_the_bound(q: Fraction) -> None:
    algebra = algebra_of(1)
    b = algebra.constant(np.linspace(-2.0, 2.0, 401))
    least = least_over_controls(
        algebra.constant(np.zeros(401)), [Term(b, q, -1.0, 2.0)]
    )
    for k, middle in enumerate(b.middle.tolist()):
        u = min(max(-Fraction(middle) / (2 * q), Fraction(-1)), Fraction(2))
        exact = Fraction(middle) * u + q * u * u
        assert lowest(least.below)[k] <= exact <= least.at.upper[k]
        assert float(exact) - lowest(least.below)[k] < 1e-12


def test_of_a_weight_beyond_floats_nothing_is_known() -> None:
    algebra = algebra_of(1)
    b = algebra.variable(0, np.array([0.5]), np.array([1.0]))
    least = least_over_controls(b, [Term(b, Fraction(10) ** 400, -1.0, 1.0)])
    assert not lowest(least.below)[0] > -np.inf
    assert not least.at.upper[0] < np.inf
