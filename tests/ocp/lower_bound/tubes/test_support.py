"""Bounds of q'x over polytopes, against SciPy's linear programmes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.tubes.faces import (
    dual_vertices,
    dual_vertices_on_faces,
    template_of,
)
from swarmstart.ocp.lower_bound.tubes.tube import _directions

UNBOUND = {n: (np.full(n, -np.inf), np.full(n, np.inf)) for n in (1, 2, 3)}
ROWS = {n: _directions(n, 16) for n in (1, 2, 3)}


def greatest(rows: Array, levels: Array, q: Array, face: int | None = None) -> float:
    """The greatest q'x over the polytope or a face of it; NaN if that is empty."""
    equal = {} if face is None else {"A_eq": rows[[face]], "b_eq": levels[[face]]}
    found = linprog(-q, A_ub=rows, b_ub=levels, bounds=[(None, None)] * q.size, **equal)
    return -float(found.fun) if found.status == 0 else float("nan")


@settings(max_examples=60, deadline=None)
@given(n=st.sampled_from([1, 2, 3]), seed=st.integers(0, 2**32 - 1))
def test_the_support_is_that_of_a_linear_programme(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = ROWS[n]
    inner = rng.normal(size=n) * rng.choice([0.0, 1.0, 100.0])
    levels = rows @ inner + rng.random(len(rows)) ** rng.integers(1, 5)
    directions = np.vstack([rng.normal(size=(3, n)), rows[:4]])
    reach = np.abs(levels[: 2 * n]).max()
    bounds = dual_vertices(rows, directions).upper(levels, reach)
    for q, bound in zip(directions, bounds, strict=True):
        exact = greatest(rows, levels, q)
        assert bound == pytest.approx(exact, rel=1e-8, abs=1e-8 * (1 + reach))
        # No point known to be inside is beyond.
        assert bound >= q @ inner


@settings(max_examples=40, deadline=None)
@given(n=st.sampled_from([2, 3]), seed=st.integers(0, 2**32 - 1))
def test_the_ends_of_a_face_are_those_of_a_linear_programme(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = ROWS[n]
    levels = 1 + 0.1 * rng.random(len(rows))
    q = rng.normal(size=(len(rows), 2, n))
    bounds = dual_vertices_on_faces(rows, q).upper(levels, 2.0)
    for face in rng.choice(len(rows), 3, replace=False):
        for k in range(2):
            exact = greatest(rows, levels, q[face, k], face)
            if not np.isnan(exact):
                assert bounds[2 * face + k] == pytest.approx(exact, abs=1e-7)


def test_a_bound_of_two_polytopes_holds_of_those_between() -> None:
    rows, rng = ROWS[2], np.random.default_rng(4)
    start, stop = 1 + rng.random((2, len(rows)))
    q = rng.normal(size=(5, 2))
    bounds = dual_vertices(rows, q).upper(np.array([start, stop]), 2.0)
    for part in np.linspace(0, 1, 5):
        levels = start + part * (stop - start)
        assert all(
            greatest(rows, levels, one) <= bound + 1e-9
            for one, bound in zip(q, bounds, strict=True)
        )


def test_vertices_are_never_beyond_their_own_support() -> None:
    # The bound is 0 over there but for rounding; a pad of the wrong sign shows.
    rows, rng = ROWS[2], np.random.default_rng(5)
    vertices = dual_vertices(rows, rows)
    for _ in range(200):
        x = rng.normal(size=2) * 10.0 ** rng.integers(-6, 6)
        levels = rows @ x
        reach = np.abs(levels).max()
        excess = vertices.upper(levels, reach) - levels
        assert (excess >= -1e-16 * reach).all()
        assert (excess <= 1e-11 * reach).all()


@pytest.mark.parametrize("n", [1, 2, 3])
def test_levels_drawn_in_keep_the_polytope(n: int) -> None:
    rng = np.random.default_rng(6)
    template = template_of(ROWS[n], UNBOUND[n])
    levels = 1 + 5 * rng.random(len(ROWS[n])) ** 3
    drawn = template.tightened(levels)
    assert (drawn <= levels).all()
    for row, level in zip(ROWS[n], drawn, strict=True):
        exact = greatest(ROWS[n], levels, row)
        assert exact - 1e-9 <= level <= exact + 1e-8


def test_bounds_of_states_are_rows_of_the_polytope() -> None:
    template = template_of(ROWS[2], (np.array([-np.inf, -0.25]), np.array([0.5, 3.0])))
    drawn = template.tightened(np.ones(len(ROWS[2])))
    assert drawn[:4] == pytest.approx([0.5, 1.0, 1.0, 0.25], abs=1e-9)
