"""Outward rates of trajectories at the faces of a polytope {x : D x <= s(t)}.

x is the state; row k of D, d_k, is the outward direction of face k, and s_k(t) its
level, which is linear in time over a slab of time. The part of face k, d_k x = s_k(t),
that lies in the polytope is covered by cells: a grid in the face's own coordinates
z = G x. The rows of G are d_k and directions q_1, ..., q_(n-1) along the face; the grid
lies between bounds of q_j x on the face. A cell is dropped if for some row r of D

    d_r W z > s_r(t)   for all its z and all times of the slab,   W = G^-1 in floats.

The inequality is linear in t and z, so it is enough to check the ends of their ranges.
W is not an exact inverse: a point x of the cell differs from W z by at most
|(I - W G) x|, the cell's misfit.

The bounds of q'x over the polytope, for a direction q, follow from the duality of
linear programmes:

    max {q'x : D x <= s} = min {y's : D'y = q, y >= 0}

Each y >= 0 gives an upper bound of q'x, and the best vertex of the dual, a y with n
nonzero entries, gives the exact maximum. The vertices do not depend on s: they are
listed once, and a bound for new levels s is a product and a minimum. On the face
d_k'x = s_k the entry y_k may have any sign.

A listed y solves D'y = q in floats only. The residual r = q - D'y adds r'x to the
bound, and r'x is bounded by the size of x: nothing here depends on a tolerance.

Source: Boyd and Vandenberghe (2004), Convex Optimization, section 5.2.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.tubes.motion import PAD, Cells, Motion, rates_over

Index = NDArray[np.int64]

_NEGATIVE = -1e-12
"""Negative entries of y above this count as 0; the residual r accounts for it."""
_STEEPEST = 1e4
"""Largest entry of y that is kept: larger ones come from nearly parallel rows and give
no good bound."""

_IN_SPACE = 3
_APART = 32.0
"""Distance, in misfits, that tightened faces keep; see `_are_outside`."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DualVertices:
    """The vertices y of the dual programs of some directions q, with n entries each.

    The dual program of q is min {y's : D'y = q, y >= 0}; its value is the maximum of
    q'x over {x : D x <= s}. Over a face of this polytope, one entry may be negative.
    See the module's docstring.

    Attributes:
        rows: Rows of D that the entries belong to, shape (n, number).
        weights: The entries, shape (n, number).
        residual: Bound of |q - D'y|_1 and of the rounding of y's, relative to the
            largest of |x_i| and |s_k| (the levels), shape (number,).
        starts: Index of the first vertex of each direction q, shape (directions,).
    """

    rows: Index
    weights: Array
    residual: Array
    starts: Index

    def upper(self, levels: Array, reach: float) -> Array:
        """Return upper bounds of q'x over {x : D x <= s}, shape (directions,).

        Args:
            levels: s, shape (rows of D,); or several, shape (number, rows of D): the
                bound then holds for all of them, and for all between two of them.
            reach: Bound of |x_i| for all x in the polytopes and all i.
        """
        terms = self.weights * np.atleast_2d(levels)[:, self.rows]
        # y's is linear in s, so its maximum between two levels is at one of them.
        bounds = terms.sum(axis=1).max(axis=0)
        bounds += self.residual * max(reach, float(np.abs(levels).max()))
        return np.asarray(np.minimum.reduceat(bounds, self.starts))


def dual_vertices(rows: Array, directions: Array) -> DualVertices:
    """List the dual vertices of directions over the polytope itself.

    Args:
        rows: D, shape (R, n), rows that enclose a bounded polytope, the axes of both
            signs among them.
        directions: q, shape (number, n).
    """
    bases = np.array(list(combinations(range(len(rows)), rows.shape[1])))
    found = [_vertices_of(rows, bases, q, is_free=False) for q in directions]
    return _joined(found)


def dual_vertices_on_faces(rows: Array, directions: Array) -> DualVertices:
    """List the dual vertices of directions over faces of the polytope.

    Args:
        rows: D, as `dual_vertices` says.
        directions: Directions q for the face of each of the first rows, shape (faces,
            number, n), number >= 1.

    Returns:
        Dual vertices of directions[0, 0], directions[0, 1], ..., directions[1, 0], ...
    """
    others = rows.shape[1] - 1
    found = []
    for face, queries in enumerate(directions):
        rest = [row for row in range(len(rows)) if row != face]
        bases = np.array([(face, *chosen) for chosen in combinations(rest, others)])
        found += [_vertices_of(rows, bases, q, is_free=True) for q in queries]
    return _joined(found)


def _vertices_of(
    rows: Array, bases: Index, q: Array, *, is_free: bool
) -> tuple[Index, Array, Array]:
    """Return the bases with y >= 0, their y, and the bounds of the residuals."""
    matrices = np.swapaxes(rows[bases], 1, 2)
    is_regular = np.abs(np.linalg.det(matrices)) > 1.0 / _STEEPEST
    bases, matrices = bases[is_regular], matrices[is_regular]
    right = np.broadcast_to(q[:, None], (len(bases), len(q), 1))
    weights = np.linalg.solve(matrices, right)[:, :, 0]
    signed = weights[:, 1:] if is_free else weights
    is_dual = (signed >= _NEGATIVE).all(axis=1) & (
        np.abs(weights).max(axis=1) < _STEEPEST
    )
    bases, matrices, weights = bases[is_dual], matrices[is_dual], weights[is_dual]
    first = 1 if is_free else 0
    weights[:, first:] = np.maximum(weights[:, first:], 0.0)
    products = matrices * weights[:, None, :]
    left = np.abs(q - products.sum(axis=2)).sum(axis=1)
    size = np.abs(products).sum(axis=(1, 2)) + np.abs(q).sum()
    return bases, weights, left + PAD * (size + np.abs(weights).sum(axis=1))


def _joined(found: list[tuple[Index, Array, Array]]) -> DualVertices:
    counts = [len(bases) for bases, _, _ in found]
    return DualVertices(
        rows=np.concatenate([bases for bases, _, _ in found]).T.copy(),
        weights=np.concatenate([weights for _, weights, _ in found]).T.copy(),
        residual=np.concatenate([left for _, _, left in found]),
        starts=np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64),
    )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Template:
    """The directions of a polytope, and all quantities that follow from them alone.

    Attributes:
        directions: D, shape (K, n); the first 2n are the axes, e_1, -e_1, e_2, ...
        rows: D, then the axes with a bound of a state, shape (R, n).
        limits: Levels of the rows that bound a state, shape (R - K,).
        opposite: Index of the opposite of each direction, shape (K,).
        frames: Matrix W of each face, shape (K, n, n), with x = W z for the face's own
            coordinates z = G x.
        misfit: Bound of |x - W G x|, as computed, relative to the largest |x_i|.
        support: Dual vertices for the largest d_k x.
        extents: Dual vertices for the extent of each face along its directions q_1,
            q_2, ... and their opposites: q_1, -q_1, q_2, ...; None if n = 1.
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
        """Return levels of the directions, followed by those of the states' bounds."""
        return np.concatenate([levels, self.limits])

    def reach(self, levels: Array) -> float:
        """Return a bound of |x_i| in polytopes of these levels.

        Args:
            levels: Levels, shape (K,), or (number, K).
        """
        return float(np.abs(levels[..., : 2 * self.n]).max())

    def tightened(self, levels: Array) -> Array:
        """Return lower levels of the same polytope, at which all faces nearly touch it.

        A small distance is left, so that `_are_outside` finds a face beyond the bound
        of a state to be outside; a face on the bound itself would have to rise.
        """
        reach = self.reach(levels)
        bounds = self.support.upper(self.levels(levels), reach)
        return np.minimum(levels, bounds + _APART * self.misfit * reach)


def template_of(directions: Array, state_box: tuple[Array, Array]) -> Template:
    """Return the template of a polytope with given directions.

    Args:
        directions: D, shape (K, n), unit vectors; the first 2n are the axes.
        state_box: Lower and upper bounds of the states, each (n,); infinite if missing.
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
    """Return upper bounds of the outward rates at the faces of a moving polytope.

    The rate at face k is d_k f(t, x, u), with d_k its outward direction; the bound
    holds over the whole face, the slab of time, and all controls u.

    Args:
        motion: The right-hand side f.
        template: Template of the polytope.
        times: Beginning and end of the slab.
        levels: Levels at both times, shape (2, K); linear between them.
        cells: Number of parts of a face along each of its coordinates.

    Returns:
        Bounds, shape (K,) [1/s]; -infinity for a face that is not part of the polytope
        at any time of the slab, infinity if no bound of the rate is known.
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
    np.maximum.at(rates, face, bounds)  # `at`, since a face has many cells.
    return rates


def _grid(template: Template, ends: Array, reach: float, cells: int) -> Array:
    """Return the ends of all cells of all faces in z_j, j > 0.

    Returns:
        Lower and upper ends, shape (2, K, number, n - 1); an empty face has lower ends
        above the upper ones.
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
    """Return which cells certainly have no point of the polytope, (K, number)."""
    slopes = np.einsum("ri,kij->krj", template.rows, template.frames)
    faces = len(template.directions)
    # d_r W_0 s_k(t) - s_r(t) at both ends of the slab, (2, K, R).
    base = slopes[:, :, 0] * ends[:, :faces, None] - ends[:, None, :]
    least = np.repeat(base.min(axis=0)[:, None], grid.shape[2], axis=1)
    for j in range(template.n - 1):
        along = slopes[:, None, :, 1 + j]
        low, high = grid[:, :, :, j, None]
        least += np.minimum(along * low, along * high)
    # d_r e, and the rounding here: both scale with x, for which misfit has padding.
    sizes = np.abs(template.rows).sum(axis=1)
    pad = 2.0 * misfit * sizes + PAD * np.abs(ends).max(axis=0)
    is_empty = (grid[0] > grid[1]).any(axis=2)
    return np.asarray((least > pad).any(axis=2) | is_empty)
