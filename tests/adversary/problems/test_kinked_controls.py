from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.tests.adversary.exact.held_linear import End, Linear
from swarmstart.tests.adversary.exact.rk4 import rk4
from swarmstart.tests.adversary.judge import replay
from swarmstart.tests.adversary.problems.kinked_controls import (
    gear,
    passed_on,
    priced,
    two_gains,
)


def lag() -> Linear:
    """Return x' = -x / 2 + u that is to follow 1."""
    return Linear(
        A=np.array([[-0.5]]), B=np.eye(1), Q=np.eye(1), q=np.array([-2.0]),
        R=np.eye(1) * 0.1, x0=np.array([-0.4]), horizon=2.0, intervals=3,
        controls=(np.full(1, -1.2), np.full(1, 1.2)),
    )  # fmt: skip


def test_least_fuel_is_bang_off_bang() -> None:
    """2 v, with the speed v on the way: d = v (T - v / a)."""
    d, a, T = 1.0, 1.5, 2.5
    rest = End(np.eye(2), np.zeros(2), np.zeros(2))
    plain = Linear(
        A=np.eye(2, k=1), B=np.array([[0.0], [1.0]]), x0=np.array([d, 0.0]), end=rest,
        horizon=T, intervals=50, controls=(np.full(1, -a), np.full(1, a)),
    )  # fmt: skip
    case = priced("least fuel", plain, 1.0, 1.0)
    assert case.best is not None
    spent = np.abs(case.best).sum() * T / 50
    speed = (a * T - np.sqrt(a * a * T * T - 4 * a * d)) / 2
    assert spent == pytest.approx(2 * speed, rel=1e-3)
    assert spent >= 2 * speed


@pytest.mark.parametrize("seed", [1, 6, 9, 11])
def test_gear_is_that_of_enumeration(seed: int) -> None:
    case = gear(np.random.default_rng(seed), "gear")
    truth, costs = case.truth, []
    assert truth.intervals <= 5
    dt = 1.0 / truth.intervals
    for steps in product(range(-4, 4), repeat=truth.intervals):
        end = truth.x0 + dt * sum(steps)
        spent = dt * sum(step * step + 0.5 for step in steps)
        costs.append(spent + truth.terminal_cost(end))
    assert truth.lowest <= min(costs) <= truth.highest
    assert truth.highest <= 1.0021 * min(costs) + 1e-4


@pytest.mark.parametrize("family", ["prices", "dead zone", "gains"])
def test_no_controls_on_a_grid_are_better(family: str) -> None:
    """The true, kinked problem, brute force over 3 controls."""
    free = replace(lag(), R=np.zeros((1, 1)))
    made = {
        "prices": lambda: priced("prices", lag(), 0.4, -0.1),
        "dead zone": lambda: passed_on("dead zone", lag(), dead=0.3, full=0.9),
        "gains": lambda: two_gains("gains", free, 1.5, 0.7),
    }
    truth = made[family]().truth

    def cost(u: Array) -> float:
        return float(rk4(truth, u[None, :], 6)[-1])

    lower, upper = (float(limit[0]) for limit in truth.controls)
    grid = np.linspace(lower, upper, 9)
    step = (upper - lower) / 8
    all_of_them = [np.array(controls) for controls in product(grid, repeat=3)]
    best = min(all_of_them, key=cost)
    for _ in range(12):  # Closer and closer around the best.
        step /= 2
        around = [best + step * np.array(d) for d in product((-1, 0, 1), repeat=3)]
        best = min((np.clip(u, lower, upper) for u in around), key=cost)
    flown = replay(truth, best[None, :])
    assert flown is not None
    assert truth.lowest <= flown.cost <= truth.highest
