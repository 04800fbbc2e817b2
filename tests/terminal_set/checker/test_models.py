"""Operations of Taylor models enclose, and closely, what exact fractions give."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.terminal_set.checker.models import (
    ELEMENTARY,
    ORDER,
    ROUNDING,
    TINY,
    Model,
    Series,
    algebra_of,
    down,
)

Terms = dict[tuple[int, ...], Fraction]
COUNT = 120


def random_model(seed: int, d: int = 2) -> Model:
    """Sizes vary by column; in some there are numbers only, or an error only."""
    rng, algebra = np.random.default_rng(seed), algebra_of(d)
    shape = (len(algebra.monomials), COUNT)
    coefficients = rng.normal(size=shape) * rng.choice([0.0, 1e-8, 1.0, 1.0], shape)
    coefficients *= 10.0 ** rng.integers(-9, 9, COUNT)
    coefficients[1:, ::4] = 0.0
    coefficients[:, 1::8] = 0.0
    error = np.abs(rng.normal(size=COUNT)) * 10.0 ** rng.integers(-9, 9, COUNT)
    error[rng.random(COUNT) < 0.5] = 0.0
    return Model(algebra, coefficients, error)


def terms_of(model: Model, k: int) -> Terms:
    pairs = zip(model.algebra.monomials, model.coefficients[:, k], strict=True)
    return {tuple(map(int, e)): Fraction(float(c)) for e, c in pairs}


def error_of(model: Model, k: int) -> Fraction:
    return Fraction(float(model.error[k]))


def total(terms: Terms) -> Fraction:
    return sum(map(abs, terms.values()), Fraction(0))


def product(a: Terms, b: Terms) -> Terms:
    found: Terms = {}
    for (e, c), (f, d) in itertools.product(a.items(), b.items()):
        place = tuple(map(sum, zip(e, f, strict=True)))
        found[place] = found.get(place, Fraction(0)) + c * d
    return found


def assert_close(
    found: Model, k: int, exact: Terms, error: Fraction, rounded: Fraction
) -> None:
    """The polynomial is the exact one but for rounding, the error the exact one.

    Args:
        found: The model.
        k: Number of its column.
        exact: The polynomial without rounding, of any degree.
        error: Other parts of the error.
        rounded: Sum of sizes that were rounded.
    """
    terms = terms_of(found, k)
    off = sum(
        (abs(terms.get(e, Fraction(0)) - c) for e, c in exact.items()), Fraction(0)
    )
    rest = sum((abs(c) for e, c in terms.items() if e not in exact), Fraction(0))
    assert error + off + rest <= error_of(found, k)
    left_out = sum((abs(c) for e, c in exact.items() if sum(e) > ORDER), Fraction(0))
    most = error * (1 + Fraction(1, 10**11)) + left_out
    most += Fraction(ROUNDING) * rounded * Fraction(21, 20) + Fraction(4 * TINY)
    assert error_of(found, k) <= most


def test_sums_and_differences_are_close() -> None:
    a, b = random_model(0), random_model(1)
    for sign, found in ((1, a + b), (-1, a - b), (1, b + a)):
        for k in range(COUNT):
            first, second = terms_of(a, k), terms_of(b, k)
            exact = {e: c + sign * second[e] for e, c in first.items()}
            error = error_of(a, k) + error_of(b, k)
            assert_close(found, k, exact, error, total(first) + total(second))


def test_a_model_with_its_sign_changed_is_exact() -> None:
    a = random_model(2)
    np.testing.assert_array_equal((-a).coefficients, -a.coefficients)
    np.testing.assert_array_equal((-a).error, a.error)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_products_are_close(d: int) -> None:
    a, b = random_model(3, d), random_model(4, d)
    found = a * b
    for k in range(COUNT):
        p, q, e, f = terms_of(a, k), terms_of(b, k), error_of(a, k), error_of(b, k)
        exact = product(p, q)
        kept = {place: c for place, c in exact.items() if sum(place) <= ORDER}
        # What is above the order is bounded by sums over each degree.
        above = [
            sum((abs(c) for g, c in terms.items() if sum(g) == degree), Fraction(0))
            for terms in (p, q)
            for degree in range(ORDER + 1)
        ]
        cut = sum(
            (above[i] * above[ORDER + 1 + j]
             for i in range(ORDER + 1) for j in range(ORDER + 1) if i + j > ORDER),
            Fraction(0),
        )  # fmt: skip
        error = cut + total(p) * f + e * (total(q) + f)
        assert_close(found, k, kept, error, total(p) * total(q))


@pytest.mark.parametrize("off", [0.0, 1e-3])
def test_multiples_are_close(off: float) -> None:
    a = random_model(5)
    rng = np.random.default_rng(5)
    each = rng.normal(size=COUNT) * 10.0 ** rng.integers(-9, 9, COUNT)
    for factor in (each, -3.7e5, 1e-7, 0.0):
        found = a.scaled(factor, off)
        for k in range(COUNT):
            by = Fraction(float(np.broadcast_to(factor, COUNT)[k]))
            terms = terms_of(a, k)
            exact = {e: c * by for e, c in terms.items()}
            error = abs(by) * error_of(a, k)
            error += Fraction(off) * (error_of(a, k) + total(terms))
            assert_close(found, k, exact, error, abs(by) * total(terms))


@pytest.mark.parametrize("off", [0.0, 1e-3])
def test_shifts_are_close(off: float) -> None:
    a = random_model(6)
    rng = np.random.default_rng(6)
    each = rng.normal(size=COUNT) * 10.0 ** rng.integers(-9, 9, COUNT)
    for number in (each, 1e6, -1e-6, 0.0):
        found = a.shifted(number, off)
        for k in range(COUNT):
            by = Fraction(float(np.broadcast_to(number, COUNT)[k]))
            exact = terms_of(a, k)
            size = abs(by) + abs(exact[0, 0])
            exact[0, 0] += by
            assert_close(found, k, exact, error_of(a, k) + Fraction(off), size)


def test_more_error_is_only_that() -> None:
    a = random_model(7)
    more = np.abs(random_model(8).error)
    found = a.widened(more)
    for k in range(COUNT):
        error = error_of(a, k) + Fraction(float(more[k]))
        assert_close(found, k, terms_of(a, k), error, Fraction(0))


def test_numbers_and_variables_are_models_without_rounding() -> None:
    algebra = algebra_of(2)
    middle, radius = np.array([1.0, -2.0]), np.array([0.5, 0.25])
    x = algebra.variable(1, middle, radius)
    assert terms_of(x, 0) == dict.fromkeys(terms_of(x, 0), 0) | {(0, 0): 1, (0, 1): 0.5}
    assert not x.error.any()
    wide = x.widened(np.array([7.0, 0.0]))
    for number, off in ((3.0, 0.0), (np.array([3.0, 4.0]), np.array([0.5, 0.0]))):
        found = wide.number(number, off)
        assert (found.middle == number).all() and not found.coefficients[1:].any()
        assert (found.error == off).all() and found.error.shape == (2,)


def bounds(model: Model, k: int) -> tuple[Fraction, Fraction]:
    terms = terms_of(model, k)
    middle = terms.pop((0, 0))
    spread = total(terms) + error_of(model, k)
    return middle - spread, middle + spread


def test_sizes_and_bounds_are_close_to_exact_sums() -> None:
    a = random_model(9)
    near = 1 + Fraction(4, 10**12)
    for k in range(COUNT):
        terms = terms_of(a, k)
        for degree in range(ORDER + 1):
            exact = total({e: c for e, c in terms.items() if sum(e) == degree})
            assert exact <= Fraction(float(a.sums[degree, k])) <= exact * near
        assert total(terms) <= Fraction(float(a.size[k])) <= total(terms) * near
        low, high = bounds(a, k)
        spread = (high - low) / 2
        assert spread <= Fraction(float(a.spread[k])) <= spread * near
        room = Fraction(1, 10**11) * (spread + abs(terms[0, 0])) + Fraction(2 * TINY)
        assert low - room <= Fraction(float(a.lower[k])) < low
        assert high < Fraction(float(a.upper[k])) <= high + room
        assert a.middle[k] == a.coefficients[0, k]


def test_a_sum_is_lowered_by_a_share_of_its_parts() -> None:
    rng = np.random.default_rng(10)
    x, y, z = rng.normal(size=(3, 300)) * 10.0 ** rng.integers(-9, 9, (3, 300))
    z[::3] = x[::3] = 0.0
    found = down(x - y + z, x, y, z)
    for k in range(300):
        parts = [Fraction(float(part[k])) for part in (x, y, z)]
        size = sum(map(abs, parts), Fraction(0))
        exact = parts[0] - parts[1] + parts[2]
        assert exact - Fraction(ROUNDING) * size * Fraction(11, 10) - Fraction(
            2 * TINY
        ) <= Fraction(float(found[k]))
        assert Fraction(float(found[k])) <= exact - Fraction(ROUNDING / 2) * size
    assert down(np.zeros(1), np.zeros(1))[0] < -TINY / 2
    # Even where the reserve is lost in the subtraction, it is lower.
    assert down(np.ones(1), np.zeros(1))[0] < 1.0


def test_an_absolute_value_is_a_line_and_half_of_what_is_above() -> None:
    """Slope (high + low) / (high - low), the most above it 2 |low| high / width."""
    algebra, count = algebra_of(1), 400
    rng = np.random.default_rng(11)
    middle, radius = rng.uniform(-2, 2, count), rng.uniform(0, 2, count)
    radius[::10] = 0.0
    x = algebra.variable(0, middle, radius)
    found = x.absolute()
    kinks = 0
    for k in range(count):
        c, r = Fraction(float(middle[k])), Fraction(float(radius[k]))
        low, high = c - r, c + r
        slope = (high + low) / (high - low) if low < 0 < high else (c > 0) - (c < 0)
        most = -2 * low * high / (high - low) if low < 0 < high else Fraction(0)
        terms = terms_of(found, k)
        size = 2 * float(abs(c) + r)
        assert float(terms[1,]) == pytest.approx(float(slope * r), abs=1e-11 * size)
        assert float(terms[0,]) == pytest.approx(
            float(slope * c + most / 2), abs=1e-11 * size
        )
        assert error_of(found, k) <= most / 2 + Fraction(1e-11 * size)
        for s in (Fraction(-1), Fraction(1), Fraction(1, 3), -c / (r or 1)):
            if abs(s) <= 1:
                off = abs(terms[0,] + terms[1,] * s - abs(c + r * s))
                assert off <= error_of(found, k)
        kinks += low < 0 < high
    assert 100 < kinks < 300


def test_of_an_unknown_model_no_absolute_value_is_known() -> None:
    algebra = algebra_of(1)
    for error in (np.inf, np.nan):
        with np.errstate(all="ignore"):
            found = algebra.constant(np.ones(1), error).absolute()
            assert not found.lower[0] > -np.inf
            assert not found.upper[0] < np.inf


def cubic(
    factors: list[float], last: float, sizes: list[float]
) -> Callable[[Array, Model], Series]:
    def series(at: Array, _: Model) -> Series:
        one = np.ones_like(at)
        return Series([f * one for f in factors], last * one, [s * one for s in sizes])

    return series


@pytest.mark.parametrize("error", [0.0, 1e-3])
def test_a_cubic_of_a_model_is_its_composition(error: float) -> None:
    """g_0 + g_1 N + g_2 N^2 + g_3 N^3, N = s + s^2 / 4 +- error, kept up to order 3."""
    algebra = algebra_of(1)
    x = algebra.variable(0, np.array([5.0]), np.array([0.5]))
    a = x + (x.shifted(-5.0) * x.shifted(-5.0))
    a = Model(algebra, a.coefficients, np.array([error]))
    moving = terms_of(a, 0)
    moving[0,] = Fraction(0)
    factors = [7.0, -2.0, 3.0, 0.5]
    exact: Terms = {(0,): Fraction(0)}
    power: Terms = {(0,): Fraction(1)}
    for factor in factors:
        for e, c in power.items():
            exact[e] = exact.get(e, Fraction(0)) + Fraction(factor) * c
        power = product(power, moving)
    plain = a.composed(cubic(factors, 0.0, [0.0] * 4))
    found = terms_of(plain, 0)
    for e in found:
        assert float(found[e]) == pytest.approx(float(exact[e]), abs=1e-13)
    above = sum(abs(c) for e, c in exact.items() if sum(e) > ORDER)
    spread = float(total(moving)) + error
    slopes = [abs(k * g) * spread ** (k - 1) for k, g in enumerate(factors) if k]
    assert error_of(plain, 0) >= above
    # Each step of Horner's rule bounds what it leaves out by itself.
    assert float(error_of(plain, 0)) <= 3 * float(above) + 1.5 * error * sum(slopes)
    noisy = a.composed(cubic(factors, 0.25, [1e3, 2e3, 4e3, 8e3]))
    more = 0.25 * spread**4 + ELEMENTARY * sum(
        size * spread**k for k, size in enumerate((1e3, 2e3, 4e3, 8e3))
    )
    added = float(error_of(noisy, 0) - error_of(plain, 0))
    assert added == pytest.approx(more, rel=1e-9)
    for place in range(4):
        sizes = [0.0] * 4
        sizes[place] = 1e12
        noisy = a.composed(cubic(factors, 0.0, sizes))
        added = float(error_of(noisy, 0) - error_of(plain, 0))
        assert added == pytest.approx(ELEMENTARY * 1e12 * spread**place, rel=1e-9)


def test_of_a_cubic_of_one_variable_nothing_is_cut_off() -> None:
    x = algebra_of(1).variable(0, np.array([5.0]), np.array([2.0]))
    found = x.composed(cubic([7.0, -2.0, 3.0, 0.5], 0.0, [0.0] * 4))
    assert found.coefficients[:, 0] == pytest.approx([7.0, -4.0, 12.0, 4.0], rel=1e-13)
    assert found.error[0] < 1e-11


@pytest.mark.parametrize("d", [1, 2, 4])
def test_monomials_come_by_degree_and_have_their_products(d: int) -> None:
    algebra = algebra_of(d)
    monomials = [tuple(map(int, e)) for e in algebra.monomials]
    every = itertools.product(range(ORDER + 1), repeat=d)
    assert sorted(monomials) == sorted(e for e in every if sum(e) <= ORDER)
    assert list(algebra.degrees) == sorted(map(sum, monomials))
    for axis in range(d):
        assert monomials[1 + axis] == tuple(int(i == axis) for i in range(d))
    for degree, start in enumerate(algebra.starts):
        assert algebra.degrees[start] == degree
        assert start == 0 or algebra.degrees[start - 1] == degree - 1
    for i, e in enumerate(monomials):
        partners = [f for f in monomials if sum(e) + sum(f) <= ORDER]
        expected = [tuple(map(sum, zip(e, f, strict=True))) for f in partners]
        assert [monomials[j] for j in algebra.products[i]] == expected
        assert algebra.numbers[e] == i
