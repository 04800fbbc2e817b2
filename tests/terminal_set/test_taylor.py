"""Bounds on cells of a ball hold at the points of the cells."""

from __future__ import annotations

import casadi as ca
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmstart.terminal_set.cells import Cells
from swarmstart.terminal_set.taylor import TaylorForm

Array = NDArray[np.float64]
NX, BOXES, POINTS = 3, 40, 60

seeds = st.integers(0, 2**32 - 1)
widths = st.floats(1e-6, 1.0)


def boxes(rng: np.random.Generator, width: float) -> tuple[Array, Array]:
    """Boxes of (rho, w), w on a face of the cube, (1 + nx, m)."""
    lower = rng.uniform(-1, 1, (1 + NX, BOXES))
    upper = np.minimum(lower + width * rng.random((1 + NX, BOXES)), 1.0)
    face, each = 1 + rng.integers(NX, size=BOXES), np.arange(BOXES)
    lower[face, each] = upper[face, each] = rng.choice([-1.0, 1.0], BOXES)
    lower[0] = rng.uniform(0.05, 3, BOXES)
    upper[0] = lower[0] + width * rng.random(BOXES)
    return lower, upper


def points_in(lower: Array, upper: Array, rng: np.random.Generator) -> Array:
    """Points z of each cell, corners among them, (nx, m, points)."""
    share = rng.random((1 + NX, BOXES, POINTS))
    share[..., : POINTS // 2] = share[..., : POINTS // 2].round()
    v = lower[..., None] + share * (upper - lower)[..., None]
    return np.asarray(v[0] * v[1:] / np.linalg.norm(v[1:], axis=0))


def example() -> ca.Function:
    e = ca.SX.sym("e", NX)
    c = (
        ca.sin(e[0]) * e[1] ** 2
        - 3 * e[2] ** 2
        + ca.exp(0.3 * e[1]) * e[0]
        + ca.cos(e[2] + e[0]) / (4 + ca.sin(e[1]))
    )
    return ca.Function("c", [e], [c])


@settings(deadline=None, max_examples=40)
@given(seed=seeds, width=widths)
def test_a_cell_holds_its_points(seed: int, width: float) -> None:
    rng = np.random.default_rng(seed)
    lower, upper = boxes(rng, width)
    cells, z = Cells(lower, upper), points_in(lower, upper, rng)
    assert np.all(np.abs(z - cells.z[..., None]) <= cells.reach[..., None] * (1 + 1e-9))
    from_middle = np.abs(z - cells.z_middle[..., None])
    assert np.all(from_middle <= cells.z_reach[..., None] * (1 + 1e-9))


@settings(deadline=None, max_examples=40)
@given(seed=seeds, width=widths)
def test_a_linear_function_stays_below_its_bound(seed: int, width: float) -> None:
    rng = np.random.default_rng(seed)
    lower, upper = boxes(rng, width)
    cells, z = Cells(lower, upper), points_in(lower, upper, rng)
    g = rng.normal(size=(NX, BOXES)) * 10.0 ** rng.uniform(-3, 3, BOXES)
    terms, _ = cells.linear(g)
    found = np.einsum("im,imk->mk", g, z - cells.z[..., None])
    assert np.all(found <= terms.sum(axis=0)[:, None] + 1e-12 * np.abs(g).sum())


@settings(deadline=None, max_examples=40)
@given(seed=seeds, width=widths)
def test_a_function_stays_below_its_bound(seed: int, width: float) -> None:
    rng = np.random.default_rng(seed)
    T = rng.normal(size=(NX, NX))
    c = example()
    lower, upper = boxes(rng, width)
    bound, spread = TaylorForm(c, T)(Cells(lower, upper))
    z = points_in(lower, upper, rng)
    e = np.einsum("ij,jmk->imk", T, z).reshape(NX, -1)
    found = np.array(c.map(e.shape[1])(e)).reshape(BOXES, POINTS)
    assert np.all(found <= bound[:, None] + 1e-12 * (1 + np.abs(bound[:, None])))
    assert spread.shape == lower.shape and np.all(spread >= 0)


def test_a_bound_comes_near_the_supremum_to_third_order() -> None:
    """Half the width, an eighth of the error; of a convex function, at a corner."""
    e = ca.SX.sym("e", 2)
    c = ca.Function("c", [e], [ca.exp(e[0]) + ca.exp(e[1])])
    form = TaylorForm(c, np.eye(2))
    w = np.array([[1.0], [0.5]])
    errors = []
    for half in (0.08, 0.04, 0.02):
        lower, upper = np.vstack([[[1.0]], w]), np.vstack([[[1.0 + 2 * half]], w])
        bound, _ = form(Cells(lower, upper))
        outer = upper[0, 0] * w[:, 0] / np.linalg.norm(w)
        errors.append(bound[0] - float(c(outer)))
    assert errors[-1] > 0
    assert errors[0] / errors[1] > 6 and errors[1] / errors[2] > 6


def test_where_nothing_is_known_the_widest_side_is_to_be_cut() -> None:
    e = ca.SX.sym("e", 2)
    c = ca.Function("c", [e], [1 / e[0] + e[1]])
    lower, upper = np.array([[0.5], [-0.4], [1.0]]), np.array([[0.6], [0.5], [1.0]])
    bound, spread = TaylorForm(c, np.eye(2))(Cells(lower, upper))
    assert not bound[0] < np.inf
    assert spread[:, 0].argmax() == 1
