"""Costs of one final output with kinks, jumps and stairs."""

from collections.abc import Callable

import casadi as ca
import numpy as np

from swarmstart.tests.adversary.reach_case import EndCost


def distance(rng: np.random.Generator) -> EndCost:
    """Draw w |y - t|: a closed form, the soft threshold."""
    t, w = rng.uniform(0.5, 1.5), rng.uniform(0.5, 3.0)
    return EndCost(
        symbolic=lambda y: w * ca.fabs(y - t) + 0.5,
        numeric=lambda y: w * np.abs(y[0] - t) + 0.5,
        breaks=(t,),
        kinks=lambda y: y - t,
    )


def hinge(rng: np.random.Generator) -> EndCost:
    """Draw w max(t - y, 0)."""
    t, w = rng.uniform(0.5, 1.5), rng.uniform(0.5, 3.0)
    return EndCost(
        symbolic=lambda y: w * ca.fmax(t - y, 0) + 0.5,
        numeric=lambda y: w * np.where(y[0] < t, t - y[0], 0.0) + 0.5,
        breaks=(t,),
        kinks=lambda y: y - t,
    )


def stairs(rng: np.random.Generator) -> EndCost:
    """Draw stairs that fall by w at every multiple of s, down to the ground."""
    s, w, top = rng.uniform(0.3, 0.7), rng.uniform(0.3, 1.0), 4
    edges = s * np.arange(1, top + 1)
    return EndCost(
        symbolic=lambda y: w * (top + 1 - ca.fmin(ca.fmax(ca.floor(y / s), 0), top)),
        numeric=lambda y: w * (top + 1 - np.clip(np.floor(y[0] / s), 0, top)),
        breaks=tuple(edges),
        kinks=lambda y: y - edges,
    )


def one_of_two(rng: np.random.Generator) -> EndCost:
    """Draw the lower of two parabolas."""
    a, b, extra = rng.uniform(0.5, 1.5), -rng.uniform(0.5, 1.5), rng.uniform(-0.5, 0.5)
    middle = ((a * a - b * b) * 3 - extra) / (6 * (a - b))
    return EndCost(
        symbolic=lambda y: 1 + ca.fmin(3 * (y - a) ** 2, 3 * (y - b) ** 2 + extra),
        numeric=lambda y: (
            1 + 3 * np.square(y[0] - np.where(y[0] > middle, a, b))
            + np.where(y[0] > middle, 0.0, extra)
        ),
        kinks=lambda y: y - middle,
    )  # fmt: skip


def window(rng: np.random.Generator) -> EndCost:
    """Draw a fine to be paid outside a window."""
    t, half, fine = rng.uniform(0.8, 1.5), rng.uniform(0.1, 0.3), rng.uniform(1.0, 3.0)
    return EndCost(
        symbolic=lambda y: ca.if_else(ca.fabs(y - t) <= half, 0.5, 0.5 + fine),
        numeric=lambda y: 0.5 + fine * ((y[0] < t - half) | (y[0] > t + half)),
        breaks=(t - half, t + half),
        kinks=lambda y: np.array([y[0] - t + half, y[0] - t - half]),
    )


def cusp(rng: np.random.Generator) -> EndCost:
    """Draw w sqrt|y - t|, whose slope is infinite at t."""
    t, w = rng.uniform(0.5, 1.0), rng.uniform(1.0, 2.0)
    return EndCost(
        symbolic=lambda y: 0.5 + w * ca.sqrt(ca.fabs(y - t)),
        numeric=lambda y: 0.5 + w * np.abs(y[0] - t) ** 0.5,
        breaks=(t,),
        kinks=lambda y: y - t,
    )


END_COSTS: dict[str, Callable[[np.random.Generator], EndCost]] = {
    "distance": distance,
    "hinge": hinge,
    "stairs": stairs,
    "one of two": one_of_two,
    "window": window,
    "cusp": cusp,
}
