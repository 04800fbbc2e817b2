"""Discontinuous and non-smooth problems with a known optimum.

Prices of |u| split into two controls of one sign are linear or quadratic programs; dead
zones and saturations are, in what passes them; costs of the final state with kinks and
stairs are a search over one number; steps of a gear are counted.
"""

from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.tests.adversary.case import Case, Formulas, known
from swarmstart.tests.adversary.exact.convex import UnsolvedError, solve_convex
from swarmstart.tests.adversary.exact.held_linear import End, Linear, program_of
from swarmstart.tests.adversary.judge import Rate, Truth, replay
from swarmstart.tests.adversary.linear_case import (
    formulas_of,
    linear_case,
    substeps_of,
    truth_of,
)
from swarmstart.tests.adversary.problems.drawing import (
    chain,
    drawn_cases,
    last,
    symmetric_limits,
)
from swarmstart.tests.adversary.problems.kinked_ends import END_COSTS
from swarmstart.tests.adversary.reach_case import reach_case

Array = NDArray[np.float64]
KIND = "nonsmooth"
GENERATED = 36
SEARCHED = 1e-2
"""Relative: how near an optimum is that only a search can find."""


def _transfer(rng: np.random.Generator) -> Linear:
    """Draw a double integrator from rest to rest, with more time than it needs."""
    distance, force = rng.uniform(0.5, 2.0, 2)
    least = 2 * np.sqrt(distance / force)
    return Linear(
        A=chain(2), B=last(2), x0=np.array([distance, 0.0]),
        horizon=float(least * rng.uniform(1.2, 2.0)), intervals=int(rng.integers(8, 16)),
        controls=symmetric_limits(np.array([force])),
        end=End(np.eye(2), np.zeros(2), np.zeros(2)),
    )  # fmt: skip


def _lag(rng: np.random.Generator) -> Linear:
    """Draw x' = -a x + u that is to follow a level."""
    level = rng.uniform(0.5, 1.5)
    return Linear(
        A=np.array([[-rng.uniform(0.2, 1.0)]]), B=np.eye(1), Q=np.eye(1),
        q=np.array([-2 * level]), x0=rng.uniform(-1.0, 0.3, 1),
        horizon=float(rng.uniform(1.5, 3.0)), intervals=int(rng.integers(6, 14)),
        controls=symmetric_limits(rng.uniform(1.0, 2.0, 1)),
    )  # fmt: skip


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


def _passed(name: str, plain: Linear, *, dead: float, full: float) -> Case:
    """Return a problem whose control passes a dead zone, then a saturation.

    v = u - clip(u, -dead, dead), cut to -full and full; costs are those of v.
    """
    inner = replace(plain, controls=symmetric_limits(np.array([full])))
    done = linear_case(KIND, name, inner, absolute=1e-4)
    if done.best is None:
        raise UnsolvedError(name)
    own, widest = truth_of(plain), dead + 1.5 * full

    def passed(u: ca.SX) -> ca.SX:
        v = ca.fmax(u - dead, 0) + ca.fmin(u + dead, 0)
        return ca.fmin(ca.fmax(v, -full), full)

    def through(u: Array) -> Array:
        beyond = np.maximum(np.abs(u) - dead, 0.0)
        return np.copysign(np.minimum(beyond, full), u)

    corners = np.array([dead, -dead, dead + full, -dead - full])
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


def _friction(rng: np.random.Generator, name: str) -> Case:
    """Return a body with dry friction that slows down, and never stops."""
    friction, drag = rng.uniform(0.2, 1.0, 2)
    v0, v1 = rng.uniform(1.0, 2.5, 2)
    moving = Linear(
        A=np.array([[0.0, 1.0], [0.0, -drag]]), B=last(2), c=np.array([0.0, -friction]),
        R=np.eye(1), x0=np.array([0.0, v0]), horizon=2.0, intervals=10,
        controls=symmetric_limits(np.full(1, 6.0)),
        end=End(np.eye(2), np.array([v0 + v1, v1]), np.array([v0 + v1, v1])),
    )  # fmt: skip
    done = linear_case(KIND, name, moving)
    flown = None if done.best is None else replay(done.truth, done.best)
    if flown is None or flown.states[:, 1].min() < 0.2:
        raise UnsolvedError("it stops")
    still = replace(moving, c=np.empty(0))

    def formulas(x: ca.SX, u: ca.SX) -> Formulas:
        flat = formulas_of(still, x, u)
        return flat._replace(ode=flat.ode - ca.vertcat(0, friction * ca.sign(x[1])))

    def dynamics(x: Array, u: Array) -> Array:
        slowed = u[0] - drag * x[1] - friction * np.sign(x[1])
        return np.array([x[1], slowed])

    truth = replace(done.truth, dynamics=dynamics, kinks=lambda x, u: x[1:])
    return replace(done, formulas=formulas, truth=truth)


def _two_gains(rng: np.random.Generator, name: str) -> Case:
    """Return x' = -a x + (u > 0 ? up u : down u), costs of the state and |u|."""
    up, down = rng.uniform(0.5, 2.0, 2)
    plain = _lag(rng)
    split = replace(
        plain, B=np.array([[up, -down]]), R=0.2 * np.eye(2), r=np.array([0.1, 0.1]),
        controls=(np.zeros(2), np.repeat(plain.controls[1], 2)),
    )  # fmt: skip
    optimum = solve_convex(program_of(split))
    parts = optimum.point.reshape((-1, 2))
    if (parts.min(axis=1) > 1e-6).any():
        raise UnsolvedError("both controls at once")
    gain = lambda u: up * np.maximum(u, 0) + down * np.minimum(u, 0)  # noqa: E731
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
        return flat._replace(
            stage_cost=flat.stage_cost + 0.2 * u**2 + 0.1 * ca.fabs(u)
        )

    case = Case(
        name=f"{KIND}/{name}", kind=KIND, formulas=formulas, truth=truth,
        substeps=substeps_of(plain, 1), best=(parts[:, 0] - parts[:, 1])[None, :],
    )  # fmt: skip
    return known(case, optimum.cost)


def _gear(rng: np.random.Generator, name: str) -> Case:
    """Return x' = floor(u), cost of floor(u)^2 and of the final state."""
    N, x0, target = int(rng.integers(3, 8)), rng.normal(), rng.uniform(2.0, 5.0)
    weight = rng.uniform(0.5, 3.0)
    totals = np.arange(-3 * N, 3 * N + 1)
    low, more = totals // N, totals % N  # The cheapest way to a sum is an even one.
    spent = ((N - more) * low**2 + more * (low + 1) ** 2) / N
    costs = spent + weight * (x0 + totals / N - target) ** 2 + 0.5
    best = int(costs.argmin())
    steps = np.repeat([low[best] + 1, low[best]], [more[best], N - more[best]]) + 0.5
    kinks: Rate = lambda x, u: np.sin(np.pi * u)  # noqa: E731 - as the fields are given
    truth = Truth(
        dynamics=lambda x, u: np.floor(u),
        stage_cost=lambda x, u: float(np.floor(u[0]) ** 2 + 0.5),
        terminal_cost=lambda x: float(weight * (x[0] - target) ** 2),
        kinks=kinks,
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


def _end(rng: np.random.Generator, name: str, number: int) -> Case:
    """Return an energy and a cost of the final state with kinks or jumps."""
    label, draw = list(END_COSTS.items())[number % len(END_COSTS)]
    nx = int(rng.integers(1, 3))
    linear = Linear(
        A=chain(nx), B=last(nx), x0=rng.uniform(-0.3, 0.3, nx), horizon=1.5,
        intervals=int(rng.integers(4, 9)), controls=symmetric_limits(np.ones(1)),
    )  # fmt: skip
    return reach_case(
        KIND, f"{label} {name}", linear, draw(rng), C=np.eye(nx)[:1],
        weight=float(rng.uniform(0.2, 0.6)), relative=SEARCHED,
    )  # fmt: skip


def _drawn(rng: np.random.Generator, number: int) -> Case:
    family, turn = number % 9, f"{number}"
    weight = np.eye(1) * rng.uniform(0.05, 0.3)
    match family:
        case 0:
            return priced(f"least fuel {turn}", _transfer(rng), 1.0, 1.0)
        case 1:
            plain = replace(_transfer(rng), R=weight)
            return priced(f"fuel and energy {turn}", plain, 1.0, 1.0)
        case 2:
            prices = rng.uniform(0.2, 0.5), -rng.uniform(0.0, 0.2)
            return priced(f"two prices {turn}", _lag(rng), *prices)
        case 3:
            plain = replace(_lag(rng), R=weight)
            return _passed(f"dead zone {turn}", plain, dead=0.4, full=1.5)
        case 4:
            plain = replace(_transfer(rng), R=weight)
            full = float(plain.controls[1][0])
            return _passed(f"saturation {turn}", plain, dead=0.0, full=full)
        case 5:
            return _friction(rng, f"dry friction {turn}")
        case 6:
            return _two_gains(rng, f"two gains {turn}")
        case 7:
            return _gear(rng, f"gear {turn}")
        case _:
            return _end(rng, turn, number // 9)


def cases() -> list[Case]:
    """Return all cases of the class, the same on every call."""
    rng = np.random.default_rng(7)
    made = list(drawn_cases(GENERATED, lambda number: _drawn(rng, number)))
    return made + [_end(rng, f"end {k}", k) for k in range(2 * len(END_COSTS))]
