"""Growth of e'Pe between samples, while an input is held.

With F_t the Runge-Kutta map to the time t, relative to the reference's own motion,

    V(F_t(e)) < g V(e)   for all t in [0, dt], 0 < V(e) <= alpha

is proven by the same search as a decrease (`proof.py`), for one interval of times after
another: t is an interval in all evaluations. An interval on which the proof fails is
halved.
"""

from __future__ import annotations

import time as clock
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.terminal_set.certificates.evidence import Proof
from swarmstart.terminal_set.interval_arithmetic.cells import PADDING, TimedCells
from swarmstart.terminal_set.interval_arithmetic.taylor import TaylorForm
from swarmstart.terminal_set.proving.enclosure import (
    Undecided,
    beside_diagonal,
    defect,
    quadratic_bound,
    undecided,
)
from swarmstart.terminal_set.proving.proof import Limits, radius_of, search_ball

PIECES = 16
"""Number of intervals of a hold at the beginning."""
BOXES_OF_A_PIECE = 4000
"""Number of boxes after which an interval is halved, unless it is the shortest."""
SHORTEST = 1 / 1024
"""Shortest interval, as a fraction of the hold."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Hold:
    """A motion with its input held.

    Attributes:
        motion: (e, t) -> the deviation after t; e for t = 0.
        P: Shape of the ellipsoids, (nx, nx), symmetric positive definite.
        dt: Duration [s].
        pieces: Number of intervals of time at the beginning.
    """

    motion: ca.Function
    P: Array
    dt: float
    pieces: int = PIECES


def prove_growth(
    hold: Hold,
    alpha: float,
    growth: float,
    *,
    max_seconds: float = 60.0,
) -> Proof:
    """Try to prove that e'Pe stays below g times itself during a hold.

    Args:
        hold: The motion.
        alpha: Level of the ellipsoid, > 0.
        growth: g, above 1.
        max_seconds: Time limit [s].

    Raises:
        UnknownIntervalOperationError: If the motion has an operation without interval
            form.
    """
    began = clock.perf_counter()
    P, nx, boxes = hold.P, len(hold.P), 0
    v = ca.SX.sym("v", nx + 1)
    e, t = v[:nx], v[nx]
    after = hold.motion(e, t)
    change = ca.bilin(ca.DM(P), after, after) - growth * ca.bilin(ca.DM(P), e, e)
    form = TaylorForm(ca.Function("growth", [v], [change]), np.eye(nx + 1))
    pieces = list(pairwise(np.linspace(0.0, hold.dt, hold.pieces + 1).tolist()))
    until = began + max_seconds
    centre = np.zeros((nx + 1, 1))
    at_end = centre.copy()
    at_end[-1] = hold.dt
    # Near the centre, only smooth motions can be bounded.
    proven = not np.any(form.kinks(centre, at_end))
    while pieces and proven:
        low, high = pieces.pop()
        shortest = high - low <= SHORTEST * hold.dt
        bounds = _GrowthBounds(form, P, (low, high))
        limits = Limits(
            max_boxes=100 * BOXES_OF_A_PIECE if shortest else BOXES_OF_A_PIECE,
            until=until,
        )
        radius = radius_of(alpha, bounds.defect)
        if not np.isfinite(radius):
            proven = False
            break
        search = search_ball(bounds, nx, radius, limits=limits)
        boxes += search.boxes
        if search.finished:
            continue
        proven = not shortest and clock.perf_counter() < until
        middle = (low + high) / 2
        pieces += [(low, middle), (middle, high)]
    seconds = clock.perf_counter() - began
    return Proof(proven=proven, alpha=alpha, boxes=boxes, seconds=seconds)


class _GrowthBounds:
    """Proofs that V(F_t) < g V on boxes of (rho, w), for an interval of times.

    Attributes:
        defect: A bound of |T'PT - I|.
    """

    def __init__(self, form: TaylorForm, P: Array, times: tuple[float, float]) -> None:
        """Rotate the coordinates so that the quadratic part is diagonal."""
        nx = len(P)
        root = np.linalg.inv(np.linalg.cholesky(P)).T
        first, last = (np.append(np.zeros(nx), time)[:, None] for time in times)
        middle, _ = form.hessians((first + last) / 2, (first + last) / 2)
        T = np.asarray(root @ np.linalg.eigh(root.T @ middle[0, :nx, :nx] @ root)[1])
        with_time = np.eye(nx + 1)
        with_time[:nx, :nx] = T
        self._form, self._times = form.turned(with_time), times
        middle, radius = self._form.hessians((first + last) / 2, (first + last) / 2)
        changed = self._form.hessian_slopes(first, last) * (times[1] - times[0]) / 2
        radius += changed * (1 + PADDING)
        self._M = beside_diagonal(middle[0, :nx, :nx], radius[0, :nx, :nx])
        self.defect = defect(T, P, np.eye(nx))

    def __call__(self, lower: Array, upper: Array) -> Undecided:
        """Return the undecided boxes; see `DecreaseBounds`."""
        quadratic = quadratic_bound(*self._M, lower[1:], upper[1:])
        from_zero = lower.copy()
        from_zero[0] = 0.0
        cells = TimedCells(from_zero, upper, self._times)
        d = np.abs(cells.z_middle) + cells.z_reach
        d[-1] = 0.0  # The series is in e, a separate one for each t.
        remainder = self._form.beyond_second_order(cells, d) / upper[0] ** 2

        def away_from_centre(lower: Array, upper: Array) -> tuple[Array, Array]:
            return self._form(TimedCells(lower, upper, self._times))

        return undecided(away_from_centre, lower, upper, quadratic, remainder)
