"""Proof that e'Pe decreases on the whole ellipsoid of a level, or its refutation.

c(e) is the change of e'Pe at the deviation e (`decrease.py`).

Proof, by interval branch and bound: with z = T^-1 e, T'PT = I, the ellipsoid
e'Pe <= alpha is the ball |z| <= r, r^2 = alpha. With z = rho w / |w|, rho the radius
and w on a face of the cube [-1, 1]^n, 2n boxes of (rho, w) cover the ball exactly. On
every box it is shown that c(T z) < 0 (`enclosure.py`), or the box is cut in two.

The proof shows c < 0 for 0 < |z| <= r, a ball that holds the ellipsoid of the given
level, with c the expression itself and its floating-point constants taken as exact. For
a held input the proof is about the integrator's map, not the flow. It covers neither
the time between samples nor the bounds of inputs and states (`ellipsoid.py`).

Refutation: with P = LL' and e = rho L^-T u, |u| = 1, the ellipsoid e'Pe = rho^2 is a
sphere, and

    minimise  rho   subject to  c(rho L^-T u) / rho^2 >= 0,  |u| = 1

is the nearest counterexample. Starting points lie on rays in random directions, on each
ray at the first radius at which c >= 0. IPOPT starts at the nearest of these points. A
counterexample refutes its own level and all larger ones; it is checked by evaluating c
there. If none was found, nothing is proven. A nearer one may exist, since IPOPT is a
local solver.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from swarmstart.arguments import RNG, a_count, a_number, checked, of_kind
from swarmstart.arrays import Array
from swarmstart.machine_code import now
from swarmstart.terminal_set.certificates.certificate import Proof, Refutation
from swarmstart.terminal_set.linear.arrays import NotPositiveError
from swarmstart.terminal_set.proving.decrease import Change
from swarmstart.terminal_set.proving.enclosure import DecreaseBounds, Undecided

CHUNK = 8192
COVER = 1e-9
"""Least relative excess of the ball's radius over sqrt(alpha), for rounding of T."""

RAYS = 4000
RADII = 60
SMALLEST = 1e-3
"""First radius on a ray, relative to the largest."""
STARTS = 6
MOST_ROUNDS = 4
"""Largest number of repetitions; each looks up to 500 times nearer."""
INSIDE = 1e-9
"""Relative distance by which an answer of the NLP is moved outwards if c < 0 there."""

Boxes = tuple[Array, Array]
"""Lower and upper corners of boxes of (rho, w), each (1 + nx, m)."""
Start = tuple[float, Array]
"""A radius and a direction, shape (nx,), of length 1."""
CHANGE = of_kind(Change, "a Change")
WORK = a_number(least=0)


@checked(
    change=CHANGE,
    alpha=a_number(finite=False, nan=True),
    max_boxes=a_count(),
    work=WORK,
)
def prove_level(
    change: Change,
    alpha: float,
    *,
    max_boxes: int = 2_000_000,
    work: float = 60.0,
) -> Proof:
    """Try to prove that e'Pe decreases in a whole ellipsoid.

    Args:
        change: Change from `continuous_change` or `held_change`.
        alpha: Level of the ellipsoid, > 0.
        max_boxes: Largest number of boxes.
        work: Budget [s]; in a `working` block (`machine_code/clocks.py`), in units of
            work, each of about a second.

    Returns:
        The outcome. If it is not proven and has no counterexample, the level is open.

    Raises:
        NotPositiveError: If alpha is not positive and finite.
        UnknownIntervalOperationError: If c has an operation without interval form.
    """
    alpha = float(alpha)
    if not 0 < alpha < np.inf:
        raise NotPositiveError("alpha", alpha)
    began = clock.perf_counter()
    bounds = _bounds_of(change)
    radius = radius_of(alpha, bounds.defect)
    if not np.isfinite(radius):
        seconds = clock.perf_counter() - began
        return Proof(proven=False, alpha=alpha, boxes=0, seconds=seconds)

    def broken(left: Undecided) -> Array | None:
        return _counterexample(change.function, bounds.T, left)

    limits = Limits(max_boxes=max_boxes, until=now() + work)
    search = search_ball(bounds, len(change.P), radius, limits=limits, broken=broken)
    return Proof(
        proven=search.finished,
        alpha=alpha,
        boxes=search.boxes,
        seconds=clock.perf_counter() - began,
        counterexample=search.counterexample,
    )


@lru_cache(maxsize=1)
def _bounds_of(change: Change) -> DecreaseBounds:
    """Return the bounds of a change, cached for several levels."""
    return DecreaseBounds(change)


def radius_of(alpha: float, defect: float) -> float:
    """Return a radius r: all e = T z with e'Pe <= alpha have |z| <= r.

    Args:
        alpha: Level of the ellipsoid.
        defect: A bound d of |T'PT - I|: e'Pe >= (1 - d) |z|^2.

    Returns:
        At least sqrt(alpha / (1 - d)); infinite if T is too inaccurate.
    """
    if not defect < 0.5:  # noqa: PLR2004
        return float("inf")
    return float(np.sqrt(alpha)) * (1 + COVER + defect)


@dataclass(frozen=True, kw_only=True, slots=True)
class Limits:
    """Limits at which a search stops.

    Attributes:
        max_boxes: Largest number of boxes.
        until: Value of `now()` (machine_code/clocks.py) at which a search stops.
    """

    max_boxes: int
    until: float


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Search:
    """The outcome of a search of a ball.

    Attributes:
        finished: Whether every box was decided.
        boxes: Number of boxes examined.
        counterexample: A counterexample; None if none was met.
    """

    finished: bool
    boxes: int
    counterexample: Array | None = None


def search_ball(
    bounds: Callable[[Array, Array], Undecided],
    nx: int,
    radius: float,
    *,
    limits: Limits,
    broken: Callable[[Undecided], Array | None] = lambda left: None,
) -> Search:
    """Cut a ball into boxes until all are decided.

    Args:
        bounds: Function: lower and upper corners of boxes of (rho, w) -> the boxes that
            are not decided yet. The points of a box are z = rho w / |w|.
        nx: Dimension of the ball.
        radius: Radius of the ball.
        limits: Limits at which the search stops.
        broken: Function: undecided boxes -> a counterexample in one of them; None if it
            finds no counterexample.
    """
    stack, boxes = [_faces(nx, radius)], 0
    while stack:
        lower, upper = stack.pop()  # Depth first: few boxes wait at a time.
        if lower.shape[1] > CHUNK:
            stack.append((lower[:, CHUNK:], upper[:, CHUNK:]))
            lower, upper = lower[:, :CHUNK], upper[:, :CHUNK]
        boxes += lower.shape[1]
        left = bounds(lower, upper)
        if not left.lower.size:
            continue
        found = broken(left)
        # The sides of such a box are single numbers: it cannot be cut.
        is_cut_out = bool((left.spread.max(axis=0) <= 0).any())
        too_long = boxes > limits.max_boxes or not now() < limits.until
        if found is not None or is_cut_out or too_long:
            return Search(finished=False, boxes=boxes, counterexample=found)
        stack.append(_halves(left))
    return Search(finished=True, boxes=boxes)


def _faces(nx: int, radius: float) -> Boxes:
    """Return the boxes that cover the ball: rho in [0, r], w on a face of the cube."""
    lower, upper = np.full((1 + nx, 2 * nx), -1.0), np.full((1 + nx, 2 * nx), 1.0)
    lower[0], upper[0] = 0.0, radius
    for axis in range(nx):
        for side, end in enumerate((-1.0, 1.0)):
            lower[1 + axis, 2 * axis + side] = upper[1 + axis, 2 * axis + side] = end
    return lower, upper


def _halves(boxes: Undecided) -> Boxes:
    """Return the boxes cut in two along the coordinate of the largest spread."""
    axis, each = boxes.spread.argmax(axis=0), np.arange(boxes.lower.shape[1])
    middle = (boxes.lower[axis, each] + boxes.upper[axis, each]) / 2
    below, above = boxes.upper.copy(), boxes.lower.copy()
    below[axis, each], above[axis, each] = middle, middle
    return np.hstack([boxes.lower, above]), np.hstack([below, boxes.upper])


def _counterexample(c: ca.Function, T: Array, boxes: Undecided) -> Array | None:
    """Return the nearest box end at which c is not below 0, or not a number."""
    w = (boxes.lower[1:] + boxes.upper[1:]) / 2
    e = T @ (boxes.upper[0] * w / np.linalg.norm(w, axis=0))
    breaks = ~(np.array(c.map(e.shape[1])(e)).ravel() < 0)
    if not breaks.any():
        return None
    nearest = int(np.argmin(np.where(breaks, boxes.upper[0], np.inf)))
    return np.asarray(e[:, nearest])


@checked(change=CHANGE, alpha_max=a_number(finite=False, nan=True), rng=RNG)
def refuted_level(
    change: Change,
    *,
    alpha_max: float,
    rng: np.random.Generator,
) -> Refutation | None:
    """Look for the nearest deviation at which e'Pe does not decrease.

    Args:
        change: Change from `continuous_change` or `held_change`.
        alpha_max: Largest level of the search, > 0; if a counterexample is much nearer,
            the search is repeated up to about its level, with finer steps.
        rng: Source of the rays' directions.

    Returns:
        The counterexample; None if none was found, which proves nothing.

    Raises:
        NotPositiveError: If alpha_max is not positive and finite.
    """
    alpha_max = float(alpha_max)
    if not 0 < alpha_max < np.inf:
        raise NotPositiveError("alpha_max", alpha_max)
    c, P = change.function, change.P
    T = np.linalg.inv(np.linalg.cholesky(P)).T
    radius = float(np.sqrt(alpha_max))
    starts = _on_rays(c, T, radius, rng)
    # The grid of radii is coarse near the centre: repeat it up to the nearest found.
    for _ in range(MOST_ROUNDS):
        if not starts or starts[0][0] > radius / 10:
            break
        radius = 2 * starts[0][0]
        starts = _on_rays(c, T, radius, rng) or starts[:1]
    found = [_checked(c, P, T @ z) for z in _nearest(c, T, starts, radius)]
    found += [_checked(c, P, T @ (rho * u)) for rho, u in starts]
    points = [one for one in found if one is not None and one.alpha <= alpha_max]
    return min(points, key=lambda one: one.alpha, default=None)


def _on_rays(
    c: ca.Function, T: Array, radius: float, rng: np.random.Generator
) -> list[Start]:
    """Return the rays' first radii at which c >= 0, the nearest first."""
    u = rng.normal(size=(len(T), RAYS))
    u /= np.linalg.norm(u, axis=0)
    values = c.map(RAYS)
    first = np.full(RAYS, np.inf)
    for rho in np.geomspace(SMALLEST * radius, radius, RADII):
        broken = np.array(values(rho * (T @ u))).ravel() >= 0
        first = np.where(broken & np.isinf(first), rho, first)
    nearest = np.argsort(first)[:STARTS]
    return [(float(first[k]), u[:, k]) for k in nearest if np.isfinite(first[k])]


def _nearest(
    c: ca.Function, T: Array, starts: list[Start], radius: float
) -> list[Array]:
    """Return z = rho u of the NLP's answers from each start."""
    nx = len(T)
    rho, u = ca.SX.sym("rho"), ca.SX.sym("u", nx)
    condition = c(ca.DM(T) @ (rho * u)) / rho**2
    solver = ca.nlpsol(
        "nearest",
        "ipopt",
        {"x": ca.vertcat(rho, u), "f": rho, "g": ca.vertcat(condition, ca.sumsqr(u))},
        {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"},
    )
    answers = []
    for begin, direction in starts:
        answer = solver(
            x0=np.concatenate([[begin], direction]),
            # Away from the centre, where c / rho^2 is 0 / 0.
            lbx=np.concatenate([[1e-6 * radius], np.full(nx, -1.0)]),
            ubx=np.concatenate([[radius], np.full(nx, 1.0)]),
            lbg=[0.0, 1.0],
            ubg=[np.inf, 1.0],
        )
        w = np.array(answer["x"]).ravel()
        answers.append(np.asarray(w[0] * w[1:]))
    return answers


def _checked(c: ca.Function, P: Array, e: Array) -> Refutation | None:
    """Return a point as a counterexample, pushed outwards a little if needed."""
    if not np.isfinite(e).all():
        return None
    for push in (0.0, INSIDE, 1e3 * INSIDE):
        point = (1 + push) * e
        value = float(c(point))
        if value >= 0:
            return Refutation(alpha=float(point @ P @ point), e=point, change=value)
    return None
