"""Taylor models enclose what Arb's balls say, operation by operation."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.terminal_set.checker.evaluation import FUNCTIONS
from swarmstart.terminal_set.checker.models import Model, algebra_of
from swarmstart.terminal_set.checker.rays import Along

flint = pytest.importorskip("flint")
arb = flint.arb

UNARY: dict[str, Callable[[Any], Any]] = {
    "neg": lambda a: -a,
    "sq": lambda a: a * a,
    "twice": lambda a: 2 * a,
    "inv": lambda a: 1 / a,
    "fabs": abs,
    "sqrt": lambda a: a.sqrt(),
    "sin": lambda a: a.sin(),
    "cos": lambda a: a.cos(),
    "tan": lambda a: a.tan(),
    "exp": lambda a: a.exp(),
    "log": lambda a: a.log(),
    "atan": lambda a: a.atan(),
    "tanh": lambda a: a.tanh(),
}
BINARY: dict[str, Callable[[Any, Any], Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "pow": lambda a, b: a**b,
    "fmin": lambda a, b: a.min(b),
    "fmax": lambda a, b: a.max(b),
}
middles = st.floats(-30.0, 30.0)
radii = st.sampled_from([0.0, 1e-12, 1e-6, 1e-3, 0.05, 0.3, 2.0])
shares = st.floats(-1.0, 1.0)


@pytest.fixture(autouse=True)
def precise() -> Any:
    flint = importlib.import_module("flint")
    before = flint.ctx.prec
    flint.ctx.prec = 200
    yield
    flint.ctx.prec = before


def arguments(
    a: float, b: float, r: float, s: tuple[float, float]
) -> tuple[list[Model], list[Any]]:
    """a + r (s_0 + s_1 / 3) + ..., b + r s_1 (1 + s_0): curved, as models and balls."""
    algebra = algebra_of(2)
    x = algebra.variable(0, np.zeros(1), np.array([r]))
    y = algebra.variable(1, np.zeros(1), np.array([r]))
    first = (x + y.scaled(0.375) + x * y).shifted(a)
    second = (y + x * y + x * x).shifted(b)
    p, q = arb(r) * arb(s[0]), arb(r) * arb(s[1])
    return [first, second], [
        arb(a) + p + q * arb(0.375) + p * q,
        arb(b) + q + p * q + p * p,
    ]


def assert_encloses(model: Model, s: tuple[float, ...], exact: Any) -> None:
    if not (np.isfinite(model.error).all() and np.isfinite(model.coefficients).all()):
        return  # nothing is claimed
    if not exact.is_finite():
        return
    total = arb(0)
    for exponents, c in zip(
        model.algebra.monomials, model.coefficients[:, 0], strict=True
    ):
        term = arb(float(c))
        for value, power in zip(s, exponents, strict=True):
            term *= arb(value) ** int(power)
        total += term
    assert not abs(total - exact) > arb(float(model.error[0]))
    assert not exact < arb(float(model.lower[0]))
    assert not exact > arb(float(model.upper[0]))


@pytest.mark.parametrize("name", UNARY)
@settings(max_examples=60, deadline=None, derandomize=True)
@given(a=middles, r=radii, s=st.tuples(shares, shares))
def test_functions_of_one_argument_are_enclosed(
    name: str, a: float, r: float, s: tuple[float, float]
) -> None:
    models, balls = arguments(a, 0.0, r, s)
    with np.errstate(all="ignore"):
        model = FUNCTIONS[name](models[0])
    assert_encloses(model, s, UNARY[name](balls[0]))


@pytest.mark.parametrize("name", BINARY)
@settings(max_examples=60, deadline=None, derandomize=True)
@given(a=middles, b=middles, r=radii, s=st.tuples(shares, shares))
def test_functions_of_two_arguments_are_enclosed(
    name: str, a: float, b: float, r: float, s: tuple[float, float]
) -> None:
    a = abs(a) + 4 * r if name == "pow" else a
    models, balls = arguments(a, b, r, s)
    with np.errstate(all="ignore"):
        model = FUNCTIONS[name](*models)
    assert_encloses(model, s, BINARY[name](*balls))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    a=middles,
    r=radii,
    s=st.tuples(shares, shares),
    exponent=st.sampled_from([-3.0, -1.0, 0.0, 0.5, 1.0, 1.5, 2.0, 5.0, 7.25, 70.0]),
)
def test_powers_of_numbers_are_enclosed(
    a: float, r: float, s: tuple[float, float], exponent: float
) -> None:
    models, balls = arguments(a, 0.0, r, s)
    with np.errstate(all="ignore"):
        model = FUNCTIONS["pow"](models[0], exponent)
    assert_encloses(model, s, balls[0] ** arb(exponent))


@pytest.mark.parametrize("name", UNARY)
def test_the_error_falls_with_the_fourth_power_of_the_width(name: str) -> None:
    s = (0.5, -0.5)
    errors = []
    for r in (0.04, 0.02):
        models, _ = arguments(0.7, 0.0, r, s)
        errors.append(float(FUNCTIONS[name](models[0]).error[0]))
    assert errors[1] <= max(errors[0] / 14.0, 1e-12)


def test_every_operation_of_a_file_has_a_test() -> None:
    assert set(FUNCTIONS) == set(UNARY) | set(BINARY)


def test_a_pole_or_the_end_of_a_domain_in_the_box_leaves_nothing_known() -> None:
    models, _ = arguments(0.05, 0.0, 0.1, (0.0, 0.0))
    with np.errstate(all="ignore"):
        for name in ("inv", "log", "sqrt"):
            lower = FUNCTIONS[name](models[0]).lower
            assert not lower > -np.inf, name


def test_a_batch_is_its_boxes_one_by_one() -> None:
    rng = np.random.default_rng(1)
    algebra = algebra_of(3)
    middle, radius = rng.normal(size=(3, 7)) + 4, rng.uniform(0, 0.2, size=(3, 7))

    def value(which: slice) -> Model:
        x, y, z = (
            algebra.variable(i, middle[i, which], radius[i, which]) for i in range(3)
        )
        found: Model = FUNCTIONS["div"](FUNCTIONS["exp"](x.scaled(0.1)) * y, z)
        return found

    whole = value(slice(None))
    for k in range(7):
        one = value(slice(k, k + 1))
        np.testing.assert_allclose(
            one.coefficients[:, 0], whole.coefficients[:, k], rtol=1e-13, atol=1e-15
        )


DOMAINS = {"inv": 0.3, "sqrt": 0.3, "log": 0.3}
"""Least arguments; -3 of the others."""


@pytest.mark.parametrize("radius", [0.0, 1e-3, 0.02, 0.25])
@pytest.mark.parametrize("name", UNARY)
def test_the_ends_of_a_straight_box_are_enclosed(name: str, radius: float) -> None:
    # There Lagrange's remainder is all the error there is; at radius 0, rounding is.
    count = 60
    rng = np.random.default_rng(0)
    middle = rng.uniform(DOMAINS.get(name, -3.0) + radius, 3.0, count)
    middle[0] = max(0.0, DOMAINS.get(name, 0.0) + radius)
    middle[1] = middle[0] + radius / 2
    algebra = algebra_of(1)
    a = algebra.variable(0, middle, np.full(count, radius))
    with np.errstate(all="ignore"):
        model = FUNCTIONS[name](a)
    for k in range(count):
        one = Model(algebra, model.coefficients[:, k : k + 1], model.error[k : k + 1])
        for s in (-1.0, -0.5, 0.0, 1.0):
            exact = UNARY[name](arb(float(middle[k])) + arb(radius) * arb(s))
            assert_encloses(one, (s,), exact)


@pytest.mark.parametrize("name", [n for n in BINARY if n != "pow"])
def test_the_rounding_of_numbers_is_enclosed(name: str) -> None:
    rng = np.random.default_rng(1)
    a, b = rng.uniform(0.1, 3.0, (2, 60))
    algebra = algebra_of(1)
    model = FUNCTIONS[name](algebra.constant(a), algebra.constant(b))
    for k in range(60):
        one = Model(algebra, model.coefficients[:, k : k + 1], model.error[k : k + 1])
        exact = BINARY[name](arb(float(a[k])), arb(float(b[k])))
        assert_encloses(one, (0.0,), exact)
        assert model.error[k] < 1e-11


@pytest.mark.parametrize("name", [*UNARY, *BINARY])
@settings(max_examples=60, deadline=None, derandomize=True)
@given(a=middles, b=middles, r=radii, s=st.tuples(shares, shares))
def test_values_along_rays_are_enclosed_with_their_slopes(
    name: str, a: float, b: float, r: float, s: tuple[float, float]
) -> None:
    """a + rho (1 + r s_1) and b - rho, rho = r (1 + s_0): g(rho) = g(0) + rho slope."""
    algebra = algebra_of(2)
    rho = algebra.variable(0, np.array([r]), np.array([r]))
    y = algebra.variable(1, np.zeros(1), np.array([r]))
    a = abs(a) + 4 * r if name == "pow" else a
    start = [y.scaled(0.5).shifted(a), rho.number(b)]
    slopes = [y.shifted(1.0), rho.number(-1.0)]
    number = 1 if name in UNARY else 2
    along = [Along(p, q, rho) for p, q in zip(start, slopes, strict=True)][:number]
    with np.errstate(all="ignore"):
        found = FUNCTIONS[name](*along)
        value = found.value
    exact = (UNARY | BINARY)[name]
    p = arb(r) * arb(s[1])
    at = [arb(a) + p * arb(0.5), arb(b)][:number]
    far = arb(r) * (1 + arb(s[0]))
    moved = [at[0] + far * (1 + p), arb(b) - far][:number]
    assert_encloses(found.at, s, exact(*at))
    assert_encloses(value, s, exact(*moved))
    if far > 0:
        assert_encloses(found.slope, s, (exact(*moved) - exact(*at)) / far)


@pytest.mark.parametrize("name", UNARY)
def test_slopes_along_short_rays_are_thin(name: str) -> None:
    """So that a box at the centre of a set can be decided at all."""
    algebra = algebra_of(1)
    rho = algebra.variable(0, np.array([1e-3]), np.array([1e-3]))
    found = FUNCTIONS[name](Along(rho.number(0.7), rho.number(1.0), rho))
    slope = (UNARY[name](arb(0.7) + arb(1e-6)) - UNARY[name](arb(0.7))) / arb(1e-6)
    assert abs(found.slope.middle[0] - float(slope.mid())) < 1e-2
    linear = found.slope.coefficients[1:].sum(axis=0)
    assert found.slope.error[0] < 1e-6 and np.abs(linear) < 1e-2
