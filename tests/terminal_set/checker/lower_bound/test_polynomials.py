"""Polynomials over boxes enclose their exact values and derivatives."""

from __future__ import annotations

import dataclasses
from fractions import Fraction

import numpy as np
import pytest

from swarmstart.terminal_set.checker.lower_bound.certificate_file import Step
from swarmstart.terminal_set.checker.lower_bound.polynomials import (
    Expansion,
    _table,
    exact_value,
)
from swarmstart.terminal_set.checker.models import Model, algebra_of

D = 3


def random_step(rng: np.random.Generator, degree: int) -> Step:
    exponents = sorted(
        {tuple(map(int, e)) for e in rng.integers(0, degree + 1, (40, D))}
    )
    kept = tuple(e for e in exponents if sum(e) <= degree)
    return Step(
        middle=tuple(rng.normal(size=D)),
        half=tuple(rng.uniform(0.5, 3.0, size=D)),
        exponents=kept,
        coefficients=tuple(rng.normal(size=len(kept)) * 100),
        slack=0.0,
        end_slack=None,
    )


def exact_derivative(step: Step, point: tuple[float, ...], axis: int) -> Fraction:
    """By T_e' = e U_(e-1), the polynomials of the second kind."""
    total = Fraction(0)
    for exponents, coefficient in zip(step.exponents, step.coefficients, strict=True):
        term = Fraction(coefficient)
        for a, e in enumerate(exponents):
            z = (Fraction(point[a]) - Fraction(step.middle[a])) / Fraction(step.half[a])
            first = [Fraction(1), z]
            second = [Fraction(1), 2 * z]
            for _ in range(e):
                first.append(2 * z * first[-1] - first[-2])
                second.append(2 * z * second[-1] - second[-2])
            if a == axis:
                term *= e * second[e - 1] / Fraction(step.half[a]) if e else 0
            else:
                term *= first[e]
        total += term
    return total


def enclosed(model: Model, k: int, s: np.ndarray, exact: Fraction) -> bool:
    total = Fraction(0)
    for exponents, c in zip(
        model.algebra.monomials, model.coefficients[:, k], strict=True
    ):
        term = Fraction(float(c))
        for value, power in zip(s, exponents, strict=True):
            term *= Fraction(float(value)) ** int(power)
        total += term
    return abs(total - exact) <= Fraction(float(model.error[k]))


@pytest.mark.parametrize("degree", [1, 3, 8])
@pytest.mark.parametrize("width", [0.0, 2.0**-20, 2.0**-5, 0.5])
def test_values_and_derivatives_are_enclosed(degree: int, width: float) -> None:
    rng = np.random.default_rng(degree)
    step, count = random_step(rng, degree), 6
    # Middles and radii with few bits, so that middle + radius s is a float.
    middle = np.round(rng.uniform(-2, 2, size=(D, count)) * 64) / 64
    radius = np.full((D, count), width)
    expansion = Expansion(step, algebra_of(D), middle, radius)
    for k in range(count):
        s = np.round(rng.uniform(-1, 1, size=D) * 16) / 16
        s[0] = (-1.0, 1.0, s[0])[k % 3]
        point = tuple(float(v) for v in middle[:, k] + radius[:, k] * s)
        assert enclosed(expansion.value(), k, s, exact_value(step, point))
        for axis in range(D):
            exact = exact_derivative(step, point, axis)
            assert enclosed(expansion.derivative(axis), k, s, exact)


def test_at_a_point_the_enclosure_is_as_thin_as_floats() -> None:
    rng = np.random.default_rng(3)
    step = random_step(rng, 8)
    middle = rng.uniform(-1, 1, size=(D, 5))
    model = Expansion(step, algebra_of(D), middle, np.zeros((D, 5))).value()
    for k in range(5):
        exact = exact_value(step, tuple(float(v) for v in middle[:, k]))
        assert abs(Fraction(float(model.middle[k])) - exact) < model.error[k]
        assert model.error[k] < 1e-7 * max(abs(c) for c in step.coefficients)


def test_what_cancels_in_the_polynomial_costs_nothing() -> None:
    # T_4(z) + 4 T_2(z) + 3 = 8 z^4: no bound of the terms one by one sees that.
    step = Step(
        middle=(0.0,) * D,
        half=(1.0,) * D,
        exponents=((4, 0, 0), (2, 0, 0), (0, 0, 0)),
        coefficients=(1.0, 4.0, 3.0),
        slack=0.0,
        end_slack=None,
    )
    radius = np.full((D, 1), 0.125)
    model = Expansion(step, algebra_of(D), np.zeros((D, 1)), radius).value()
    assert model.error[0] == pytest.approx(8 * 0.125**4, rel=1e-9)
    assert np.abs(model.coefficients).max() < 1e-13


def chebyshev_series(z: Fraction, size: int) -> list[list[Fraction]]:
    """T_e^[p], the coefficients of T_e(z + d) by powers of d, e and p below `size`."""
    rows = [[Fraction(1)], [z, Fraction(1)]]
    while len(rows) < size:
        longer = [Fraction(0)] * (len(rows) + 1)
        for p, c in enumerate(rows[-1]):
            longer[p] += 2 * z * c
            longer[p + 1] += 2 * c
        for p, c in enumerate(rows[-2]):
            longer[p] -= c
        rows.append(longer)
    return [row + [Fraction(0)] * (size - len(row)) for row in rows[:size]]


@pytest.mark.parametrize("size", [1, 2, 3, 12])
def test_the_table_of_series_has_balls_about_it_and_these_are_small(size: int) -> None:
    rng = np.random.default_rng(size)
    y = np.concatenate([rng.uniform(-3, 3, 30), [0.0, 0.7, 1e-9]])
    middle, half = 0.7, 1.3
    table, radii = _table(y, middle, half, size)
    assert table.shape == radii.shape == (33, size, size)
    for k in range(33):
        z = (Fraction(float(y[k])) - Fraction(middle)) / Fraction(half)
        exact = chebyshev_series(z, size)
        # A part of what the terms of the recurrence add up to: of T_e(|z| + 1).
        most = chebyshev_series(abs(z) + 1, size)
        for e in range(size):
            for p in range(size):
                radius = Fraction(float(radii[k, e, p]))
                assert abs(Fraction(float(table[k, e, p])) - exact[e][p]) <= radius
                assert radius <= Fraction(size**2, 2**48) * most[e][p] + Fraction(
                    1, 10**150
                )


def test_radii_follow_from_the_recurrence_number_by_number() -> None:
    """2 (|z| + r_z) r + 2 r' + r'' + 2 r_z |T|, and 8 units of the terms' sizes."""
    rng = np.random.default_rng(7)
    y, middle, half, size = rng.uniform(-3, 3, 20), 0.7, 1.3, 7
    table, radii = _table(y, middle, half, size)
    for k in range(20):
        z = abs((y[k] - middle) / half)
        of_z, T, r = z * 2.0**-50, np.abs(table[k]), np.zeros((size, size))
        r[1, 0] = of_z
        for e in range(2, size):
            for p in range(size):
                lower, its = (T[e - 1, p - 1], r[e - 1, p - 1]) if p else (0.0, 0.0)
                terms = 2 * z * T[e - 1, p] + 2 * lower + T[e - 2, p]
                r[e, p] = 2 * (z + of_z) * r[e - 1, p] + 2 * its + r[e - 2, p]
                r[e, p] += 2 * of_z * T[e - 1, p] + 2.0**-50 * terms
        np.testing.assert_allclose(radii[k], r, rtol=1e-9, atol=1e-150)


def test_rounding_is_counted_as_the_docstring_says() -> None:
    """((1 + share)^d - 1 + 2^-43) times the sums of absolute values of all terms."""
    rng = np.random.default_rng(5)
    step = random_step(rng, 5)
    middle, radius = rng.uniform(-2, 2, (D, 4)), rng.uniform(0, 0.5, (D, 4))
    expansion = Expansion(step, algebra_of(D), middle, radius)
    for axis in (None, 0, 1, 2):
        for k in range(4):
            share, rows = 0.0, []
            for a in range(D):
                table, radii = (
                    np.abs(t[a][k]) for t in (expansion._tables, expansion._radii)
                )
                size, row = len(table), []
                for e in range(size):
                    # Of the derivative by z: p d^(p - 1).
                    powers = [
                        (radius[a, k] / step.half[a]) ** (p - (a == axis))
                        * (p if a == axis else 1.0)
                        for p in range(1 if a == axis else 0, size)
                    ]
                    start = size - len(powers)
                    off = sum(
                        r * q for r, q in zip(radii[e][start:], powers, strict=True)
                    )
                    whole = (
                        sum(
                            t * q for t, q in zip(table[e][start:], powers, strict=True)
                        )
                        + off
                    )
                    row.append(max(whole, 1.0))
                    share = max(share, off / row[-1])
                rows.append(row)
            total = sum(
                abs(c) * rows[0][e[0]] * rows[1][e[1]] * rows[2][e[2]]
                for e, c in zip(step.exponents, step.coefficients, strict=True)
            )
            expected = (D * share + 2.0**-43) * total
            found = expansion._noise(axis)[k]
            assert found == pytest.approx(expected, rel=1e-9)
            assert share > 2.0**-53


@pytest.mark.parametrize("extra", [0, 1, 2])
def test_what_is_beyond_order_three_is_the_error(extra: int) -> None:
    """Its terms' sizes at the ends; further variables, such as controls, are unused."""
    rng = np.random.default_rng(6)
    step = random_step(rng, 6)
    middle, radius = rng.uniform(-1, 1, (D + extra, 3)), np.full((D + extra, 3), 0.25)
    algebra = algebra_of(D + extra)
    expansion = Expansion(step, algebra, middle, radius)
    for axis in (None, 0, 1, 2):
        model = expansion.value() if axis is None else expansion.derivative(axis)
        for k in range(3):
            series = [
                chebyshev_series(
                    (Fraction(float(middle[a, k])) - Fraction(step.middle[a]))
                    / Fraction(step.half[a]),
                    7,
                )
                for a in range(D)
            ]
            powers: dict[tuple[int, ...], Fraction] = {}
            for e, c in zip(step.exponents, step.coefficients, strict=True):
                for place in np.ndindex(*(x + 1 for x in e)):
                    term = Fraction(c)
                    for a, p in enumerate(place):
                        term *= series[a][e[a]][p]
                        scale = Fraction(1, 4) / Fraction(step.half[a])
                        term *= scale ** (p - (a == axis)) * (p if a == axis else 1)
                        term /= Fraction(step.half[a]) if a == axis else 1
                    lowered = tuple(p - (a == axis) for a, p in enumerate(place))
                    if term:
                        powers[lowered] = powers.get(lowered, Fraction(0)) + term
            size = float(sum(map(abs, powers.values())))
            cut = float(sum(abs(c) for e, c in powers.items() if sum(e) > 3))
            assert cut <= model.error[k] <= cut + 1e-10 * size
            for e, number in algebra.numbers.items():
                exact = 0.0 if any(e[D:]) else float(powers.get(e[:D], Fraction(0)))
                found = model.coefficients[number, k]
                assert found == pytest.approx(exact, abs=1e-12 * size)


def test_a_product_given_twice_counts_twice_and_none_is_zero() -> None:
    twice = Step(
        middle=(0.0,) * D,
        half=(1.0,) * D,
        exponents=((1, 0, 0), (1, 0, 0)),
        coefficients=(2.0, 3.0),
        slack=0.0,
        end_slack=None,
    )
    middle, radius = np.full((D, 1), 0.5), np.zeros((D, 1))
    model = Expansion(twice, algebra_of(D), middle, radius).value()
    assert model.middle[0] == 2.5 == exact_value(twice, (0.5, 0.5, 0.5))
    none = dataclasses.replace(twice, exponents=(), coefficients=())
    model = Expansion(none, algebra_of(D), middle, radius).value()
    assert model.upper[0] < 1e-150 and exact_value(none, (0.5,) * D) == 0
