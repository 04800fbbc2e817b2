from collections.abc import Callable

import casadi as ca
import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray

Array = NDArray[np.float64]
Evaluate = Callable[..., list[Array]]
INF, NAN, PI = np.inf, np.nan, np.pi
POINTS = 500

STATED = {
    "sin": 2.0,
    "cos": 2.0,
    "exp": 1.0,
    "log": 1.0,
    "tanh": 2.0,
    "atan": 1.0,
    "atan2": 2.0,
}
"""Largest error in ulp, as the head of elementary.py states it."""


@pytest.fixture(scope="module")
def unary(compiled: Callable[..., Evaluate]) -> Callable[[str], Callable[..., Array]]:
    """Name -> its machine code, on an array (n,)."""

    def named(name: str) -> Callable[..., Array]:
        x = ca.SX.sym("x")
        evaluate = compiled([x], [getattr(ca, name)(x)])
        return lambda values: evaluate(np.atleast_2d(values))[0][0]

    return named


@pytest.fixture(scope="module")
def atan2(compiled: Callable[..., Evaluate]) -> Callable[..., Array]:
    y, x = ca.SX.sym("y"), ca.SX.sym("x")
    evaluate = compiled([y, x], [ca.atan2(y, x)])
    return lambda a, b: evaluate(np.atleast_2d(a), np.atleast_2d(b))[0][0]


def binades(
    rng: np.random.Generator, first: int = -1074, last: int = 1023, size: int = POINTS
) -> Array:
    """Numbers of both signs whose exponents are uniform, denormals among them."""
    significands = rng.uniform(1, 2, size) * rng.choice([-1, 1], size)
    scaled: Array = np.ldexp(significands, rng.integers(first, last + 1, size))
    return scaled


def multiples_of_quarter_turns(rng: np.random.Generator) -> Array:
    """The doubles nearest to k pi/2, some beyond 2^30: sin or cos nearly vanish."""
    some = [*rng.integers(-(2**29), 2**29, POINTS), *rng.integers(2**34, 2**53, 100)]
    with mpmath.workprec(120):
        near = [float(int(k) * mpmath.pi / 2) for k in (*range(-60, 61), *some)]
    return np.array(near)


def angles(rng: np.random.Generator) -> Array:
    near = multiples_of_quarter_turns(rng)
    limit = 2.0**30 + np.array([-1, 0, 1, 0.5, 1e-6])
    # The reduced angle just below pi/4, where the polynomials are worst.
    worst = rng.uniform(0.75, 0.82, POINTS) + rng.integers(-9, 9, POINTS) * PI / 2
    parts = [
        binades(rng, -1074, 29),
        binades(rng, 30, 1023, 100),
        rng.uniform(-10, 10, POINTS),
        near,
        np.nextafter(near, 0),
        near * (1 + 1e-12 * rng.normal(size=near.size)),
        worst,
        limit,
        -limit,
        np.array([1e22, -1e22, 1.7e308, -1.7e308, 1.7976931348623157e308]),
    ]
    return np.concatenate(parts)


def points(name: str, rng: np.random.Generator) -> Array:
    """Finite arguments over the whole range, dense where the method changes."""
    all_over, near_zero = binades(rng), rng.uniform(-2, 2, POINTS)
    own = {
        "exp": [rng.uniform(-746, 711, 2 * POINTS), rng.uniform(-745.2, -708, POINTS)],
        "log": [1 + binades(rng, -53, -2), rng.uniform(0.5, 3, 2 * POINTS)],
        "tanh": [rng.uniform(-25, 25, POINTS), rng.uniform(0.6, 0.7, 2 * POINTS)],
        "atan": [rng.uniform(0.6, 0.7, POINTS), rng.uniform(2.3, 2.5, POINTS)],
    }
    if name in ("sin", "cos"):
        return angles(rng)
    values = np.concatenate([all_over, near_zero, *own[name]])
    return np.abs(values) if name == "log" else values


def errors_in_ulp(got: Array, name: str, *arguments: Array) -> Array:
    """Return the errors against mpmath; where the exact value overflows, inf is 0."""
    found = np.empty(len(got))
    exact = getattr(mpmath, name)
    for i, (value, *given) in enumerate(zip(got, *arguments, strict=True)):
        with mpmath.workprec(160):
            reference = exact(*(mpmath.mpf(float(g)) for g in given))
            rounded = float(reference)
            if np.isfinite(rounded) and np.isfinite(value):
                distance = abs(float(value) - reference)
                found[i] = float(distance / float(np.spacing(abs(rounded))))
            else:
                found[i] = 0.0 if value == rounded else INF
    return found


@pytest.mark.parametrize("name", ["sin", "cos", "exp", "log", "tanh", "atan"])
def test_error_is_below_the_stated_bound(
    unary: Callable[[str], Callable[..., Array]], name: str
) -> None:
    arguments = points(name, np.random.default_rng(1))
    errors = errors_in_ulp(unary(name)(arguments), name, arguments)
    assert errors.max() <= STATED[name], arguments[errors.argmax()]


def test_error_of_atan2_is_below_the_stated_bound(atan2: Callable[..., Array]) -> None:
    rng = np.random.default_rng(2)
    pairs = [
        (rng.normal(size=2 * POINTS), rng.normal(size=2 * POINTS)),
        (binades(rng), binades(rng)),
        (binades(rng, -1074, -1000), binades(rng, -1074, -1000)),
        (binades(rng, 900), binades(rng, 900)),
    ]
    y, x = (np.concatenate(part) for part in zip(*pairs, strict=True))
    errors = errors_in_ulp(atan2(y, x), "atan2", y, x)
    assert errors.max() <= STATED["atan2"], (y[errors.argmax()], x[errors.argmax()])


@pytest.mark.parametrize(
    ("name", "argument", "value"),
    [
        *[("sin", x, NAN) for x in (INF, -INF, NAN)],
        *[("cos", x, NAN) for x in (INF, -INF, NAN)],
        *[(name, 0.0, 0.0) for name in ("sin", "tanh", "atan")],
        *[(name, -0.0, -0.0) for name in ("sin", "tanh", "atan")],
        *[(name, 5e-324, 5e-324) for name in ("sin", "tanh", "atan")],
        *[(name, -5e-324, -5e-324) for name in ("sin", "tanh", "atan")],
        *[("cos", x, 1.0) for x in (0.0, -0.0, 5e-324)],
        *[("exp", x, 1.0) for x in (0.0, -0.0, 5e-324)],
        *[("exp", x, 0.0) for x in (-INF, -746.0, -1e308)],
        *[("exp", x, INF) for x in (INF, 709.79, 1e308)],
        ("exp", -745.0, 5e-324),
        *[("log", x, -INF) for x in (0.0, -0.0)],
        *[("log", x, NAN) for x in (-1.0, -5e-324, -INF, NAN)],
        ("log", INF, INF),
        ("log", 1.0, 0.0),
        *[("tanh", x, np.sign(x)) for x in (INF, -INF, 1e308, -400.0)],
        ("atan", INF, PI / 2),
        ("atan", -INF, -PI / 2),
        *[(name, NAN, NAN) for name in ("exp", "tanh", "atan")],
    ],
)
def test_special_values_are_the_c_library_s(
    unary: Callable[[str], Callable[..., Array]],
    name: str,
    argument: float,
    value: float,
) -> None:
    got = unary(name)(np.array([argument]))[0]
    np.testing.assert_array_equal(got, value)
    assert np.signbit(got) == np.signbit(value) or np.isnan(value)


def test_atan2_of_zeros_and_infinities_is_the_c_library_s(
    atan2: Callable[..., Array],
) -> None:
    values = [0.0, -0.0, 1.0, -1.0, INF, -INF, NAN, 5e-324, -5e-324, 1.7e308, -1.7e308]
    y, x = (a.ravel() for a in np.meshgrid(values, values))
    got, want = atan2(y, x), np.arctan2(y, x)
    np.testing.assert_array_max_ulp(got, want, maxulp=2)
    special = ~(np.isfinite(y) & np.isfinite(x)) | (x == 0) | (y == 0)
    np.testing.assert_array_equal(got[special], want[special])
    number = ~np.isnan(want)
    np.testing.assert_array_equal(np.signbit(got)[number], np.signbit(want)[number])


def test_sine_and_cosine_of_one_angle_are_those_of_each_alone(
    compiled: Callable[..., Evaluate],
) -> None:
    x = ca.SX.sym("x")
    both = compiled([x], [ca.sin(x), ca.cos(x)])
    values = angles(np.random.default_rng(3))[None]
    sine, cosine = both(values)
    np.testing.assert_array_equal(sine, compiled([x], [ca.sin(x)])(values)[0])
    np.testing.assert_array_equal(cosine, compiled([x], [ca.cos(x)])(values)[0])


@pytest.mark.parametrize("name", ["exp", "log", "tanh", "atan"])
def test_functions_never_step_the_wrong_way_by_more_than_their_error(
    unary: Callable[[str], Callable[..., Array]], name: str
) -> None:
    """Where the method changes from one formula to another, too."""
    low, high = (1e-3, 30.0) if name == "log" else (-30.0, 30.0)
    values = unary(name)(np.linspace(low, high, 200_001))
    assert np.all(np.diff(values) >= -2 * STATED[name] * np.spacing(np.abs(values[1:])))
