"""Linear-quadratic problems: no bound is active, the optimum is one linear solve.

Stable and unstable systems, with and without a target to be met exactly, oscillators,
chains of integrators, costs with a linear part.
"""

from dataclasses import replace

import numpy as np

from swarmstart.tests.adversary.case import Case
from swarmstart.tests.adversary.drawing import (
    away_from_zero,
    chain,
    last,
    random_system,
    symmetric_limits,
)
from swarmstart.tests.adversary.exact.convex import solve_convex
from swarmstart.tests.adversary.exact.held_linear import End, Linear, program_of
from swarmstart.tests.adversary.linear_case import linear_case

KIND = "linear_quadratic"
GENERATED = 40
FREE = 1e3
WIDER = 2.0
"""Ratio of the bounds and the range that the optimum uses."""


def with_inactive_bounds(linear: Linear) -> Linear:
    """Return the problem with bounds that its optimum does not come near."""
    wide = replace(linear, controls=symmetric_limits(np.full(linear.B.shape[1], FREE)))
    best = solve_convex(program_of(wide)).point.reshape((-1, linear.B.shape[1]))
    limit = WIDER * np.maximum(np.abs(best).max(axis=0), 0.1)
    return replace(linear, controls=symmetric_limits(limit))


def _drawn(rng: np.random.Generator) -> Linear:
    nx, nu = int(rng.integers(1, 5)), int(rng.integers(1, 3))
    horizon = float(rng.uniform(1.0, 4.0))
    A, B = random_system(rng, nx=nx, nu=nu, horizon=horizon)
    root = rng.normal(size=(nx, nx))
    has_target = bool(rng.random() < 0.4) and nx <= 2 * nu
    linear = Linear(
        A=A,
        B=B,
        Q=root @ root.T / nx,
        R=np.diag(rng.uniform(0.1, 2.0, nu)),
        q=rng.normal(size=nx) * (rng.random() < 0.5),
        P=np.eye(nx) * rng.uniform(0.0, 5.0),
        x0=rng.normal(size=nx) * 2,
        horizon=horizon,
        intervals=int(rng.integers(6, 15)),
        controls=symmetric_limits(np.full(nu, FREE)),
    )
    if has_target:
        target = away_from_zero(rng.normal(size=nx))
        linear = replace(linear, end=End(np.eye(nx), target, target))
    return with_inactive_bounds(linear)


def _transfer(nx: int) -> Linear:
    """Return the least energy of a chain of integrators from 1 to rest at 0."""
    return Linear(
        A=chain(nx),
        B=last(nx),
        R=np.eye(1),
        end=End(np.eye(nx), np.zeros(nx), np.zeros(nx)),
        x0=np.eye(nx)[0],
        horizon=2.0,
        intervals=10,
        controls=symmetric_limits(np.ones(1)),
    )


def _written() -> dict[str, Linear]:
    """Return problems written by hand."""
    oscillator = np.array([[0.0, 1.0], [-4.0, 0.0]])
    double = _transfer(2)
    scalar = Linear(
        A=np.zeros((1, 1)), B=np.eye(1), Q=np.eye(1), R=np.eye(1),
        x0=np.ones(1), horizon=1.0, intervals=10, controls=symmetric_limits(np.ones(1)),
    )  # fmt: skip
    problems = {
        "energy of a transfer from 1 to rest": double,
        "a target that is nearly zero": replace(
            double, end=End(np.eye(2), np.full(2, 1e-3), np.full(2, 1e-3))
        ),
        "a transfer over a long time": replace(double, horizon=20.0, intervals=20),
        "a scalar regulator": scalar,
        "a scalar regulator, cheap control": replace(scalar, R=np.eye(1) * 1e-3),
        "an unstable scalar": replace(scalar, A=np.eye(1) * 2.0, horizon=2.0),
        "an oscillator brought to rest": replace(double, A=oscillator, Q=np.eye(2)),
        "a chain of three integrators": _transfer(3),
        "already at the target": replace(double, x0=np.zeros(2), Q=np.eye(2)),
        "a state that no control moves": replace(
            double, A=np.diag([-1.0, 0.5]), end=None, Q=np.eye(2)
        ),
        "one interval": replace(scalar, intervals=1),
    }
    return {name: with_inactive_bounds(linear) for name, linear in problems.items()}


def cases() -> list[Case]:
    """Return all cases of the class, the same on every call."""
    rng = np.random.default_rng(1)
    made = [
        linear_case(KIND, f"drawn {number}", _drawn(rng)) for number in range(GENERATED)
    ]
    return made + [linear_case(KIND, name, p) for name, p in _written().items()]
