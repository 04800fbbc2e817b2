"""Polynomials of (t, x) against NumPy's Chebyshev series."""

import casadi as ca
import numpy as np
import pytest
from numpy.polynomial import chebyshev

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.basis import Basis, Box, packed

SIZES = [(1, 0), (1, 7), (2, 1), (2, 5), (3, 4), (4, 3)]


def drawn(variables: int) -> tuple[Box, Array, np.random.Generator]:
    """A box far from its origin, and points in and a little beside it."""
    rng = np.random.default_rng(variables)
    box = Box(rng.normal(size=variables) * 3, 10.0 ** rng.uniform(-2, 2, variables))
    z = rng.uniform(-1.2, 1.2, (variables, 30))
    return box, box.middle[:, None] + box.half[:, None] * z, rng


def series(basis: Basis, box: Box, j: int, points: Array, axis: int = -1) -> Array:
    """Product j at points, or its derivative along an axis, as NumPy has it."""
    found = np.ones(points.shape[1])
    for a, exponent in enumerate(basis.exponents[j]):
        alone = np.eye(basis.degree + 1)[exponent]
        z = (points[a] - box.middle[a]) / box.half[a]
        if a == axis:
            found *= chebyshev.chebval(z, chebyshev.chebder(alone)) / box.half[a]
        else:
            found *= chebyshev.chebval(z, alone)
    return found


@pytest.mark.parametrize(("variables", "degree"), SIZES)
def test_values_and_slopes_are_those_of_numpy_s_series(
    variables: int, degree: int
) -> None:
    basis = Basis(variables, degree)
    box, points, _ = drawn(variables)
    values, slopes = basis.values(box, points), basis.slopes(box, points)
    assert slopes.shape == (variables, *values.shape) == (variables, 30, basis.size)
    for j in range(basis.size):
        assert values[:, j] == pytest.approx(series(basis, box, j, points), abs=1e-12)
        for axis in range(variables):
            exact = series(basis, box, j, points, axis)
            near = 1e-12 / box.half[axis]
            assert slopes[axis, :, j] == pytest.approx(exact, rel=1e-11, abs=near)


@pytest.mark.parametrize(("variables", "degree"), SIZES)
def test_the_expression_has_the_values_of_the_packed_polynomial(
    variables: int, degree: int
) -> None:
    basis = Basis(variables, degree)
    box, points, rng = drawn(variables)
    w = rng.normal(size=basis.size)
    parameters = packed(basis.polynomial(box, w))
    assert parameters.shape == (basis.parameters,)
    point = ca.SX.sym("y", variables)
    given = ca.SX.sym("p", basis.parameters)
    V = ca.Function("V", [point, given], [basis.expression(point, given)])
    found = np.array(V(points, np.repeat(parameters[:, None], 30, axis=1))).ravel()
    assert found == pytest.approx(basis.values(box, points) @ w, rel=1e-11, abs=1e-11)


@pytest.mark.parametrize(("variables", "degree"), SIZES)
def test_the_products_are_all_of_the_degree_the_constant_first(
    variables: int, degree: int
) -> None:
    basis = Basis(variables, degree)
    every = {tuple(e) for e in basis.exponents.tolist()}
    count = 1
    for k in range(1, variables + 1):
        count = count * (degree + k) // k
    assert len(every) == basis.size == count
    assert basis.exponents.sum(axis=1).max() == degree
    assert not basis.exponents[0].any()


def test_a_polynomial_keeps_its_coefficients_if_the_array_changes() -> None:
    basis = Basis(2, 2)
    box, _, rng = drawn(2)
    w = rng.normal(size=basis.size)
    polynomial, before = basis.polynomial(box, w), w.copy()
    w[:] = 0
    assert (polynomial.coefficients == before).all()


def test_a_box_around_corners_has_them_at_one_and_no_side_of_zero() -> None:
    lower, upper = np.array([-1.0, 5.0, 1e6]), np.array([3.0, 7.0, 1e6])
    box = Box.around(lower, upper)
    z = box.scaled(np.column_stack([lower, upper]))
    assert z[:2] == pytest.approx(np.array([[-1.0, 1.0], [-1.0, 1.0]]))
    assert (box.half > 0).all()
    assert z[2] == pytest.approx(np.zeros(2))
