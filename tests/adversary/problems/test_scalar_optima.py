"""Optima that are written down as numbers, by dynamic programming of one state."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import minimize

from swarmstart.arrays import Array
from swarmstart.tests.adversary.exact.rk4 import rk4
from swarmstart.tests.adversary.judge import Claim, judge, replay
from swarmstart.tests.adversary.problems import overflow
from swarmstart.tests.adversary.problems.path_constrained import POWERS


def cost_to_go(
    cost: Callable[[float, Array], Array], *, grid: Array, intervals: int
) -> Array:
    """Return the least cost from each point of a grid to zero, through the grid.

    Args:
        cost: Of a step from a point to each of the grid; inf if not allowed.
        grid: Points, zero the first.
        intervals: Number of steps.
    """
    table = np.array([cost(float(start), grid) for start in grid])
    value = np.where(grid == 0.0, 0.0, np.inf)
    for _ in range(intervals):
        value = (table + value).min(axis=1)
    return value


@pytest.mark.parametrize("power", POWERS)
def test_braking_agrees_with_dynamic_programming(power: float) -> None:
    """A grid allows less than there is: its cost is above, and comes down to it."""
    dt, grid = 2.0 / 16, np.linspace(0.0, 2.0, 1601)

    def cost(v: float, after: Array) -> Array:
        u = (after - v) / dt
        allowed = (u >= -6.0) & (u <= 1.0) & (-u * v <= power + 1e-9)
        return np.where(allowed, dt * u * u, np.inf)

    found = cost_to_go(cost, grid=grid, intervals=16)[-1]
    assert POWERS[power] - 1e-5 <= found <= 1.012 * POWERS[power]


def test_tank_agrees_with_a_local_solver_without_casadi() -> None:
    case = next(c for c in overflow.cases() if c.name.endswith("a tank"))
    truth = case.truth

    def ends(u: Array) -> Array:
        return rk4(truth, u[None, :], 2)

    with np.errstate(all="ignore"):
        found = minimize(
            lambda u: float(ends(u)[1]), np.full(20, 0.3), method="SLSQP",
            bounds=[(0.0, 1.0)] * 20, options={"maxiter": 60, "ftol": 1e-9},
            constraints={"type": "eq", "fun": lambda u: ends(u)[0] - 0.5},
        )  # fmt: skip
    assert found.fun == pytest.approx(0.455183, abs=2e-6)
    flown = replay(truth, found.x[None, :])
    assert flown is not None
    claim = Claim(controls=found.x[None, :], cost=flown.cost, is_confirmed=True)
    assert judge(truth, claim).is_right
