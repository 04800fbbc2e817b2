from dataclasses import replace

import numpy as np
import pytest

from swarmstart.tests.adversary.exact.convex import solve_convex
from swarmstart.tests.adversary.exact.held_linear import (
    End,
    Linear,
    Path,
    program_of,
)
from swarmstart.tests.adversary.judge import replay
from swarmstart.tests.adversary.linear_case import truth_of


def full(rng: np.random.Generator, *, rate: float = 1.0) -> Linear:
    """Return a problem in which nothing is zero."""
    root, control = rng.normal(size=(3, 3)), rng.normal(size=(2, 2))
    return Linear(
        A=rate * rng.normal(size=(3, 3)) - 2 * rate * np.eye(3),
        B=rng.normal(size=(3, 2)),
        c=rng.normal(size=3),
        Q=root @ root.T,
        R=control @ control.T,
        q=rng.normal(size=3),
        r=rng.normal(size=2),
        P=np.eye(3),
        p=rng.normal(size=3),
        x0=rng.normal(size=3),
        horizon=1.5,
        intervals=4,
        controls=(-np.ones(2), np.ones(2)),
        path=Path(np.ones((1, 3)), np.ones((1, 2)), np.full(1, -9.0), np.full(1, 9.0)),
        end=End(np.eye(3)[:1], np.full(1, -9.0), np.full(1, 8.0)),
    )


@pytest.mark.parametrize("rate", [1.0, 50.0])
def test_cost_of_any_control_is_that_of_the_trajectory(rate: float) -> None:
    rng = np.random.default_rng(3)
    linear = full(rng, rate=rate)
    program = program_of(linear)
    for _ in range(3):
        U = rng.normal(size=8)
        flown = replay(truth_of(linear), U.reshape((2, 4), order="F"))
        assert flown is not None
        assert program.cost(U) == pytest.approx(flown.cost, rel=1e-7)


def test_rows_are_those_of_the_trajectory() -> None:
    """Path rows at both ends of each interval, and the terminal row."""
    rng = np.random.default_rng(4)
    linear = full(rng)
    program, U = program_of(linear), rng.normal(size=8)
    flown = replay(truth_of(linear), U.reshape((2, 4), order="F"))
    assert flown is not None
    path = flown.along(lambda x, u: np.array([x.sum() + u.sum()]))[:, 0, [0, -1]]
    end = flown.states[-1, 0, -1]
    slack = program.h - program.G @ U
    expected = [8.0 - end, end + 9.0]
    expected += [part for value in path.ravel() for part in (9.0 - value, value + 9.0)]
    np.testing.assert_allclose(np.sort(slack[16:]), np.sort(expected), atol=1e-7)


def test_energy_of_a_transfer_comes_to_its_closed_form() -> None:
    """12 d^2 / T^3 for a double integrator from rest to rest."""
    rest = End(np.eye(2), np.zeros(2), np.zeros(2))
    double = Linear(
        A=np.eye(2, k=1), B=np.array([[0.0], [1.0]]), R=np.eye(1), end=rest,
        x0=np.array([1.0, 0.0]), horizon=2.0, intervals=100,
        controls=(np.full(1, -99.0), np.full(1, 99.0)),
    )  # fmt: skip
    assert solve_convex(program_of(double)).cost == pytest.approx(1.5, rel=2e-4)


def test_scalar_regulator_comes_to_its_riccati_equation() -> None:
    """Integral of x^2 + u^2, x' = u, x(0) = 1: tanh(T)."""
    scalar = Linear(
        A=np.zeros((1, 1)), B=np.eye(1), Q=np.eye(1), R=np.eye(1), x0=np.ones(1),
        horizon=1.3, intervals=100, controls=(np.full(1, -9.0), np.full(1, 9.0)),
    )  # fmt: skip
    assert solve_convex(program_of(scalar)).cost == pytest.approx(
        np.tanh(1.3), rel=1e-4
    )


def test_singular_arc_has_its_closed_form() -> None:
    """Integral of x^2 from 1 at speed 1, then zero: 1 / 3."""
    level = Linear(
        A=np.zeros((1, 1)), B=np.eye(1), Q=np.eye(1), x0=np.ones(1),
        horizon=2.0, intervals=20, controls=(-np.ones(1), np.ones(1)),
    )  # fmt: skip
    assert solve_convex(program_of(level)).cost == pytest.approx(1 / 3, abs=1e-6)


def test_farthest_stop_has_its_closed_form() -> None:
    """Half the time forward, half the time back: T^2 / 4."""
    far = Linear(
        A=np.eye(2, k=1), B=np.array([[0.0], [1.0]]), p=np.array([-1.0, 0.0]),
        x0=np.zeros(2), horizon=3.0, intervals=10, controls=(-np.ones(1), np.ones(1)),
        end=End(np.eye(2)[1:], np.zeros(1), np.zeros(1)),
    )  # fmt: skip
    assert solve_convex(program_of(far)).cost == pytest.approx(-9 / 4, abs=1e-9)


def test_more_points_never_cost_less() -> None:
    linear = full(np.random.default_rng(5))
    best = solve_convex(program_of(replace(linear, path=None)))
    flown = replay(truth_of(linear), best.point.reshape((2, 4), order="F"))
    assert flown is not None
    level = flown.along(lambda x, u: np.array([x.sum() + u.sum()])).max() - 0.3
    path = Path(np.ones((1, 3)), np.ones((1, 2)), np.full(1, -9.0), np.array([level]))
    tight = replace(linear, path=path)
    costs = [solve_convex(program_of(tight, points=n)).cost for n in (2, 3, 5, 17)]
    assert (np.diff(costs) >= -1e-6).all()
    assert costs[0] > best.cost + 1e-6
