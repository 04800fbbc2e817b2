from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp.compiled.vectors.operations import LARGEST_CHAIN, fused_products
from swarmstart.tape import read_tape

Evaluate = Callable[..., tuple[Array, ...]]
x, y, z, w = (ca.SX.sym(name) for name in "xyzw")


def sq(value: ca.SX) -> ca.SX:
    return ca.SX.unary(ca.OP_SQ, value)


def fused(*outputs: ca.SX) -> list[tuple[str, str]]:
    """Return (sum, product) of what is fused."""
    tape = read_tape(ca.Function("f", [x, y, z, w], list(outputs)))
    return [
        (tape.nodes[total].operation, tape.nodes[product].operation)
        for total, product in fused_products(tape).items()
    ]


@pytest.mark.parametrize(
    ("value", "taken"),
    [
        (x * y + z, ("add", "mul")),
        (z - x * y, ("sub", "mul")),
        (x * y - z, ("sub", "mul")),
        (sq(x) + 1, ("add", "sq")),
        (2 * x - z, ("sub", "twice")),
        (sq(x) + sq(y), ("add", "sq")),
    ],
)
def test_product_that_one_sum_uses_is_taken_in(
    value: ca.SX, taken: tuple[str, str]
) -> None:
    assert fused(value) == [taken]


@pytest.mark.parametrize(
    "value",
    [x * y + z * w, x * y - z * w, sq(x) - sq(y), sq(x) + y * z, x + y, x * y],
)
def test_sum_of_two_products_takes_in_none(value: ca.SX) -> None:
    assert fused(value) == []


def test_product_that_something_else_uses_is_rounded() -> None:
    assert fused(x * y + z, ca.sin(x * y)) == []
    assert fused(x * y + z, x * y) == []


def test_fused_sum_is_rounded_once(compiled: Callable[..., Evaluate]) -> None:
    values = np.random.default_rng(1).normal(size=(3, 1, 99))
    a, b, c = values.astype(np.float32).astype(np.float64)
    sums = ca.vertcat(x * y + z, x * y - z, z - x * y, sq(x) - z, z - sq(x))
    (got,) = compiled([x, y, z], [sums])(a, b, c)
    # Products of single-precision numbers are exact in double precision.
    want = np.concatenate([a * b + c, a * b - c, c - a * b, a * a - c, c - a * a])
    np.testing.assert_array_equal(got, want)
    a, b = np.nextafter(a, 9), np.nextafter(b, 9)
    (residue,) = compiled([x, y, z], [x * y - z])(a, b, a * b)
    assert np.any(residue)
    assert np.all(np.abs(residue) <= np.spacing(np.abs(a * b)))


@pytest.mark.parametrize("power", [*range(-LARGEST_CHAIN - 2, LARGEST_CHAIN + 3)])
def test_constant_powers_are_numpy_s(
    compiled: Callable[..., Evaluate], power: int
) -> None:
    values = np.random.default_rng(1).normal(size=(1, 200))
    got = compiled([x], [ca.SX.binary(ca.OP_CONSTPOW, x, power)])(values)[0]
    np.testing.assert_allclose(got, np.float_power(values, power), rtol=1e-15)


def test_difference_of_equal_products_or_squares_is_zero(
    compiled: Callable[..., Evaluate],
) -> None:
    a, b = np.random.default_rng(1).normal(size=(2, 1, 500))
    outputs = [x * y - z * w, ca.sqrt(sq(x) - sq(z))]
    for got in compiled([x, y, z, w], outputs)(a, b, a, b):
        np.testing.assert_array_equal(got, 0.0)


@pytest.mark.parametrize("swapped", [False, True])
def test_difference_of_a_product_and_twice_its_half_is_zero(
    compiled: Callable[..., Evaluate], swapped: bool
) -> None:
    """Twice a value is exact: it is what is taken in, not the product beside it."""
    x, y, h = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("h")
    values = np.random.default_rng(2).uniform(0.1, 1.0, (2, 1, 500))
    half = values[0] * values[1] / 2
    difference = 2 * h - x * y if swapped else x * y - 2 * h
    got = compiled([x, y, h], [difference])(values[0], values[1], half)[0]
    np.testing.assert_array_equal(got, 0.0)
