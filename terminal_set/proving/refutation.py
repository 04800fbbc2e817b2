"""Refutation of a level: the smallest ellipsoid on which V no longer decreases.

With P = LL' and e = rho L^-T u, |u| = 1, the ellipsoid e'Pe = rho^2 is a sphere, and

    minimise  rho   subject to  c(rho L^-T u) / rho^2 >= 0,  |u| = 1

is the nearest counterexample (`decrease.py` has c). Starting points come from rays in
random directions: on each the first radius at which c >= 0. IPOPT starts at the nearest
of them.

A counterexample refutes its own level and all larger ones; it is checked by evaluating
c there. If none was found, nothing is proven. A nearer one may exist, since IPOPT is a
local solver.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.terminal_set.certificates.evidence import Refutation
from swarmstart.terminal_set.linear.arrays import NotPositiveError
from swarmstart.terminal_set.proving.decrease import Change

RAYS = 4000
RADII = 60
SMALLEST = 1e-3
"""First radius on a ray, relative to the largest."""
STARTS = 6
MOST_ROUNDS = 4
"""Largest number of repetitions; each looks up to 500 times nearer."""
INSIDE = 1e-9
"""Relative move outwards of the NLP's answer if c is below 0 there."""


def refuted_level(
    change: Change,
    *,
    alpha_max: float,
    rng: np.random.Generator,
) -> Refutation | None:
    """Look for the nearest deviation at which e'Pe does not decrease.

    Args:
        change: Change from `continuous_change` or `held_change`.
        alpha_max: Largest level of the search, > 0; if the nearest counterexample is
            much nearer, the search is repeated around it.
        rng: Source of the rays' directions.

    Returns:
        The counterexample; None if none was found, which proves nothing.

    Raises:
        NotPositiveError: If alpha_max is not positive and finite.
    """
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


Start = tuple[float, Array]
"""A radius and a direction, shape (nx,), of length 1."""


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
