"""Path of a run between the plant's steps, and the distances of two such paths.

One step of the plant has the length h, the start state a and the end state b; the
control and the parameters are held. Each state is interpolated by the polynomial of
degree 5 that has, at both ends, the state x, the rate x' = f(x, u, p) and the second
derivative x'' = df/dx f (Hermite interpolation). Its Bernstein coefficients are

    a,  a + h/5 a',  a + 2h/5 a' + h^2/20 a'',
    b - 2h/5 b' + h^2/20 b'',  b - h/5 b',  b

The rates jump where the control jumps, so each piece has its own rates at its ends. The
error is at most h^6 / 46080 max |x^(6)|: below 1e-7 m in the scenarios that ship,
whereas a cubic, from the rates alone, is off by up to 4e-5 m.

The smallest and the largest distance of two points a(s), b(s), 0 <= s <= 1, that move
along such polynomials, with r = a - b, are found in two steps:

1.  Pieces that cannot contain the extreme are excluded. With d_0 and d_1 the values of
    |r| at the two ends, l the length of the chord of r, and e_a and e_b the largest
    distances of the two paths from their chords,

        (d_0 + d_1 - l) / 2 - e_a - e_b  <=  |r|  <=  max(d_0, d_1) + e_a + e_b

2.  On the other pieces |r|^2 is a polynomial of degree 10 in Bernstein form. It lies
    between its smallest and its largest coefficient; the first and the last one are its
    values at the ends. Pieces are halved (de Casteljau) until no bound exceeds the best
    value at an end by TOLERANCE: branch and bound, so no extreme between samples is
    missed.

Source: Hairer, Norsett and Wanner (1993), Solving Ordinary Differential Equations I,
section II.6; Farin (2002), Curves and Surfaces for CAGD, chapters 4, 5 and 7.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arguments import INDICES, a_number, checked, of_kind, reals
from swarmstart.arrays import Array
from swarmstart.errors import brief
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.loop.closed_loop import Trajectory
from swarmstart.ocp.loop.plant import Plant
from swarmstart.ocp.loop.simulated_plant import SimulatedPlant
from swarmstart.ocp.system.model import Model

DEGREE = 5
choices = np.vectorize(math.comb, otypes=[np.float64])
"""Binomial coefficients, written out: importing scipy.special takes 0.1 s."""
Indices = NDArray[np.intp]
TOLERANCE = 1e-8
"""Largest error of a distance, in the points' unit."""
BLOCK = 2**20
"""Number of pairs times pieces that are processed together."""
MOST_HALVINGS = 50
"""Largest number of halvings; then a piece is shorter than the rounding of its ends."""
_PAIRS = {"curves": reals(array=True, axes=4), "first": INDICES, "second": INDICES}
_EACH = np.arange(DEGREE + 1)
_SUMS = (_EACH[:, None] + _EACH).ravel()
_CHOICES = np.outer(choices(DEGREE, _EACH), choices(DEGREE, _EACH)).ravel()
_PRODUCT = (_CHOICES / choices(2 * DEGREE, _SUMS))[:, None] * (
    _SUMS[:, None] == np.arange(2 * DEGREE + 1)
)
"""Products of coefficients (i, j) -> coefficients of the product."""
_FRONT_HALF = choices(_EACH, _EACH[:, None]) / 2.0**_EACH
_BACK_HALF = _FRONT_HALF[::-1, ::-1]


@checked(refused, step=a_number(above=0), curves=reals(array=True, axes=3))
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DenseOutput:
    """Continuous path of a closed-loop run.

    Attributes:
        step: Length of a piece, which is one step of the plant [s].
        curves: Bernstein coefficients of each state on each piece, shape
            (nx, pieces, 6); the array is neither copied nor made read-only.
    """

    step: float
    curves: Array

    @checked(refused, times=reals(finite=True))
    def __call__(self, times: ArrayLike) -> Array:
        """Return the states at given times, shape (nx, n).

        Args:
            times: Times within the run, shape (n,) [s].
        """
        elapsed = np.atleast_1d(np.asarray(times, dtype=np.float64)) / self.step
        pieces = self.curves.shape[1]
        # A piece beyond either end still has the values of its neighbour, continued.
        if elapsed.ndim > 1 or not ((elapsed >= -1) & (elapsed <= pieces + 1)).all():
            raise refused("times", times, f"in [0, {pieces * self.step:g}], shape (n,)")
        piece = np.clip(elapsed.astype(int), 0, pieces - 1)
        s, k = (elapsed - piece)[:, None], np.arange(DEGREE + 1)
        weights = choices(DEGREE, k) * s**k * (1.0 - s) ** (DEGREE - k)
        return np.asarray(np.einsum("xnk,nk->xn", self.curves[:, piece], weights))


@checked(
    refused,
    plant=of_kind(Plant, "a Plant"),
    trajectory=of_kind(Trajectory, "a Trajectory"),
)
def interpolate(plant: Plant, trajectory: Trajectory) -> DenseOutput:
    """Return the continuous path of a closed-loop run.

    The path of an external simulator is linear between its steps.

    Of the trajectory only its times, the controls that the plant received, and the
    dense states are used, so a saved record is enough.

    Args:
        plant: The plant of the run.
        trajectory: The run, with the same number of plant steps in each interval.

    Returns:
        The path, a function of the time.

    Raises:
        InvalidProblemError: If the trajectory does not fit the plant, or its intervals
            do not all have the same number of steps.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        >>> falling = ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u))
        >>> run = ss.Trajectory(
        ...     times=np.array([0.0, 1.0]), dense_times=np.array([0.0, 1.0]),
        ...     states=np.array([[0.0, 1.0], [0.0, 2.0]]), controls=np.array([[2.0]]),
        ...     dense_states=np.array([[0.0, 1.0], [0.0, 2.0]]),
        ...     decisions=(), step_seconds=np.zeros(1),
        ... )
        >>> path = ss.interpolate(ss.Plant(falling, dt=1.0, substeps=1), run)
        >>> path(0.5).round(12)
        array([[0.25],
               [1.  ]])
    """
    substeps = _substeps(plant, trajectory)
    states, steps = trajectory.dense_states, trajectory.controls.shape[1]
    a, b, h = states[:, :-1], states[:, 1:], plant.dt / substeps
    if isinstance(plant, SimulatedPlant):  # Rates of the model are not its rates.
        parts = np.arange(DEGREE + 1) / DEGREE
        return DenseOutput(step=h, curves=a[..., None] + parts * (b - a)[..., None])
    held = np.repeat(trajectory.received, substeps, axis=1)
    # As the plant computes them: a parameter may jump at a step's beginning.
    begins = np.arange(steps)[:, None] * plant.dt + plant.dt * (
        np.arange(substeps) / substeps
    )
    known = plant.parameters(begins.ravel())
    each = [np.hstack([a, b]), np.tile(held, 2), np.tile(known, 2)]
    found = _derivatives(plant.model).map(2 * steps * substeps)(*each)
    (a1, b1), (a2, b2) = (np.split(np.array(d), 2, axis=1) for d in found)
    inner = (
        a + h / 5 * a1,
        a + 2 * h / 5 * a1 + h**2 / 20 * a2,
        b - 2 * h / 5 * b1 + h**2 / 20 * b2,
        b - h / 5 * b1,
    )
    return DenseOutput(step=h, curves=np.stack([a, *inner, b], axis=-1))


@checked(refused, **_PAIRS)
def smallest_distance(curves: Array, first: Indices, second: Indices) -> float:
    """Return the smallest distance, over all time, of all given pairs of points.

    Args:
        curves: Bernstein coefficients of the points' coordinates, shape
            (points, dimensions, pieces, 6).
        first: Index of one point of each pair, shape (pairs,).
        second: Index of the other point, shape (pairs,).

    Raises:
        InvalidProblemError: If there is no pair.

    Example:
        Two points on crossing lines, one a second before the other:

        >>> import numpy as np
        >>> from swarmstart.ocp import smallest_distance
        >>> s = np.linspace(0.0, 1.0, 6)
        >>> one, other = [4 * s - 2, 0 * s], [0 * s, 4 * s - 1]
        >>> curves = np.array([one, other])[:, :, None, :]
        >>> distance = smallest_distance(curves, np.array([0]), np.array([1]))
        >>> print(round(distance, 9), round(0.5**0.5, 9))
        0.707106781 0.707106781
    """
    return _extreme(curves, first, second, sign=1)


@checked(refused, **_PAIRS)
def largest_distance(curves: Array, first: Indices, second: Indices) -> float:
    """Return the largest distance of all given pairs; see `smallest_distance`.

    Example:
        >>> import numpy as np
        >>> from swarmstart.ocp import largest_distance
        >>> s = np.linspace(0.0, 1.0, 6)
        >>> curves = np.array([[3 * s, 4 * s], [0 * s, 0 * s]])[:, :, None, :]
        >>> print(largest_distance(curves, np.array([0]), np.array([1])))
        5.0
    """
    return _extreme(curves, first, second, sign=-1)


def _derivatives(model: Model) -> ca.Function:
    """Return (x, u, p) -> x', x'' with u and p held."""
    symbols = [model.states, model.controls, model.parameters]
    second = ca.jtimes(model.ode, model.states, model.ode)
    return ca.Function("derivatives", symbols, [model.ode, ca.densify(second)])


def _substeps(plant: Plant, trajectory: Trajectory) -> int:
    """Return the number of the plant's steps in an interval."""
    steps, pieces = trajectory.controls.shape[1], trajectory.dense_states.shape[1] - 1
    rows = (trajectory.dense_states.shape[0], trajectory.controls.shape[0])
    if rows != (plant.model.nx, plant.model.nu):
        raise InvalidProblemError(
            f"trajectory must have {plant.model.nx} states and {plant.model.nu} "
            f"controls like the plant, got {rows[0]} and {rows[1]}"
        )
    if not steps or not pieces or pieces % steps:
        raise InvalidProblemError(
            "dense_states must have the same number of steps in each of the "
            f"{steps} control intervals, got {pieces} steps"
        )
    return int(pieces // steps)


def _extreme(curves: Array, first: Indices, second: Indices, *, sign: int) -> float:
    """Return the distance with the smallest sign |r|."""
    first, second = np.asarray(first), np.asarray(second)
    if not first.size:
        raise InvalidProblemError("expected at least one pair of points, got none")
    if first.shape != second.shape or max(first.max(), second.max()) >= len(curves):
        raise InvalidProblemError(
            f"pairs must be as many numbers of the {len(curves)} points as others, got "
            f"{brief(first)} and {brief(second)}"
        )
    bends, best = _bends(curves), np.inf
    for i, j in _blocks(first, second, pieces=curves.shape[2]):
        ends, low = _bounds(curves, bends[i] + bends[j], i, j, sign=sign)
        best = min(best, float(ends.min()))
        pair, piece = np.nonzero(low < best - TOLERANCE)
        relative = curves[i[pair], :, piece] - curves[j[pair], :, piece]
        best = _least(relative, best, sign=sign)
    return abs(best)


def _blocks(
    first: Indices, second: Indices, *, pieces: int
) -> Iterator[tuple[Indices, Indices]]:
    """Yield the pairs in groups that fit into memory."""
    size = max(1, BLOCK // pieces)
    for begin in range(0, first.size, size):
        yield first[begin : begin + size], second[begin : begin + size]


def _bends(curves: Array) -> Array:
    """Return the largest distance of a point from its chord, shape (points, pieces)."""
    s = np.arange(DEGREE + 1) / DEGREE
    chords = curves[..., :1] * (1.0 - s) + curves[..., -1:] * s
    return np.asarray(np.linalg.norm(curves - chords, axis=1).max(axis=-1))


def _bounds(
    curves: Array, bends: Array, i: Indices, j: Indices, *, sign: int
) -> tuple[Array, Array]:
    """Return sign |r| at the nearer end, and a lower bound of it: (pairs, pieces)."""
    begins, ends = curves[..., 0], curves[..., -1]
    begin, end = begins[i] - begins[j], ends[i] - ends[j]
    d0, d1 = np.linalg.norm(begin, axis=1), np.linalg.norm(end, axis=1)
    if sign < 0:
        farther = np.maximum(d0, d1)
        return -farther, -farther - bends
    chord = np.linalg.norm(end - begin, axis=1)
    return np.minimum(d0, d1), (d0 + d1 - chord) / 2 - bends


def _squares(relative: Array) -> Array:
    """Return |r|^2 in Bernstein form, shape (n, 11), of r, shape (n, dimensions, 6)."""
    products = np.einsum("ndi,ndj->nij", relative, relative)
    return np.asarray(products.reshape(-1, (DEGREE + 1) ** 2) @ _PRODUCT)


def _least(relative: Array, best: float, *, sign: int) -> float:
    """Return the smallest sign |r|.

    Args:
        relative: Bernstein coefficients of r, shape (n, dimensions, 6).
        best: The smallest sign |r| known so far.
        sign: 1 or -1.
    """
    for _ in range(MOST_HALVINGS):
        if not relative.size:
            break
        squares = _squares(relative)
        ends = np.sqrt(np.maximum(squares[:, [0, -1]], 0.0))
        best = min(best, float((sign * ends).min()))
        # |a - b| <= TOLERANCE follows from |a^2 - b^2| <= TOLERANCE max(|a|, |b|).
        room = TOLERANCE * max(abs(best), TOLERANCE)
        low = (sign * squares).min(axis=1)
        # r is halved, not |r|^2, whose rounding would hide small distances.
        relative = relative[low < sign * best**2 - room]
        relative = np.concatenate([relative @ _FRONT_HALF, relative @ _BACK_HALF])
    return best
