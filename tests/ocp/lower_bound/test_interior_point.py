"""Linear programs against HiGHS, and what becomes of those without an optimum."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.interior_point import Optimum, maximised

SEEDS = st.integers(0, 2**32 - 1)


def bounded(A: Array, b: Array, most: float) -> tuple[Array, Array]:
    """Rows A w + b >= 0 with |w| <= most."""
    eye = np.eye(A.shape[1])
    rows = np.vstack([A, eye, -eye])
    return rows, np.concatenate([b, np.full(2 * A.shape[1], most)])


def highs(c: Array, A: Array, b: Array) -> tuple[int, float]:
    """Status (0 solved, 2 infeasible, 3 unbounded) and the greatest c'w."""
    found = linprog(-c, A_ub=-A, b_ub=b, bounds=[(None, None)] * c.size)
    return found.status, -found.fun if found.status == 0 else np.nan


def require_optimum(found: Optimum, c: Array, A: Array, b: Array) -> None:
    """Check feasibility, duality and the value, each without the other."""
    status, best = highs(c, A, b)
    size = 1 + abs(best)
    assert status == 0
    assert found.solved
    assert found.gap < 1e-6
    assert c @ found.w == pytest.approx(best, abs=1e-5 * size)
    assert ((A @ found.w + b) / np.abs(A).max(axis=1)).min() > -1e-7
    assert (found.duals >= 0).all()
    assert A.T @ found.duals == pytest.approx(-c, abs=1e-6 * (1 + np.abs(c).max()))
    assert b @ found.duals == pytest.approx(best, abs=1e-4 * size)


def drawn(seed: int, decades: float = 2.0) -> tuple[Array, Array, Array]:
    """A program that some w satisfies with some of its rows at 0."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 9))
    count = int(rng.integers(1, 12 * m))
    A = rng.normal(size=(count, m))
    A *= 10.0 ** rng.uniform(-decades, decades, (count, 1))
    inner = rng.normal(size=m)
    slack = np.where(rng.random(count) < 0.3, 0.0, rng.random(count))
    A, b = bounded(A, slack * np.abs(A).max(axis=1) - A @ inner, 10.0)
    return rng.normal(size=m), A, b


@settings(max_examples=80, deadline=None)
@given(SEEDS)
def test_optima_are_those_of_highs(seed: int) -> None:
    c, A, b = drawn(seed)
    require_optimum(maximised(c, A, b), c, A, b)


@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_rows_that_are_repeated_change_nothing(seed: int) -> None:
    c, A, b = drawn(seed)
    A, b = np.vstack([A, A, 3 * A]), np.concatenate([b, b, 3 * b])
    require_optimum(maximised(c, A, b), c, A, b)


@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_many_rows_through_one_point_are_solved(seed: int) -> None:
    # All rows are 0 at the optimum: degenerate in the extreme.
    rng = np.random.default_rng(seed)
    m = int(rng.integers(2, 7))
    A = rng.normal(size=(20 * m, m))
    best = rng.normal(size=m)
    c = -A.T @ rng.random(20 * m) / (20 * m)
    A, b = bounded(A, -A @ best, 10.0)
    require_optimum(maximised(c, A, b), c, A, b)


def test_a_face_of_best_points_is_solved() -> None:
    A, b = bounded(np.array([[-1.0, -1.0]]), np.array([1.0]), 10.0)
    c = np.array([1.0, 1.0])
    require_optimum(maximised(c, A, b), c, A, b)


def test_without_objective_any_feasible_point_is_an_answer() -> None:
    _, A, b = drawn(3)
    found = maximised(np.zeros(A.shape[1]), A, b)
    assert found.solved
    assert (A @ found.w + b).min() > -1e-6


def test_equal_bounds_of_an_unknown_fix_it() -> None:
    A = np.array([[1.0, 0], [-1.0, 0], [0, 1], [0, -1]])
    b = np.array([-2.0, 2.0, 5.0, 5.0])  # w_0 = 2
    found = maximised(np.array([-1.0, 1.0]), A, b)
    assert found.w == pytest.approx([2.0, 5.0], abs=1e-5)


def finite(found: Optimum) -> bool:
    return bool(np.isfinite(found.w).all() and np.isfinite(found.duals).all())


@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_programs_without_a_feasible_point_are_not_solved(seed: int) -> None:
    c, A, b = drawn(seed, decades=1.0)
    row = np.random.default_rng(seed).normal(size=c.size)
    A = np.vstack([A, row, -row])
    b = np.append(b, [-1.0, 0.5])  # row w >= 1 and row w <= 1 / 2
    assert highs(c, A, b)[0] == 2
    found = maximised(c, A, b)
    assert not found.solved
    assert finite(found)


@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_programs_without_bound_are_not_solved(seed: int) -> None:
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 6))
    away = rng.normal(size=m)
    A = rng.normal(size=(5 * m, m))
    A *= np.sign(A @ away)[:, None]  # A away > 0: away is a ray.
    b, c = rng.random(5 * m), away
    assert highs(c, A, b)[0] in (3, 4)
    found = maximised(c, A, b)
    assert not found.solved or found.gap > 1e-6
    assert finite(found)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("part", ["c", "A", "b"])
def test_what_is_not_finite_is_not_solved(part: str, value: float) -> None:
    c, A, b = drawn(5)
    {"c": c, "A": A, "b": b}[part].flat[0] = value
    found = maximised(c, A, b)
    assert not found.solved


def test_rows_that_are_empty_change_nothing() -> None:
    c, A, b = drawn(8)
    best = maximised(c, A, b)
    more = np.vstack([A, np.zeros((2, c.size))])
    found = maximised(c, more, np.append(b, [0.0, 1.0]))
    assert found.solved
    assert c @ found.w == pytest.approx(c @ best.w, abs=1e-5)


def test_too_few_iterations_are_not_called_an_optimum() -> None:
    c, A, b = drawn(2)
    found = maximised(c, A, b, iterations=2)
    assert found.gap > 1e-6
    assert finite(found)


@pytest.mark.parametrize("seed", range(6))
def test_solved_says_that_rows_and_duals_hold_after_any_iterations(seed: int) -> None:
    c, A, b = drawn(seed)
    sizes = np.abs(A).max(axis=1)
    met = set()
    for iterations in range(1, 25):
        # The outcome's `solved` is that of the point before the last step: it stays so.
        found = maximised(c, A, b, iterations=iterations, tolerance=1e-12)
        rows = ((A @ found.w + b) / sizes).min() > -1e-7
        duals = np.abs(A.T @ found.duals + c).max() < 1e-6 * (1 + np.abs(c).max())
        assert not found.solved or (rows and duals)
        met.add(found.solved)
    assert met == {False, True}
