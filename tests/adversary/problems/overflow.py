"""Problems whose trajectories overflow, escape or leave the domain of a function.

Most controls within the bounds lead there, the optimum does not; in some problems all
controls do, and there is no solution.
"""

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np

from swarmstart.tests.adversary.case import (
    Case,
    Formulas,
    equal,
    known,
    limits,
    unsolvable,
)
from swarmstart.tests.adversary.charts import CHARTS, charted_case
from swarmstart.tests.adversary.drawing import (
    away_from_zero,
    drawn_cases,
    symmetric_limits,
)
from swarmstart.tests.adversary.exact.convex import UnsolvedError, solve_convex
from swarmstart.tests.adversary.exact.held_linear import End, Linear, program_of
from swarmstart.tests.adversary.judge import Rate, Truth
from swarmstart.tests.adversary.linear_case import linear_case

KIND = "overflow"
GENERATED = 32
Form = tuple[Callable[[ca.SX, ca.SX], ca.SX], Rate]
"""A formula of x and u in CasADi, and the same in NumPy."""
WIDER = 4.0
"""The bounds, in the largest control of the optimum."""


def _drawn(rng: np.random.Generator, number: int) -> Case:
    name, chart = list(CHARTS.items())[number % len(CHARTS)]
    low, high = max(chart.lower, -1.5), min(chart.upper, 1.5)
    inside = 0.15 * (high - low)
    nx = int(rng.integers(1, 3))
    x0, target = rng.uniform(low + inside, high - inside, (2, nx))
    target = away_from_zero(target)
    A = rng.normal(size=(nx, nx)) * 0.5
    linear = Linear(
        A=A, B=np.eye(nx), c=-A @ target, x0=x0,
        Q=np.eye(nx), q=-2 * target, R=np.eye(nx) * rng.uniform(0.1, 0.5),
        horizon=float(rng.uniform(1.0, 2.5)), intervals=int(rng.integers(6, 12)),
        controls=symmetric_limits(np.full(nx, 1e3)),
        end=End(np.eye(nx), target, target) if number % 2 else None,
    )  # fmt: skip
    best = solve_convex(program_of(linear)).point
    room = symmetric_limits(np.full(nx, WIDER * np.abs(best).max()))
    bounded = replace(linear, controls=room)
    if np.abs(x0 - target).max() < inside:
        raise UnsolvedError("already there")
    return charted_case(KIND, f"{name} {number}", bounded, chart, margin=inside / 2)


def _tank() -> Case:
    """Return a tank that is emptied; below zero its outflow is no number."""
    case = Case(
        name=f"{KIND}/a tank",
        kind=KIND,
        formulas=lambda x, u: Formulas(u - 0.5 * ca.sqrt(x), u**2, terminal=x - 0.5),
        truth=Truth(
            dynamics=lambda x, u: u - 0.5 * np.sqrt(x),
            stage_cost=lambda x, u: float(u[0] * u[0]),
            terminal=equal(lambda x, _: x - 0.5, 0.0),
            controls=limits(0.0, 1.0),
            x0=np.ones(1),
            horizon=6.0,
            intervals=20,
            sizes=np.ones(1),
        ),
    )
    return known(case, 0.455183)


def _growth() -> list[Case]:
    """Return unstable systems whose states grow by so much if let alone."""
    made = []
    for rate in (1.5, 2.0, 2.5):
        linear = Linear(
            A=np.eye(1) * rate, B=np.eye(1), x0=np.ones(1), R=np.eye(1),
            horizon=4.0, intervals=16, controls=symmetric_limits(np.full(1, 10.0)),
            end=End(np.eye(1), np.zeros(1), np.zeros(1)),
        )  # fmt: skip
        name = f"growth by exp({4 * rate:g})"
        case = linear_case(KIND, name, linear, absolute=1e-4)
        # What RK4 leaves grows just as much until the end.
        made.append(replace(case, substeps=2 * case.substeps))
    return made


def _escapes() -> dict[str, Form]:
    """Return right-hand sides that no control keeps from escaping, in both forms.

    With |u| <= 0.5 and x(0) = 1, each solution ends before 4 s.
    """
    return {
        "x' = x^2 + 1 + u": (lambda x, u: x**2 + 1 + u, lambda x, u: x * x + 1 + u),
        "x' = x^3 + u": (lambda x, u: x**3 + u, lambda x, u: x * x * x + u),
        "x' = exp(x) + u": (lambda x, u: ca.exp(x) + u, lambda x, u: np.exp(x) + u),
        "x' = x^2 + u": (lambda x, u: x**2 + u, lambda x, u: np.square(x) + u),
        "x' = x log(x)^2 + 1 + u": (
            lambda x, u: x * ca.log(x) ** 2 + 1 + u,
            lambda x, u: x * np.square(np.log(x)) + 1 + u,
        ),
        # These reach zero; a coarse step jumps across and goes on with numbers.
        "x' = -1 / x + u": (lambda x, u: -1 / x + u, lambda x, u: -1 / x + u),
        "x' = -1 / x^3 + u": (lambda x, u: -1 / x**3 + u, lambda x, u: u - x**-3.0),
        "x' = u - sqrt(x) / x": (
            lambda x, u: u - ca.sqrt(x) / x,
            lambda x, u: u - 1 / np.sqrt(x),
        ),
    }


def _costs() -> dict[str, Form]:
    """Return stage costs that are infinite or no number on every way.

    With x' = u - 1, |u| <= 0.5 and x(0) = 1, each way passes zero before 4 s.
    """
    return {
        "the integral of 1 / x^2": (lambda x, _: 1 / x**2, lambda x, _: 1 / (x * x)),
        "the integral of log(x)": (lambda x, _: ca.log(x), lambda x, _: np.log(x)),
        "the integral of sqrt(x)": (lambda x, _: ca.sqrt(x), lambda x, _: np.sqrt(x)),
        "the integral of log(-1 - u^2)": (
            lambda _, u: ca.log(-1 - u**2),
            lambda _, u: np.log(-1 - u * u),
        ),
    }


def _scalar(name: str, forms: Form, costs: Form | None = None) -> Case:
    """Return a problem of one state and one control that has no solution."""
    (ode, dynamics), (stage, cost) = forms, costs or (lambda x, u: u**2,) * 2
    case = Case(
        name=f"{KIND}/{name}",
        kind=KIND,
        formulas=lambda x, u: Formulas(ode(x, u), stage(x, u)),
        truth=Truth(
            dynamics=dynamics,
            stage_cost=lambda x, u: float(cost(x, u)[0]),
            controls=limits(-0.5, 0.5),
            x0=np.ones(1),
            horizon=4.0,
            intervals=8,
            sizes=np.ones(1),
        ),
    )
    return unsolvable(case)


def cases() -> list[Case]:
    """Return all cases of the class, the same on every call."""
    rng = np.random.default_rng(4)
    made = list(drawn_cases(GENERATED, lambda number: _drawn(rng, number)))
    falling: Form = (lambda x, u: u - 1, lambda x, u: u - 1)
    escapes = [_scalar(name, forms) for name, forms in _escapes().items()]
    costs = [_scalar(name, falling, forms) for name, forms in _costs().items()]
    return [*made, _tank(), *_growth(), *escapes, *costs]
