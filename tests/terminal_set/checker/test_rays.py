"""Values along rays from the origin: a(rho) = a(0) + rho b(rho), in exact fractions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.terminal_set.checker.models import (
    ELEMENTARY,
    Model,
    Series,
    algebra_of,
)
from swarmstart.terminal_set.checker.rays import Along
from swarmstart.tests.terminal_set.checker.test_models import cubic, terms_of, total

ALGEBRA = algebra_of(2)
REACH = Fraction(1, 4)  # rho = (1 + s_0) / 4
RHO = ALGEBRA.variable(0, np.array([0.25]), np.array([0.25]))
SHARES = [(Fraction(a, 4), Fraction(b, 4)) for a in (-4, -1, 2, 4) for b in (-4, 1, 4)]


def random_along(seed: int, error: float = 0.0) -> Along:
    """a(0) is linear in s_1, b in both."""
    rng = np.random.default_rng(seed)
    at, slope = np.zeros((2, len(ALGEBRA.monomials), 1))
    at[[0, 2], 0] = rng.normal(size=2)
    slope[:3, 0] = rng.normal(size=3)
    errors = error * np.array([[1.0], [2.0]])
    return Along(Model(ALGEBRA, at, errors[0]), Model(ALGEBRA, slope, errors[1]), RHO)


def at_share(model: Model, s: tuple[Fraction, Fraction]) -> Fraction:
    terms = terms_of(model, 0).items()
    return sum((c * s[0] ** e[0] * s[1] ** e[1] for e, c in terms), Fraction(0))


def parts(along: Along, s: tuple[Fraction, Fraction]) -> tuple[Fraction, Fraction]:
    """a(0) and a(rho)."""
    start = at_share(along.at, s)
    return start, start + REACH * (1 + s[0]) * at_share(along.slope, s)


def assert_is(
    found: Along,
    s: tuple[Fraction, Fraction],
    start: Fraction,
    end: Fraction,
    error: float = 1e-12,
) -> None:
    """The models hold both values, and the slope between them."""
    slope = (end - start) / (REACH * (1 + s[0])) if s[0] > -1 else None
    for model, value in ((found.at, start), (found.value, end), (found.slope, slope)):
        if value is not None:
            assert abs(at_share(model, s) - value) <= Fraction(float(model.error[0]))
        assert model.error[0] < error
    assert found.rho is RHO


def test_arithmetic_is_that_of_the_values() -> None:
    a, b = random_along(0), random_along(1)
    for s in SHARES:
        (p, q), (u, v) = parts(a, s), parts(b, s)
        assert_is(a + b, s, p + u, q + v)
        assert_is(a - b, s, p - u, q - v)
        assert_is(-a, s, -p, -q)
        assert_is(a.scaled(2.5), s, p * Fraction(2.5), q * Fraction(2.5))
        assert_is(a.shifted(2.5), s, p + Fraction(2.5), q + Fraction(2.5))
        assert_is(a.number(2.5), s, Fraction(2.5), Fraction(2.5))
        # Of degree 2, and of degree 3 for its slope: nothing is cut but in the value.
        assert_is(a * b, s, p * u, q * v, error=1.0)
        assert (a * b).slope.error[0] < 1e-12


def test_errors_of_both_parts_are_kept() -> None:
    a, b = random_along(2, 1e-3), random_along(3, 1e-2)
    for found in (a + b, a - b):
        assert found.at.error[0] == pytest.approx(1.1e-2)
        assert found.slope.error[0] == pytest.approx(2.2e-2)
    more = a.scaled(-3.0, 0.5)
    for part, before in ((more.at, a.at), (more.slope, a.slope)):
        expected = 3.5 * before.error[0] + 0.5 * before.size[0]
        assert part.error[0] == pytest.approx(expected)
    assert a.shifted(1.0, 0.5).at.error[0] == pytest.approx(0.501)
    assert a.shifted(1.0, 0.5).slope is a.slope
    number = a.number(1.0, 0.5)
    assert number.at.error[0] == 0.5
    assert number.slope.error[0] == 0.0 and not number.slope.coefficients.any()


@pytest.mark.parametrize("middle", [-9.0, 0.1, 9.0])
def test_an_absolute_value_has_the_slope_of_the_sign(middle: float) -> None:
    for seed in range(20):
        a = random_along(seed, 1e-3)
        a = Along(a.at.shifted(middle - a.at.middle), a.slope, a.rho)
        found = a.absolute()
        slope, before = found.slope, a.slope
        start, end = map(abs, parts(a, SHARES[0]))
        assert_is(found, SHARES[0], start, end, error=99.0)
        if abs(middle) > 1:
            sign = np.sign(middle)
            np.testing.assert_array_equal(
                slope.coefficients, sign * before.coefficients
            )
            assert slope.error[0] == pytest.approx(before.error[0], rel=1e-9)
        else:  # It may change within the box: in [-1, 1] times the slope.
            assert not slope.coefficients.any()
            size = before.size[0] + before.error[0]
            assert slope.error[0] == pytest.approx(size, rel=1e-9)
            assert slope.error[0] >= size


FACTORS = [7.0, -2.0, 3.0, 0.5]


def test_a_cubic_along_a_ray_is_exact() -> None:
    """Of straight a(0) and b, its slope is of degree 2 in both; nothing is cut off."""
    a = random_along(4)
    straight = a.slope.coefficients.copy()
    straight[1:] = 0.0
    a = Along(a.at, Model(ALGEBRA, straight, a.slope.error), RHO)
    found = a.composed(cubic(FACTORS, 0.0, [0.0] * 4))
    c = Fraction(float(a.middle[0]))
    for s in SHARES:
        start, end = (
            Fraction(7) - 2 * (x - c) + 3 * (x - c) ** 2 + (x - c) ** 3 / 2
            for x in parts(a, s)
        )
        assert_is(found, s, start, end, error=99.0)
    assert found.slope.error[0] < 1e-12


@pytest.mark.parametrize("error", [0.0, 1e-3])
def test_the_remainder_of_a_slope_is_four_times_the_last_by_the_cube(
    error: float,
) -> None:
    a = random_along(5, error)
    plain = a.composed(cubic(FACTORS, 0.0, [0.0] * 4)).slope.error[0]
    moved = terms_of(a.at, 0)
    moved[0, 0] = Fraction(0)
    h = a.rho * a.slope
    reach = float(total(moved)) + error + h.size[0] + h.error[0]
    slope = a.slope.size[0] + a.slope.error[0]
    last = a.composed(cubic(FACTORS, 1e3, [0.0] * 4)).slope.error[0]
    assert last - plain == pytest.approx(slope * 4e3 * reach**3, rel=1e-9)
    # Factors' errors, by d/dh of h, h^2 and h^3; that of g_0 makes no slope.
    for k in range(4):
        sizes = [0.0] * 4
        sizes[k] = 1e15
        noisy = a.composed(cubic(FACTORS, 0.0, sizes)).slope.error[0]
        more = slope * ELEMENTARY * 1e15 * k * reach ** max(k - 1, 0)
        assert noisy - plain == pytest.approx(more, rel=1e-9)


def test_a_remainder_is_bounded_over_all_values_of_the_ray() -> None:
    a, seen = random_along(6, 1e-3), []

    def of(at: Array, model: Model) -> Series:
        seen.append((at, model))
        return cubic(FACTORS, 0.0, [0.0] * 4)(at, model)

    a.composed(of)
    (along, model), (start, at) = seen
    np.testing.assert_array_equal(along, a.at.middle)
    np.testing.assert_array_equal(model.coefficients, a.value.coefficients)
    np.testing.assert_array_equal(model.error, a.value.error)
    assert at is a.at and start is not None
