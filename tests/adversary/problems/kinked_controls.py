"""Controls with a price of |u|, with a dead zone, two gains, or a gear, and optima.

A control split into two of one sign, u = p - m with p, m >= 0, makes a convex program
of a price of |u|; a dead zone and a saturation are undone by the control before them;
the steps of a gear are integers, whose sum alone matters, and are counted.
"""

from dataclasses import replace

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.tests.adversary.case import Case, Formulas, known
from swarmstart.tests.adversary.drawing import symmetric_limits
from swarmstart.tests.adversary.exact.convex import UnsolvedError, solve_convex
from swarmstart.tests.adversary.exact.held_linear import Linear, program_of
from swarmstart.tests.adversary.judge import Truth
from swarmstart.tests.adversary.linear_case import (
    formulas_of,
    linear_case,
    substeps_of,
    truth_of,
)

KIND = "nonsmooth"


def priced(name: str, plain: Linear, up: float, down: float) -> Case:
    """Return a problem with the price up * max(u, 0) + down * max(-u, 0) besides.

    Args:
        name: Its name in the class.
        plain: The problem, one control between -limit and limit.
        up: At least -down, so that the price is convex.
        down: The other price.
    """
    split = replace(
        plain,
        B=np.hstack([plain.B, -plain.B]),
        R=plain.R[0, 0] * np.array([[1.0, -1.0], [-1.0, 1.0]]),
        r=np.array([up, down]),
        controls=(np.zeros(2), np.repeat(plain.controls[1], 2)),
    )
    optimum = solve_convex(program_of(split))
    parts = optimum.point.reshape((-1, 2))

    def formulas(x: ca.SX, u: ca.SX) -> Formulas:
        flat = formulas_of(plain, x, u)
        mean, tilt = (up + down) / 2, (up - down) / 2
        return flat._replace(stage_cost=flat.stage_cost + mean * ca.fabs(u) + tilt * u)

    own = truth_of(plain)
    truth = replace(
        own,
        stage_cost=lambda x, u: (
            own.stage_cost(x, u) + up * max(u[0], 0.0) + down * max(-u[0], 0.0)
        ),
        kinks=lambda x, u: u,
    )
    case = Case(
        name=f"{KIND}/{name}", kind=KIND, formulas=formulas, truth=truth,
        substeps=substeps_of(plain, 1), best=(parts[:, 0] - parts[:, 1])[None, :],
    )  # fmt: skip
    return known(case, optimum.cost)


def passed_on(name: str, plain: Linear, *, dead: float, full: float) -> Case:
    """Return a problem whose control passes a dead zone, then a saturation.

    v = u - clip(u, -dead, dead), cut to -full and full; costs are those of v.

    Args:
        name: Its name in the class.
        plain: The problem in v.
        dead: Half the width of the dead zone; 0: there is none.
        full: Where v saturates.
    """
    inner = replace(plain, controls=symmetric_limits(np.array([full])))
    done = linear_case(KIND, name, inner, absolute=1e-4)
    if done.best is None:
        raise UnsolvedError(name)
    own, widest = truth_of(plain), dead + 1.5 * full

    def passed(u: ca.SX) -> ca.SX:
        v = ca.fmax(u - dead, 0) + ca.fmin(u + dead, 0) if dead else u
        return ca.fmin(ca.fmax(v, -full), full)

    def through(u: Array) -> Array:
        beyond = np.maximum(np.abs(u) - dead, 0.0)
        return np.copysign(np.minimum(beyond, full), u)

    ends = np.array([dead + full, -dead - full])
    corners = np.append(ends, [dead, -dead]) if dead else ends
    truth = replace(
        done.truth,
        dynamics=lambda x, u: own.dynamics(x, through(u)),
        stage_cost=lambda x, u: own.stage_cost(x, through(u)),
        kinks=lambda x, u: u[0] - corners,
        controls=symmetric_limits(np.array([widest])),
    )
    return replace(
        done,
        formulas=lambda x, u: formulas_of(plain, x, passed(u)),
        truth=truth,
        best=done.best + dead * np.sign(done.best),
    )


def two_gains(name: str, plain: Linear, up: float, down: float) -> Case:
    """Return a problem whose control has a gain each way, costs of u^2 and |u| besides.

    Args:
        name: Its name in the class.
        plain: The problem, one control between -limit and limit, B = 1, R = 0.
        up: Gain of u > 0.
        down: Gain of u < 0.

    Raises:
        UnsolvedError: If the split controls are both in use at once.
    """
    split = replace(
        plain, B=np.array([[up, -down]]), R=0.2 * np.eye(2), r=np.array([0.1, 0.1]),
        controls=(np.zeros(2), np.repeat(plain.controls[1], 2)),
    )  # fmt: skip
    optimum = solve_convex(program_of(split))
    parts = optimum.point.reshape((-1, 2))
    if (parts.min(axis=1) > 1e-6).any():
        raise UnsolvedError("both controls at once")

    def gain(u: Array) -> Array:
        return up * np.maximum(u, 0.0) + down * np.minimum(u, 0.0)

    own = truth_of(plain)
    truth = replace(
        own,
        dynamics=lambda x, u: own.dynamics(x, gain(u)),
        stage_cost=lambda x, u: (
            own.stage_cost(x, u) + 0.2 * u[0] * u[0] + 0.1 * abs(u[0])
        ),
        kinks=lambda x, u: u,
    )

    def formulas(x: ca.SX, u: ca.SX) -> Formulas:
        flat = formulas_of(plain, x, ca.if_else(u > 0, up * u, down * u))
        return flat._replace(stage_cost=flat.stage_cost + 0.2 * u**2 + 0.1 * ca.fabs(u))

    case = Case(
        name=f"{KIND}/{name}", kind=KIND, formulas=formulas, truth=truth,
        substeps=substeps_of(plain, 1), best=(parts[:, 0] - parts[:, 1])[None, :],
    )  # fmt: skip
    return known(case, optimum.cost)


def gear(rng: np.random.Generator, name: str) -> Case:
    """Return x' = floor(u), cost of floor(u)^2 and of the final state."""
    N, x0, target = int(rng.integers(3, 8)), rng.normal(), rng.uniform(2.0, 5.0)
    weight = rng.uniform(0.5, 3.0)
    totals = np.arange(-3 * N, 3 * N + 1)
    low, more = totals // N, totals % N  # The cheapest way to a sum is an even one.
    spent = ((N - more) * low**2 + more * (low + 1) ** 2) / N
    costs = spent + weight * (x0 + totals / N - target) ** 2 + 0.5
    best = int(costs.argmin())
    steps = np.repeat([low[best] + 1, low[best]], [more[best], N - more[best]]) + 0.5
    truth = Truth(
        dynamics=lambda x, u: np.floor(u),
        stage_cost=lambda x, u: float(np.floor(u[0]) ** 2 + 0.5),
        terminal_cost=lambda x: float(weight * (x[0] - target) ** 2),
        kinks=lambda x, u: np.sin(np.pi * u),
        controls=symmetric_limits(np.full(1, 3.9)),
        x0=np.array([x0]),
        horizon=1.0,
        intervals=N,
        sizes=np.ones(1),
    )

    def formulas(x: ca.SX, u: ca.SX) -> Formulas:
        step = ca.floor(u)
        return Formulas(step, step**2 + 0.5, weight * (x - target) ** 2)

    case = Case(
        name=f"{KIND}/{name}", kind=KIND, formulas=formulas, truth=truth,
        best=steps[None, :],
    )  # fmt: skip
    return known(case, float(costs[best]))
