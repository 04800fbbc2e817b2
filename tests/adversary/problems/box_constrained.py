"""Convex problems with active bounds on the controls: quadratic and linear programs.

Targets are met exactly, or within a range, or not asked for. The optimum is that of a
convex program on the exact discretisation.
"""

from dataclasses import replace

import numpy as np

from swarmstart.tests.adversary.case import Case
from swarmstart.tests.adversary.drawing import (
    away_from_zero,
    chain,
    drawn_cases,
    last,
    random_system,
    symmetric_limits,
)
from swarmstart.tests.adversary.exact.convex import solve_convex
from swarmstart.tests.adversary.exact.held_linear import End, Linear, program_of
from swarmstart.tests.adversary.linear_case import linear_case

KIND = "box_constrained"
GENERATED = 36


def _drawn(rng: np.random.Generator, number: int) -> Case:
    nx, nu = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    horizon = float(rng.uniform(1.0, 3.0))
    A, B = random_system(rng, nx=nx, nu=nu, horizon=horizon)
    root = rng.normal(size=(nx, nx))
    free = Linear(
        A=A,
        B=B,
        Q=root @ root.T / nx,
        R=np.diag(rng.uniform(0.05, 1.0, nu)),
        q=rng.normal(size=nx),
        P=np.eye(nx) * rng.uniform(0.0, 3.0),
        x0=rng.normal(size=nx) * 2,
        horizon=horizon,
        intervals=int(rng.integers(6, 16)),
        controls=symmetric_limits(np.full(nu, 1e3)),
    )
    if number % 3 == 1:
        middle = rng.normal(size=nx)
        free = replace(free, end=End(np.eye(nx), middle - 0.3, middle + 0.3))
    if number % 3 == 2:
        target = away_from_zero(rng.normal(size=1))
        free = replace(free, end=End(np.eye(nx)[:1], target, target))
    best = solve_convex(program_of(free)).point.reshape((-1, nu))
    low, high = np.sort(rng.uniform([[0.3], [0.5]], [[0.6], [0.9]], (2, nu)), axis=0)
    limit = np.abs(best).max(axis=0)
    bounded = replace(free, controls=(-low * limit, high * limit))
    return linear_case(KIND, f"drawn {number}", bounded, absolute=1e-4)


def _written() -> dict[str, Linear]:
    """Return problems written by hand."""
    one = symmetric_limits(np.ones(1))
    double = Linear(
        A=chain(2), B=last(2), R=np.eye(1), x0=np.array([1.0, 0.0]),
        horizon=2.2, intervals=11, controls=one,
        end=End(np.eye(2), np.zeros(2), np.zeros(2)),
    )  # fmt: skip
    scalar = Linear(
        A=-np.eye(1), B=np.eye(1), Q=np.eye(1), R=np.eye(1) * 0.01, x0=np.ones(1) * 3,
        horizon=3.0, intervals=12, controls=one,
    )  # fmt: skip
    pushed = (np.zeros(1), np.ones(1))
    return {
        "energy of a transfer, ten percent more time than least": double,
        "energy of a transfer, twice the least time": replace(double, horizon=4.0),
        "a regulator at its bound": scalar,
        "the control can only push": replace(scalar, controls=pushed, q=-np.ones(1)),
        "a bound that is zero": replace(scalar, controls=(-np.ones(1), np.zeros(1))),
        "a linear price and a demand": replace(
            scalar,
            Q=np.zeros((1, 1)),
            R=np.zeros((1, 1)),
            r=np.ones(1),
            controls=pushed,
            x0=np.zeros(1),
            end=End(np.eye(1), np.array([0.6]), np.array([np.inf])),
        ),
        "an unstable plant near the edge of what the control can hold": replace(
            scalar, A=np.eye(1), x0=np.array([0.9]), horizon=2.0
        ),
        "two controls of one state": replace(
            scalar, B=np.array([[1.0, -0.5]]), R=np.diag([0.1, 0.01]),
            r=np.empty(0), controls=symmetric_limits(np.array([0.5, 1.0])),
        ),
    }  # fmt: skip


def cases() -> list[Case]:
    """Return all cases of the class, the same on every call."""
    rng = np.random.default_rng(2)
    made = list(drawn_cases(GENERATED, lambda number: _drawn(rng, number)))
    return made + [linear_case(KIND, name, p) for name, p in _written().items()]
