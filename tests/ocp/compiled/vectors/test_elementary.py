import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import mpmath
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp.compiled.vectors.vector_ir import FORMATS, Format, Precision

Evaluate = Callable[..., tuple[Array, ...]]
Named = Callable[..., Callable[..., Array]]
INF, NAN, PI = np.inf, np.nan, np.pi
POINTS = 500

STATED: dict[Precision, dict[str, float]] = {
    "double": {
        "sin": 2.0,
        "cos": 2.0,
        "tan": 3.0,
        "exp": 1.0,
        "expm1": 2.0,
        "log": 1.0,
        "log1p": 1.0,
        "sinh": 2.0,
        "cosh": 2.0,
        "tanh": 2.0,
        "asinh": 2.0,
        "acosh": 3.0,
        "atanh": 2.0,
        "erf": 2.0,
        "asin": 3.0,
        "acos": 2.0,
        "atan": 1.0,
        "atan2": 2.0,
        "pow": 2.0,
    },
    "single": {
        "sin": 2.0,
        "cos": 2.0,
        "tan": 4.0,
        "exp": 1.0,
        "expm1": 2.0,
        "log": 1.0,
        "log1p": 1.0,
        "sinh": 2.0,
        "cosh": 2.0,
        "tanh": 2.0,
        "asinh": 2.0,
        "acosh": 3.0,
        "atanh": 2.0,
        "erf": 2.0,
        "asin": 3.0,
        "acos": 2.0,
        "atan": 3.0,
        "atan2": 3.0,
        "pow": 1.0,
    },
}
"""Largest error in ulp, as the head of elementary.py states it."""

ANGLES, ARCS = ("sin", "cos", "tan"), ("asin", "acos")
AREAS = ("asinh", "acosh", "atanh")
UNARY = (
    *ANGLES, "exp", "expm1", "log", "log1p", "sinh", "cosh", "tanh", *AREAS,
    "erf", *ARCS, "atan",
)  # fmt: skip
DOMAINS = {"log1p": (-1.0, INF), "acosh": (1.0, INF), "atanh": (-1.0, 1.0)}
DOMAINS |= dict.fromkeys(ARCS, (-1.0, 1.0))
"""Arguments between these have values."""
PRECISIONS: tuple[Precision, ...] = ("double", "single")
KINDS = {"double": np.float64, "single": np.float32}
LARGEST = {"double": float(np.finfo(np.float64).max),
           "single": float(np.finfo(np.float32).max)}  # fmt: skip


@pytest.fixture(scope="module")
def elementary(compiled: Callable[..., Evaluate]) -> Named:
    """(name, precision) -> its machine code, on arrays (n,)."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")

    def named(name: str, precision: Precision = "double") -> Callable[..., Array]:
        pairs = {"atan2": lambda: ca.atan2(x, y), "pow": lambda: x**y}
        if name in pairs:
            evaluate = compiled([x, y], [pairs[name]()], precision)
        else:
            evaluate = compiled([x], [getattr(ca, name)(x)], precision)
        return lambda *values: evaluate(*map(np.atleast_2d, values))[0][0]

    return named


def digits(form: Format) -> int:
    """Return how many doublings lie between 1 and the smallest denormal."""
    return form.bias - 1 + form.significand


def rounded(values: Array, precision: Precision) -> Array:
    """Return values as the kernel takes them."""
    if precision == "double":
        return values
    with np.errstate(over="ignore", under="ignore"):
        single: Array = values.astype(np.float32).astype(np.float64)
        return single


def binades(
    rng: np.random.Generator, first: int = -1074, last: int = 1023, size: int = POINTS
) -> Array:
    """Numbers of both signs whose exponents are uniform, denormals among them."""
    significands = rng.uniform(1, 2, size) * rng.choice([-1, 1], size)
    scaled: Array = np.ldexp(significands, rng.integers(first, last + 1, size))
    return scaled


def finite_binades(rng: np.random.Generator, form: Format) -> Array:
    return binades(rng, -digits(form), form.bias - 1)


def multiples_of_quarter_turns(rng: np.random.Generator) -> Array:
    """The doubles nearest to k pi/2, some beyond 2^30: sin or cos nearly vanish."""
    some = [*rng.integers(-(2**29), 2**29, POINTS), *rng.integers(2**34, 2**53, 100)]
    small = rng.integers(-2600, 2600, POINTS)
    with mpmath.workprec(120):
        near = [float(int(k) * mpmath.pi / 2) for k in (*range(-60, 61), *some, *small)]
    return np.array(near)


def angles(rng: np.random.Generator, form: Format) -> Array:
    near = multiples_of_quarter_turns(rng)
    limits = [
        limit + np.array([-1, 0, 1, 0.5, 1e-6, 1e-3]) for limit in (2.0**30, 2.0**12)
    ]
    # The reduced angle just below pi/4, where the polynomials are worst.
    worst = rng.uniform(0.75, 0.82, POINTS) + rng.integers(-9, 9, POINTS) * PI / 2
    parts = [
        finite_binades(rng, form),
        binades(rng, 10, 29, 200),
        rng.uniform(-10, 10, POINTS),
        near,
        np.nextafter(near, 0),
        near * (1 + 1e-12 * rng.normal(size=near.size)),
        worst,
        *limits,
        *(-limit for limit in limits),
        np.array([1e22, -1e22, 3e38, -3e38]),
    ]
    if form.bits == 64:
        parts.append(np.array([1.7e308, -1.7e308, 1.7976931348623157e308]))
    return np.concatenate(parts)


def points(name: str, rng: np.random.Generator, form: Format) -> Array:
    """Finite arguments over the whole range, dense where the method changes."""
    if name in ANGLES:
        return angles(rng, form)
    all_over, near_zero = finite_binades(rng, form), rng.uniform(-2, 2, POINTS)
    lowest = -np.log(2) * digits(form)
    denormal, highest = -np.log(2) * form.bias, np.log(2) * form.bias
    own = {
        "exp": [
            rng.uniform(lowest - 1, highest + 2, 2 * POINTS),
            rng.uniform(lowest - 0.1, denormal, POINTS),
        ],
        "log": [
            1 + binades(rng, -form.significand - 1, -2),
            rng.uniform(0.5, 3, 2 * POINTS),
        ],
        "expm1": [
            rng.uniform(-45, highest + 2, 2 * POINTS),
            rng.uniform(-1.1, 1.1, 2 * POINTS),
        ],
        "log1p": [
            -1 + binades(rng, -form.significand - 1, -2),
            rng.uniform(-0.6, 3, 2 * POINTS),
        ],
        "sinh": [
            rng.uniform(-highest - 2, highest + 2, POINTS),
            rng.uniform(0.9, 1.5, 2 * POINTS),
        ],
        "cosh": [rng.uniform(-highest - 2, highest + 2, POINTS)],
        "asinh": [rng.uniform(-9, 9, 2 * POINTS)],
        "acosh": [1 + np.abs(binades(rng, -form.significand - 1, 20, 2 * POINTS))],
        "atanh": [
            rng.uniform(-1, 1, 4 * POINTS),
            1 - np.abs(binades(rng, -form.significand, -2)),
        ],
        "erf": [rng.uniform(-6.5, 6.5, 2 * POINTS), rng.uniform(0.9, 1.1, POINTS)],
        "asin": [
            rng.uniform(-1, 1, 4 * POINTS),
            rng.uniform(0.45, 0.55, POINTS),
            1 - np.abs(binades(rng, -form.significand, -2)),
        ],
        "tanh": [rng.uniform(-25, 25, POINTS), rng.uniform(0.6, 0.7, 2 * POINTS)],
        "atan": [
            rng.uniform(0.35, 0.7, 2 * POINTS),
            rng.uniform(2.3, 2.5, POINTS),
        ],
    }
    own["acos"] = own["asin"]
    values = np.concatenate([all_over, near_zero, *own[name]])
    values = np.abs(values) if name == "log" else values
    low, high = DOMAINS.get(name, (-INF, INF))
    with np.errstate(over="ignore"):
        kept = values.astype({64: np.float64, 32: np.float32}[form.bits])
    return values[(kept > low) & (kept < high)]


def exact(name: str, arguments: list[float]) -> mpmath.mpf:
    given = [mpmath.mpf(argument) for argument in arguments]
    if name == "pow":
        return mpmath.power(*given)
    return getattr(mpmath, name)(*given)


def nearest(value: mpmath.mpf, precision: Precision) -> Any:
    """Return the number of a format nearest to a value; infinite on overflow.

    A double between serves single precision too: the numbers here are no ties.
    """
    with np.errstate(over="ignore", under="ignore"):
        return KINDS[precision](float(value))


def errors_in_ulp(
    got: Array, name: str, precision: Precision, *arguments: Array
) -> Array:
    """Return the errors against mpmath; where the exact value overflows, inf is 0."""
    found = np.empty(len(got))
    for i, (value, *given) in enumerate(zip(got, *arguments, strict=True)):
        with mpmath.workprec(160):
            reference = exact(name, [float(g) for g in given])
            closest = nearest(reference, precision)
            if np.isfinite(closest) and np.isfinite(value):
                distance = abs(float(value) - reference)
                found[i] = float(distance / float(np.spacing(abs(closest))))
            else:
                found[i] = 0.0 if value == closest else INF
    return found


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", UNARY)
def test_error_is_below_the_stated_bound(
    elementary: Named, name: str, precision: Precision
) -> None:
    arguments = points(name, np.random.default_rng(1), FORMATS[precision])
    arguments = rounded(arguments, precision)
    errors = errors_in_ulp(
        elementary(name, precision)(arguments), name, precision, arguments
    )
    assert errors.max() <= STATED[precision][name], arguments[errors.argmax()]


@pytest.mark.parametrize("precision", PRECISIONS)
def test_error_of_atan2_is_below_the_stated_bound(
    elementary: Named, precision: Precision
) -> None:
    rng, form = np.random.default_rng(2), FORMATS[precision]
    low, high = -digits(form), form.bias - 1
    # Where the reduced argument changes, and the quotient's own rounding adds.
    steep = rng.uniform(0.36, 0.45, 4 * POINTS)
    radii = rng.uniform(0.5, 2, 4 * POINTS)
    pairs = [
        (rng.normal(size=2 * POINTS), rng.normal(size=2 * POINTS)),
        (radii * np.sin(steep), radii * np.cos(steep)),
        (binades(rng, low, high), binades(rng, low, high)),
        (binades(rng, low, low + 74), binades(rng, low, low + 74)),
        (binades(rng, high - 20, high), binades(rng, high - 20, high)),
    ]
    y, x = (rounded(np.concatenate(p), precision) for p in zip(*pairs, strict=True))
    got = elementary("atan2", precision)(y, x)
    errors = errors_in_ulp(got, "atan2", precision, y, x)
    worst = errors.argmax()
    assert errors[worst] <= STATED[precision]["atan2"], (y[worst], x[worst])


def powers(rng: np.random.Generator, form: Format) -> tuple[Array, Array]:
    """Bases and exponents: results over the whole range, denormal ones too."""
    reach, near_one = np.log(2) * digits(form), 1 + binades(rng, -20, -2)
    bases = np.concatenate(
        [
            np.abs(finite_binades(rng, form)),
            rng.uniform(0.1, 10, 2 * POINTS),
            rng.uniform(0.7, 1.42, POINTS),
            near_one,
            np.nextafter(1, [0, 2]),
        ]
    )
    wanted = rng.uniform(-1.02 * reach, reach, bases.size)
    exponents = wanted / np.log(bases)
    small = rng.uniform(-5, 5, bases.size)
    whole = rng.integers(-20, 20, bases.size).astype(np.float64)
    largest = 0.99 * 2.0**form.bias
    return (
        np.concatenate([bases, bases, bases]),
        np.clip(np.concatenate([exponents, small, whole]), -largest, largest),
    )


@pytest.mark.parametrize("precision", PRECISIONS)
def test_error_of_pow_is_below_the_stated_bound(
    elementary: Named, precision: Precision
) -> None:
    bases, exponents = powers(np.random.default_rng(3), FORMATS[precision])
    bases, exponents = rounded(bases, precision), rounded(exponents, precision)
    got = elementary("pow", precision)(bases, exponents)
    errors = errors_in_ulp(got, "pow", precision, bases, exponents)
    worst = errors.argmax()
    assert errors[worst] <= STATED[precision]["pow"], (bases[worst], exponents[worst])


ODDITIES = [
    *[("sin", x, NAN) for x in (INF, -INF, NAN)],
    *[("cos", x, NAN) for x in (INF, -INF, NAN)],
    *[(name, 0.0, 0.0) for name in ("sin", "tanh", "atan")],
    *[(name, -0.0, -0.0) for name in ("sin", "tanh", "atan")],
    *[("cos", x, 1.0) for x in (0.0, -0.0)],
    *[("exp", x, 1.0) for x in (0.0, -0.0)],
    *[("exp", x, 0.0) for x in (-INF, -746.0)],
    *[("exp", x, INF) for x in (INF, 709.79)],
    *[("log", x, -INF) for x in (0.0, -0.0)],
    *[("log", x, NAN) for x in (-1.0, -INF, NAN)],
    ("log", INF, INF),
    ("log", 1.0, 0.0),
    *[("tanh", x, np.sign(x)) for x in (INF, -INF, -400.0)],
    *[(name, NAN, NAN) for name in ("exp", "tanh", "atan")],
]
DOUBLE_ODDITIES = [
    *[(name, 5e-324, 5e-324) for name in ("sin", "tanh", "atan")],
    *[(name, -5e-324, -5e-324) for name in ("sin", "tanh", "atan")],
    *[(name, 5e-324, 1.0) for name in ("cos", "exp")],
    ("exp", -1e308, 0.0),
    ("exp", 1e308, INF),
    ("exp", -745.0, 5e-324),
    ("log", -5e-324, NAN),
    ("tanh", 1e308, 1.0),
    ("atan", INF, PI / 2),
    ("atan", -INF, -PI / 2),
]
TINY = 2.0**-149
SINGLE_ODDITIES = [
    *[(name, TINY, TINY) for name in ("sin", "tanh", "atan")],
    *[(name, -TINY, -TINY) for name in ("sin", "tanh", "atan")],
    *[(name, TINY, 1.0) for name in ("cos", "exp")],
    *[("exp", x, 0.0) for x in (-105.0, -1e38, -1e300)],
    *[("exp", x, INF) for x in (88.73, 89.0, 1e38, 1e300)],
    ("exp", -103.0, TINY),
    ("exp", -103.9, TINY),
    ("log", -TINY, NAN),
    ("log", 1e300, INF),
    ("tanh", 3e38, 1.0),
    ("atan", INF, float(np.float32(PI / 2))),
    ("atan", -INF, -float(np.float32(PI / 2))),
]


BY_LIBRARY: dict[str, Callable[[float], float]] = {
    "tan": math.tan, "expm1": math.expm1, "log1p": math.log1p, "sinh": math.sinh,
    "cosh": math.cosh, "asinh": math.asinh, "acosh": math.acosh, "atanh": math.atanh,
    "erf": math.erf, "asin": math.asin, "acos": math.acos,
}  # fmt: skip


def by_library(name: str, x: float) -> float:
    """Return the C library's value, which Python's math replaces by exceptions."""
    try:
        return BY_LIBRARY[name](x)
    except OverflowError:
        return float(np.copysign(INF, x if name == "sinh" else 1.0))
    except ValueError:  # The poles of two functions, and NaN out of the domain.
        if name in ("log1p", "atanh") and abs(x) == 1:
            return float(np.copysign(INF, x))
        return NAN


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", BY_LIBRARY)
def test_ends_and_zeros_are_the_c_library_s(
    elementary: Named, name: str, precision: Precision
) -> None:
    form = FORMATS[precision]
    largest = LARGEST[precision]
    values = [0.0, 2.0 ** -digits(form), form.smallest, 1.0, 2.0, 750.0, largest, INF]
    values += [1 - 2.0 ** -(form.significand + 1)]
    arguments = np.array([*values, *(-v for v in values), NAN])
    got = elementary(name, precision)(arguments)
    exactly = np.array([by_library(name, float(x)) for x in arguments])
    want = rounded(exactly, precision)
    same = (got == want) | (np.isnan(got) & np.isnan(want))
    with np.errstate(invalid="ignore"):
        ulp = np.spacing(np.abs(want).astype(KINDS[precision])).astype(np.float64)
        near = np.abs(got - want) <= (STATED[precision][name] + 1) * ulp
    assert np.all(same | (near & np.isfinite(want))), np.stack([arguments, got, want]).T
    number = ~np.isnan(want)
    np.testing.assert_array_equal(np.signbit(got)[number], np.signbit(want)[number])


@pytest.mark.parametrize("precision", PRECISIONS)
def test_remainder_after_division_is_exact(
    compiled: Callable[..., Evaluate], precision: Precision
) -> None:
    """The same bits as the C library's, near whole multiples and at the ends, too."""
    rng, form = np.random.default_rng(5), FORMATS[precision]
    largest = LARGEST[precision]
    tiny = 2.0 ** -digits(form)
    ends = [0.0, 1.0, 3.0, tiny, form.smallest, largest, INF, NAN]
    a, b = (v.ravel() for v in np.meshgrid(*2 * [ends + [-v for v in ends]]))
    y = binades(rng, -20, 20, 4 * POINTS)
    whole = rng.integers(-(2**20), 2**20, y.size).astype(np.float64)
    multiple = rounded(rounded(y, precision) * whole, precision)
    pairs = [
        (a, b),
        (rng.normal(size=y.size), y),
        (finite_binades(rng, form), finite_binades(rng, form)),
        (multiple, y),
        (np.nextafter(multiple.astype(KINDS[precision]), 0).astype(float), y),
    ]
    x, y = (rounded(np.concatenate(p), precision) for p in zip(*pairs, strict=True))
    left, right = ca.SX.sym("x"), ca.SX.sym("y")
    (got,) = compiled([left, right], [ca.fmod(left, right)], precision)(
        x[None], y[None]
    )
    with np.errstate(invalid="ignore"):
        want = np.fmod(x, y)
    np.testing.assert_array_equal(got[0], want)
    number = ~np.isnan(want)
    np.testing.assert_array_equal(np.signbit(got[0])[number], np.signbit(want)[number])


@pytest.mark.parametrize(
    ("precision", "oddities"),
    [
        ("double", ODDITIES + DOUBLE_ODDITIES),
        ("single", ODDITIES + SINGLE_ODDITIES),
    ],
)
@pytest.mark.parametrize("name", ["sin", "cos", "exp", "log", "tanh", "atan"])
def test_special_values_are_the_c_library_s(
    elementary: Named,
    name: str,
    precision: Precision,
    oddities: list[tuple[str, float, float]],
) -> None:
    own = [(argument, value) for of, argument, value in oddities if of == name]
    arguments, want = np.array(own).T
    got = elementary(name, precision)(arguments)
    np.testing.assert_array_equal(got, want)
    number = ~np.isnan(want)
    np.testing.assert_array_equal(np.signbit(got)[number], np.signbit(want)[number])


@pytest.mark.parametrize("precision", PRECISIONS)
def test_atan2_of_zeros_and_infinities_is_the_c_library_s(
    elementary: Named, precision: Precision
) -> None:
    large = {"double": 1.7e308, "single": 3e38}[precision]
    tiny = {"double": 5e-324, "single": TINY}[precision]
    values = [0.0, 1.0, INF, NAN, tiny, float(rounded(np.array(large), precision))]
    y, x = (a.ravel() for a in np.meshgrid(*2 * [values + [-v for v in values]]))
    kind = KINDS[precision]
    got = elementary("atan2", precision)(y, x).astype(kind)
    want = np.arctan2(y.astype(kind), x.astype(kind))
    np.testing.assert_array_max_ulp(got, want, maxulp=2)
    special = ~(np.isfinite(y) & np.isfinite(x)) | (x == 0) | (y == 0)
    np.testing.assert_array_equal(got[special], want[special])
    number = ~np.isnan(want)
    np.testing.assert_array_equal(np.signbit(got)[number], np.signbit(want)[number])


@pytest.mark.parametrize("precision", PRECISIONS)
def test_pow_of_zeros_infinities_and_negative_bases_is_the_c_library_s(
    elementary: Named, precision: Precision
) -> None:
    form = FORMATS[precision]
    tiny = 2.0 ** -digits(form)
    values = [0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 33.0, 1e10, INF, NAN, tiny]
    values += [form.smallest, np.nextafter(1.0, 0), 2.0**60 + 2.0**40, 2.0**form.bias]
    values = [float(v) for v in rounded(np.array(values), precision)]
    bases, exponents = (
        a.ravel() for a in np.meshgrid(*2 * [values + [-v for v in values]])
    )
    got = elementary("pow", precision)(bases, exponents)
    with np.errstate(all="ignore"):
        want = rounded(np.float_power(bases, exponents), precision)
    same = (got == want) | (np.isnan(got) & np.isnan(want))
    served = (bases >= form.smallest) & np.isfinite(bases) & np.isfinite(exponents)
    with np.errstate(invalid="ignore"):
        ulp = np.spacing(np.abs(want).astype(KINDS[precision])).astype(np.float64)
        near = np.abs(got - want) <= STATED[precision]["pow"] * ulp
    wrong = ~np.where(served, same | near, same)
    assert not wrong.any(), np.stack([bases, exponents, got, want]).T[wrong]
    number = ~np.isnan(want)
    np.testing.assert_array_equal(np.signbit(got)[number], np.signbit(want)[number])


@pytest.mark.parametrize("precision", PRECISIONS)
def test_sine_and_cosine_of_one_angle_are_those_of_each_alone(
    compiled: Callable[..., Evaluate], precision: Precision
) -> None:
    x = ca.SX.sym("x")
    both = compiled([x], [ca.sin(x), ca.cos(x)], precision)
    values = angles(np.random.default_rng(3), FORMATS[precision])[None]
    for together, name in zip(both(values), ("sin", "cos"), strict=True):
        alone = compiled([x], [getattr(ca, name)(x)], precision)(values)[0]
        np.testing.assert_array_equal(together, alone)


STEADY = {
    **dict.fromkeys(("exp", "expm1", "sinh", "tanh", "asinh", "atan"), (-30.0, 30.0)),
    "log": (1e-3, 30.0), "log1p": (-0.99, 30.0), "cosh": (0.0, 30.0),
    "acosh": (1.0, 30.0), "atanh": (-0.99, 0.99), "erf": (-7.0, 7.0),
    "asin": (-1.0, 1.0), "acos": (-1.0, 1.0),
}  # fmt: skip
"""Ranges on which functions are monotone: they rise, but acos falls."""


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", STEADY)
def test_functions_never_step_the_wrong_way_by_more_than_their_error(
    elementary: Named, name: str, precision: Precision
) -> None:
    """It also holds at points at which the method changes its formula."""
    low, high = STEADY[name]
    arguments = rounded(np.linspace(low, high, 200_001), precision)
    values = elementary(name, precision)(arguments) * (-1 if name == "acos" else 1)
    kind = KINDS[precision]
    ulp = np.spacing(np.abs(values[1:]).astype(kind)).astype(np.float64)
    assert np.all(np.diff(values) >= -2 * STATED[precision][name] * ulp)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", [*UNARY, "atan2", "pow"])
def test_bits_do_not_depend_on_other_individuals(
    elementary: Named, name: str, precision: Precision
) -> None:
    """Also not if the C library serves every other one of the block."""
    x, y = np.abs(np.random.default_rng(4).normal(size=(2, 64)))
    if name in DOMAINS:
        x = np.clip(x, *DOMAINS[name])
    names = [x, y][: 2 if name in ("atan2", "pow") else 1]
    alone = elementary(name, precision)(*names)
    spoilt = [np.where(np.arange(64) % 2, a, -INF) for a in names]
    got = elementary(name, precision)(*spoilt)
    np.testing.assert_array_equal(got[1::2], alone[1::2])
