"""Series of elementary functions, and programs with exact numbers, against Arb."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.terminal_set.checker import evaluation
from swarmstart.terminal_set.checker.evaluation import (
    FUNCTIONS,
    Node,
    Program,
    as_model,
    plus,
    power,
    rounded,
    times,
)
from swarmstart.terminal_set.checker.findings import NEVER, TimeIsUpError
from swarmstart.terminal_set.checker.models import (
    ELEMENTARY,
    Model,
    Series,
    algebra_of,
)
from swarmstart.terminal_set.checker.rays import Along
from swarmstart.tests.terminal_set.checker.changes import after_looks
from swarmstart.tests.terminal_set.checker.test_functions import (
    BINARY,
    UNARY,
    assert_encloses,
)

flint = pytest.importorskip("flint")
arb = flint.arb


@pytest.fixture(autouse=True)
def precise() -> Iterator[None]:
    before, flint.ctx.prec = flint.ctx.prec, 200
    yield
    flint.ctx.prec = before


SERIES: dict[str, Callable[[Array, Model], Series]] = {
    "inv": evaluation._inverse,
    "exp": evaluation._exponential,
    "log": evaluation._logarithm,
    "sqrt": evaluation._root,
    "atan": evaluation._arctangent,
    "sin": lambda at, _: evaluation._angles(at, 0),
    "cos": lambda at, _: evaluation._angles(at, 1),
}
POSITIVE = ("inv", "log", "sqrt")


def derivatives(name: str, x: float) -> list[Any]:
    """g^(k) / k! for k = 0, ..., 4."""
    t = flint.arb_series([arb(x), arb(1)], prec=5)
    g = 1 / t if name == "inv" else getattr(t, name)()
    return [g[k] for k in range(5)]


@pytest.mark.parametrize("name", SERIES)
def test_a_series_has_the_derivatives_and_bounds_the_last(name: str) -> None:
    rng = np.random.default_rng(0)
    x = 10.0 ** rng.uniform(-3, 2, 80)
    if name not in ("log", "sqrt"):
        x *= rng.choice([-1.0, 1.0], 80)
    radius = rng.choice([1e-3, 0.3, 0.9], 80) * np.abs(x)
    with np.errstate(all="ignore"):
        box = algebra_of(1).variable(0, x, radius)
        factors, last, sizes = SERIES[name](x, box)
    for k in range(80):
        exact = derivatives(name, x[k])
        for order in range(4):
            error = abs(arb(float(factors[order][k])) - exact[order])
            size = float(sizes[order][k])
            assert not error > ELEMENTARY * size
            # No size is larger than it has to be; those that may cancel are of 1, or
            # of both terms of the third derivative of atan.
            largest = abs(float(exact[order].mid()))
            if name in ("sin", "cos"):
                largest = 1.0
            if name == "atan" and order == 3:
                largest = (3 * x[k] ** 2 + 1) / (1 + x[k] ** 2) ** 3
            assert size <= largest * (1 + 1e-9)
        ends = [x[k] - radius[k], x[k], x[k] + radius[k]]
        most = max(abs(float(derivatives(name, end)[4].mid())) for end in ends)
        assert last[k] >= most * (1 - 1e-12)
        assert last[k] <= (1 + 1e-9) * {"sin": 1 / 24, "cos": 1 / 24, "atan": 0.25}.get(
            name, most
        )


@pytest.mark.parametrize("name", POSITIVE)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_series_is_known_only_within_the_domain(name: str, sign: float) -> None:
    """A box from 1e-9 on, one from 0 on, one from -1e-9 on; the same below 0."""
    middle = sign * np.array([1.0, 1.0, 1.0])
    box = algebra_of(1).variable(0, middle, 1.0 + np.array([-1e-9, 0.0, 1e-9]))
    with np.errstate(all="ignore"):
        _, last, _ = SERIES[name](middle, box)
    known = [True, False, False] if sign > 0 or name == "inv" else [False] * 3
    np.testing.assert_array_equal(np.isfinite(last), known)


@pytest.mark.parametrize("function", [FUNCTIONS["sin"], FUNCTIONS["cos"]])
def test_of_angles_beyond_a_million_only_the_bounds_are_known(
    function: Callable[[Model], Model],
) -> None:
    far = np.array([1e6, np.nextafter(1e6, 2e6), 1e9, 1e300])
    for sign in (-1.0, 1.0):
        box = algebra_of(1).variable(0, sign * far, np.full(4, 0.5))
        found = function(box)
        # Of a series of one straight variable, |g^(4)| / 4! is all that is left out.
        assert 0.5**4 / 24 <= found.error[0] < 1.001 * 0.5**4 / 24
        # Values in [-1, 1], slopes in [-1, 1], and nothing more.
        assert not found.coefficients[:, 1:].any()
        assert (found.error[1:] >= 1.5).all()
        assert (found.error[1:] < 1.5 * (1 + 1e-9)).all()
        exact = (flint.arb.sin if function is FUNCTIONS["sin"] else flint.arb.cos)(
            arb(sign * 1e6) + arb(0.25)
        )
        first = Model(found.algebra, found.coefficients[:, :1], found.error[:1])
        assert_encloses(first, (0.5,), exact)


@pytest.mark.parametrize("name", [*UNARY, *BINARY])
def test_numbers_of_any_size_are_enclosed(name: str) -> None:
    """Also where powers of them under- and overflow; the same along rays."""
    rng, algebra = np.random.default_rng(1), algebra_of(1)
    exact = (UNARY | BINARY)[name]
    known = 0
    for _ in range(80):
        a, b = 10.0 ** rng.uniform(-160, 160, 2)
        r = float(rng.choice([0.0, 1e-9, 0.5, 0.9])) * a
        # To s and beyond: to the left of the middle, where remainders are largest.
        s = float(rng.choice([-1.0, -0.75, 1.0]))
        x = algebra.variable(0, np.array([a]), np.array([r]))
        models, balls = [x], [arb(a) + arb(r) * arb(s)]
        if name in BINARY:
            b = float(rng.uniform(-2, 2)) if name == "pow" else b
            models.append(x.number(b))
            balls.append(arb(b))
        with np.errstate(all="ignore"):
            found = FUNCTIONS[name](*models)
        assert_encloses(found, (s,), exact(*balls))
        known += bool(np.isfinite(found.error).all())
        half = r / 2 or 10.0 ** rng.uniform(-160, 160)  # of the longest ray
        rho = algebra.variable(0, np.array([half]), np.array([half]))
        rays = [Along(rho.number(a), rho.number(1.0), rho)]
        moved = arb(a) + arb(half) * (1 + arb(s))
        numbers = [arb(a)]
        if name in BINARY:
            rays.append(Along(rho.number(b), rho.number(0.0), rho))
            numbers.append(arb(b))
        with np.errstate(all="ignore"):
            along = FUNCTIONS[name](*rays)
        assert_encloses(along.at, (s,), exact(*numbers))
        if s != -1.0:
            slope = exact(moved, *numbers[1:]) - exact(*numbers)
            assert_encloses(along.slope, (s,), slope / (moved - arb(a)))
    assert known > 10


def test_powers_are_products_roots_or_by_logarithms() -> None:
    """The first is defined for negative numbers as well; the others for none."""
    x = algebra_of(1).variable(0, np.array([-0.5, 0.5]), np.full(2, 1e-3))
    with np.errstate(all="ignore"):
        for n in (-64, -3, -1, 0, 1, 2, 3, 64):
            found = power(x, float(n))
            for s in (-1.0, 0.5, 1.0):
                for k, middle in enumerate((-0.5, 0.5)):
                    one = Model(x.algebra, found.coefficients[:, [k]], found.error[[k]])
                    assert np.isfinite(one.error).all()
                    assert_encloses(one, (s,), (arb(middle) + arb(1e-3) * arb(s)) ** n)
        for exponent in (-65.0, 65.0, 0.5, 2.5):
            found = power(x, exponent)
            np.testing.assert_array_equal(np.isfinite(found.error), [False, True])
        half = power(x, 0.5)
        np.testing.assert_array_equal(half.error, evaluation.root(x).error)
    np.testing.assert_array_equal(power(x, 3.0).error, ((x * x) * x).error)
    np.testing.assert_array_equal(power(x, 1.0).error, x.error)
    assert not power(x, 0.0).error.any()


@pytest.mark.parametrize("middle", [-0.7, 0.0, 0.7, 30.0, -30.0, 800.0, -800.0])
def test_hyperbolic_tangents_of_large_numbers_are_within_one(middle: float) -> None:
    x = algebra_of(1).variable(0, np.array([middle]), np.array([0.05]))
    found = FUNCTIONS["tanh"](x)
    assert_encloses(found, (1.0,), (arb(middle) + arb(0.05)).tanh())
    assert found.error[0] < 2e-5 * (1.0 - math.tanh(middle) ** 2) + 1e-12


def test_the_larger_and_smaller_of_two_are_thin_if_they_are_apart() -> None:
    algebra = algebra_of(1)
    a = algebra.variable(0, np.array([1.0]), np.array([0.25]))
    b = algebra.variable(0, np.array([3.0]), np.array([0.5]))
    for name, expected in (("fmax", b), ("fmin", a)):
        found = FUNCTIONS[name](a, b)
        near = expected.coefficients
        np.testing.assert_allclose(found.coefficients, near, atol=1e-15)
        assert found.error[0] < 1e-12


NUMBERS = [Fraction(0), Fraction(2), Fraction(-1, 3), Fraction(5, 7), Fraction(1, 2)]


@pytest.mark.parametrize("name", BINARY)
@pytest.mark.parametrize("number", NUMBERS, ids=str)
def test_operations_with_exact_numbers_are_enclosed_and_thin(
    name: str, number: Fraction
) -> None:
    """x op number, number op x, for x in [.75, 1.25]: as a step of a program."""
    algebra = algebra_of(1)
    x = algebra.variable(0, np.array([1.0]), np.array([0.25]))
    ball = arb(number.numerator) / number.denominator
    nodes = [Node("point", (0,)), Node("const", (), number)]
    for order in ((0, 1), (1, 0)):
        program = Program([*nodes, Node(name, order)], [2])
        with np.errstate(all="ignore"):
            found = program([x])[2]
        if isinstance(found, Fraction):
            assert found == 0
            found = x.number(0.0)
        for s in (-1.0, 0.3, 1.0):
            at = arb(1.0) + arb(0.25) * arb(s)
            pair = (at, ball) if order == (0, 1) else (ball, at)
            assert_encloses(found, (s,), BINARY[name](*pair))
        divided = name == "div" and order == (0, 1) and number == 0
        negative = name == "pow" and order == (1, 0) and number <= 0
        assert np.isfinite(found.error).all() != (divided or negative)
        if name in ("add", "sub", "mul") or (name == "div" and order == (0, 1)):
            assert divided or found.error[0] < 1e-13


@pytest.mark.parametrize("name", BINARY)
def test_a_step_of_a_program_is_the_function_of_its_operands(name: str) -> None:
    algebra = algebra_of(2)
    x = algebra.variable(0, np.array([2.0]), np.array([0.25]))
    y = algebra.variable(1, np.array([1.0]), np.array([0.5]))
    nodes = [Node("point", (1,)), Node("point", (0,)), Node(name, (1, 0))]
    found, expected = Program(nodes, [2])([x, y])[2], FUNCTIONS[name](x, y)
    np.testing.assert_array_equal(found.coefficients, expected.coefficients)
    np.testing.assert_array_equal(found.error, expected.error)


@pytest.mark.parametrize("name", UNARY)
def test_so_is_a_step_of_one_operand(name: str) -> None:
    x = algebra_of(1).variable(0, np.array([2.0]), np.array([0.25]))
    found = Program([Node("point", (0,)), Node(name, (0,))], [1])([x])[1]
    np.testing.assert_array_equal(found.error, FUNCTIONS[name](x).error)
    np.testing.assert_array_equal(found.coefficients, FUNCTIONS[name](x).coefficients)


def test_numbers_are_added_and_multiplied_exactly() -> None:
    a, b = Fraction(1, 3), Fraction(2, 7)
    assert times(a, b) == a * b
    assert plus(a, b) == a + b
    nodes = [Node("const", (), a), Node("const", (), b), Node("mul", (0, 1))]
    nodes += [Node("sub", (2, 0)), Node("add", (3, 1)), Node("sub", (0, 4))]
    variables = [algebra_of(1).constant(np.zeros(1))]
    assert Program(nodes, [5])(variables) == {5: a - (a * b - a + b)}


def test_a_fraction_is_rounded_to_the_nearest_with_its_distance() -> None:
    rng = np.random.default_rng(2)
    for top, bottom in rng.integers(1, 10**12, (200, 2)).tolist():
        number = Fraction(top, bottom) * (-1) ** top
        near, off = rounded(number)
        assert near == float(number)
        distance = abs(number - Fraction(near))
        assert distance <= Fraction(off) <= distance * Fraction(1 + 2**-50)
    assert rounded(Fraction(-3, 4)) == (-0.75, 0.0)
    assert all(map(math.isnan, rounded(Fraction(10) ** 400)))


def test_a_number_becomes_a_model_of_all_boxes() -> None:
    x = algebra_of(2).variable(0, np.zeros(3), np.ones(3))
    third = as_model(Fraction(1, 3), x)
    assert third.coefficients.shape == x.coefficients.shape
    assert (third.middle == 1 / 3).all() and not third.coefficients[1:].any()
    assert (0 < third.error).all() and (third.error < 1e-16).all()
    assert as_model(x, third) is x


CHAIN = [
    Node("point", (1,)),  # 0
    Node("point", (0,)),  # 1
    Node("const", (), Fraction(3)),  # 2
    Node("mul", (0, 2)),  # 3
    Node("sin", (1,)),  # 4, not needed
    Node("add", (3, 0)),  # 5
    Node("sq", (5,)),  # 6
]


def test_a_program_takes_the_steps_that_are_needed_and_no_more() -> None:
    program = Program(CHAIN, [6, 3, 6])
    assert program.outputs == (6, 3, 6)
    assert program.wanted == {3, 6}
    assert program.points == {1}
    assert [number for number, _ in program.steps] == [0, 2, 3, 5, 6]
    calls = []

    def applied(operation: str, operands: list[Any]) -> Any:
        calls.append(operation)
        first, last = operands[0], operands[-1]
        return {"mul": first * last, "add": first + last, "sq": first**2}[operation]

    assert program([7.0, 2.0], applied) == {3: 6.0, 6: 64.0}
    assert calls == ["mul", "add", "sq"]
    assert Program(CHAIN, [1, 2]).points == {0}
    assert Program(CHAIN, []).steps == []


def test_a_value_is_dropped_after_its_last_use() -> None:
    """So at no time are more than two values of a chain kept."""
    alive = []

    class Counted:
        number = 0

        def __init__(self) -> None:
            Counted.number += 1

        def __del__(self) -> None:
            Counted.number -= 1

    def applied(operation: str, operands: list[Any]) -> Counted:
        alive.append(Counted.number)
        return Counted()

    length = 20
    nodes = [Node("point", (0,)), *(Node("neg", (k,)) for k in range(length))]
    found = Program(nodes, [length])([None], applied)
    assert list(found) == [length]
    assert max(alive) == 1


@pytest.mark.parametrize("length", [1, 32, 33, 64, 65])
def test_the_clock_is_looked_at_every_32_steps(length: int) -> None:
    nodes = [Node("point", (0,)), *(Node("neg", (k,)) for k in range(length - 1))]
    variables = [algebra_of(1).constant(np.ones(1))]
    looks = -(-length // 32)
    for allowed in (looks - 1, looks):
        program = Program(nodes, [length - 1], after_looks(allowed))
        if allowed < looks:
            with pytest.raises(TimeIsUpError):
                program(variables)
        else:
            assert abs(program(variables)[length - 1].middle[0]) == 1.0
    assert Program(nodes, [length - 1], NEVER)(variables)


OF_NUMPY = {"exp": "exp", "log": "log", "sqrt": "sqrt", "atan": "arctan"} | {
    name: name for name in ("sin", "cos")
}


@pytest.mark.parametrize("units", [-15, 15])
@pytest.mark.parametrize("name", OF_NUMPY)
def test_functions_of_numpy_may_be_off_by_sixteen_units(
    name: str, units: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the last place of the result, and of 1 for sines and cosines; so do slopes."""
    of_one = name in ("sin", "cos")

    def off(own: Callable[[Array], Array]) -> Callable[[Array], Array]:
        size = 1.0 if of_one else 0.0

        def function(x: Array) -> Array:
            exact = own(x)
            return np.asarray(exact + units * 2.0**-52 * (size or np.abs(exact)))

        return function

    names = ("sin", "cos") if of_one else (OF_NUMPY[name],)
    algebra = algebra_of(1)
    middle = np.random.default_rng(3).uniform(0.5, 9.0, 40)
    middle[:8] = np.arange(1, 9) * np.pi / 2  # where sines or cosines are small
    x = algebra.variable(0, middle, np.zeros(40))
    with monkeypatch.context() as patch:
        for other in names:
            patch.setattr(np, other, off(getattr(np, other)))
        found = FUNCTIONS[name](x)
        rho = algebra.variable(0, np.full(40, 1e-3), np.full(40, 1e-3))
        rays = FUNCTIONS[name](Along(x.number(middle), x.number(1.0), rho))
    for k in range(40):
        exact = UNARY[name](arb(float(middle[k])))
        one = Model(algebra, found.coefficients[:, [k]], found.error[[k]])
        assert_encloses(one, (0.0,), exact)
        one = Model(algebra, rays.slope.coefficients[:, [k]], rays.slope.error[[k]])
        far = arb(1e-3) + arb(1e-3) * arb(-0.999)
        slope = (UNARY[name](arb(float(middle[k])) + far) - exact) / far
        assert_encloses(one, (-0.999,), slope)
