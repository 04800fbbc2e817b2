"""Polynomials over boxes enclose their exact values and derivatives."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from swarmstart.terminal_set.checker.lower_bound.certificate_file import Step
from swarmstart.terminal_set.checker.lower_bound.polynomials import (
    Expansion,
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
