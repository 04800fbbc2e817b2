"""How fast trajectories leave a polytope {x : D x <= s(t)} through its faces.

On face k, d_k x = s_k(t), whatever of it lies in the polytope is covered by cells: a
grid in the face's own coordinates z = G x, G = (d_k, q_1, ..., q_(n-1)), between bounds
of q_j x on the face (`support.py`). A cell is dropped if for some row r

    d_r W z > s_r(t)   for all its z and all times of the slab,   W = G^-1 in floats,

which is linear in t and z, so the ends decide. W is no exact inverse; a point x of the
cell is off W z by |(I - W G) x| at most, the cell's misfit.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.lower_bound.tubes.motion import Cells, Motion, rates_over
from swarmstart.ocp.lower_bound.tubes.support import (
    PAD,
    DualVertices,
    dual_vertices,
    dual_vertices_on_faces,
)

Array = NDArray[np.float64]


_IN_SPACE = 3
_APART = 32.0
"""How far faces that are drawn in keep apart, in misfits; see `_are_outside`'s pad."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Template:
    """The directions of a polytope, and what follows from them alone.

    Attributes:
        directions: D, shape (K, n); the first 2n are the axes, e_1, -e_1, e_2, ...
        rows: D, then the axes with a bound of a state, shape (R, n).
        limits: The levels of those last rows, shape (R - K,).
        opposite: Which direction is the opposite of each, shape (K,).
        frames: W of each face, shape (K, n, n).
        misfit: Bound of |x - W G x|, as computed, in parts of the largest |x_i|.
        support: For the largest d_k x.
        extents: For the ends of the faces, q_1, -q_1, q_2, ... of each; None if n = 1.
    """

    directions: Array
    rows: Array
    limits: Array
    opposite: NDArray[np.int64]
    frames: Array
    misfit: float
    support: DualVertices
    extents: DualVertices | None

    @property
    def n(self) -> int:
        """Number of states."""
        return int(self.directions.shape[1])

    def levels(self, levels: Array) -> Array:
        """Return levels of the directions with those of the bounds behind them."""
        return np.concatenate([levels, self.limits])

    def reach(self, levels: Array) -> float:
        """Return a bound of |x_i| in polytopes of these levels.

        Args:
            levels: Shape (K,), or (number, K).
        """
        return float(np.abs(levels[..., : 2 * self.n]).max())

    def tightened(self, levels: Array) -> Array:
        """Return levels of the same polytope whose faces nearly touch it.

        They keep apart so far that `_are_outside` sees it: a face on a bound of a
        state that is not surely beyond it would have to rise.
        """
        reach = self.reach(levels)
        bounds = self.support.upper(self.levels(levels), reach)
        return np.minimum(levels, bounds + _APART * self.misfit * reach)


def template_of(directions: Array, state_box: tuple[Array, Array]) -> Template:
    """Return what follows from the directions of a polytope.

    Args:
        directions: D, shape (K, n), unit vectors; the first 2n are the axes.
        state_box: Lower and upper bounds of the states, each (n,); infinite if there
            is none.
    """
    n = directions.shape[1]
    # In the order of the axes: x_1 <= upper_1, -x_1 <= -lower_1, x_2 <= ...
    limits = np.column_stack([state_box[1], -state_box[0]]).ravel()
    is_bound = np.isfinite(limits)
    rows = np.vstack([directions, directions[: 2 * n][is_bound]])
    bases = np.array([_basis(direction) for direction in directions])
    frames = np.linalg.inv(bases)
    # The second part is for the roundings of x = W z in floats, |z_j| <= n max |x_i|.
    misfit = np.abs(np.eye(n) - frames @ bases).sum(axis=2).max() + 2 * n * n * PAD
    tangents = bases[:, 1:]
    both = np.stack([tangents, -tangents], axis=2).reshape(len(directions), -1, n)
    return Template(
        directions=directions,
        rows=rows,
        limits=limits[is_bound],
        opposite=np.argmin(directions @ directions.T, axis=1),
        frames=frames,
        misfit=float(misfit),
        support=dual_vertices(rows, directions),
        extents=dual_vertices_on_faces(rows, both) if n > 1 else None,
    )


def _basis(direction: Array) -> Array:
    """Return G: a direction and an orthonormal basis of the plane normal to it."""
    n = direction.size
    if n == 1:
        return direction[None, :]
    if n < _IN_SPACE:
        return np.array([direction, [-direction[1], direction[0]]])
    least = np.eye(n)[np.argmin(np.abs(direction))]
    first = np.cross(direction, least)
    first /= np.linalg.norm(first)
    return np.array([direction, first, np.cross(direction, first)])


def rates_at_faces(
    motion: Motion,
    template: Template,
    *,
    times: tuple[float, float],
    levels: Array,
    cells: int,
) -> Array:
    """Return upper bounds of d_k f over each face of a moving polytope and all u.

    Args:
        motion: f.
        template: Of the polytope.
        times: Begin and end of the slab.
        levels: At both, shape (2, K); linear between.
        cells: Into how many parts a face is cut, along each of its coordinates.

    Returns:
        Shape (K,) [1/s]; -infinity for a face that is not part of the polytope at any
        time of the slab, infinity if nothing bounds the rate.
    """
    ends = np.array([template.levels(level) for level in levels])
    reach = template.reach(levels)
    grid = _grid(template, ends, reach, cells)
    misfit = template.misfit * reach
    face, cell = np.nonzero(~_are_outside(template, ends, grid, misfit))
    rates = np.full(len(template.directions), -np.inf)
    if face.size == 0:
        return rates
    bounds = rates_over(
        motion,
        Cells(
            times=times,
            directions=template.directions[face],
            frames=template.frames[face],
            levels=levels[:, face],
            lower=grid[0][face, cell],
            upper=grid[1][face, cell],
            misfit=misfit,
        ),
    )
    np.maximum.at(rates, face, bounds)
    return rates


def _grid(template: Template, ends: Array, reach: float, cells: int) -> Array:
    """Return the ends of all cells of all faces in z_j, j > 0.

    Returns:
        Lower and upper, shape (2, K, number, n - 1); those of a face that is empty have
        lower ends above the upper ones.
    """
    faces, others = len(template.directions), template.n - 1
    if template.extents is None:
        return np.zeros((2, faces, 1, 0))
    bounds = template.extents.upper(ends, reach).reshape(faces, others, 2)
    # |q_j x| is below n times the largest |x_i|; bounds of an empty face can be huge.
    bounds = np.minimum(bounds, template.n * reach)
    low, high = -bounds[:, :, 1], bounds[:, :, 0]
    parts = np.arange(cells + 1) / cells
    cuts = low[:, :, None] + (high - low)[:, :, None] * parts
    cuts[:, :, 0], cuts[:, :, -1] = low, high  # Exact: the cells cover the face.
    chosen = np.array(list(product(range(cells), repeat=others)))
    axis = np.arange(others)
    lower, upper = cuts[:, axis, chosen], cuts[:, axis, chosen + 1]
    return np.stack([lower, upper])


def _are_outside(
    template: Template, ends: Array, grid: Array, misfit: float
) -> NDArray[np.bool_]:
    """Return which cells surely have no point of the polytope, shape (K, number)."""
    slopes = np.einsum("ri,kij->krj", template.rows, template.frames)
    faces = len(template.directions)
    # d_r W_0 s_k(t) - s_r(t) at both ends of the slab, (2, K, R).
    base = slopes[:, :, 0] * ends[:, :faces, None] - ends[:, None, :]
    least = np.repeat(base.min(axis=0)[:, None], grid.shape[2], axis=1)
    for j in range(template.n - 1):
        along = slopes[:, None, :, 1 + j]
        low, high = grid[:, :, :, j, None]
        least += np.minimum(along * low, along * high)
    # d_r e, and the roundings here: both of the size of x, which misfit is padded for.
    sizes = np.abs(template.rows).sum(axis=1)
    pad = 2.0 * misfit * sizes + PAD * np.abs(ends).max(axis=0)
    is_empty = (grid[0] > grid[1]).any(axis=2)
    return np.asarray((least > pad).any(axis=2) | is_empty)
