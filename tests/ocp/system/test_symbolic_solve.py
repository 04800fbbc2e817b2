"""Symbolic solution of linear equations: against LAPACK, also in hard cases."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.ocp.system.algebraic import solve_in_symbols


def solved(matrix: Array, right: Array, pattern: Array | None = None) -> Array:
    """Return the solution by way of symbols with a sparsity pattern; None: dense."""
    n = len(right)
    used = np.ones((n, n)) if pattern is None else pattern
    rows, columns = (k.tolist() for k in np.nonzero(used))
    a = ca.SX.sym("a", ca.Sparsity.triplet(n, n, rows, columns))
    b = ca.SX.sym("b", n)
    function = ca.Function("z", [a, b], [solve_in_symbols(a, b)])
    return np.array(function(ca.DM(matrix), right)).ravel()


@given(st.integers(1, 7), st.integers(0, 2**32 - 1))
def test_a_sparse_matrix_gives_what_lapack_gives(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    pattern = rng.permutation(np.eye(n)) + (rng.random((n, n)) < 0.3)
    matrix, right = pattern * rng.normal(size=(n, n)), rng.normal(size=n)
    found, expected = solved(matrix, right, pattern), np.linalg.solve(matrix, right)
    # Both are backward stable; the solution differs by eps times the condition.
    size = 1e-13 * n * np.linalg.cond(matrix) * np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0, atol=size)


@pytest.mark.parametrize("smallest", [1e-3, 1e-6, 1e-9])
def test_the_condition_is_lost_once_and_not_squared(smallest: float) -> None:
    """CasADi's solve for SX is wrong by 1e-4 at 1e-6, and NaN at 1e-9."""
    matrix = np.ones((3, 3)) + np.diag([0.0, smallest, -2 * smallest])
    found = solved(matrix, matrix @ [1.0, 2.0, 3.0])
    np.testing.assert_allclose(found, [1.0, 2.0, 3.0], atol=2e-15 / smallest)


def test_zero_pivots_are_no_obstacle_and_a_singular_matrix_is_not_finite() -> None:
    turned = np.eye(3)[::-1]
    np.testing.assert_array_equal(solved(turned, np.arange(3.0)), [2.0, 1.0, 0.0])
    assert not np.isfinite(solved(np.ones((3, 3)), np.arange(3.0))).all()


def test_a_triangular_matrix_takes_a_division_for_each_row() -> None:
    a, b = ca.SX.sym("a", ca.Sparsity.upper(4)), ca.SX.sym("b", 4)
    whole = ca.Function("z", [a, b], [solve_in_symbols(a, b)])
    operations = [whole.instruction_id(k) for k in range(whole.n_instructions())]
    assert operations.count(ca.OP_DIV) == 4
    assert operations.count(ca.OP_MUL) == 6
    assert operations.count(ca.OP_ADD) + operations.count(ca.OP_SUB) == 6
