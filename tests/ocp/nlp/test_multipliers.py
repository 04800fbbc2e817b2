"""Multipliers: costates of a Riccati recursion, and prices found by moving limits."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Free,
    Model,
    Multipliers,
    OptimalControlProblem,
    PathConstraint,
    Solution,
    SolutionStatus,
    TerminalConstraint,
    solve,
)

X0 = [0.0, 0.0]


def answered(
    problem: OptimalControlProblem, x0: list[float] | Array = X0
) -> tuple[Solution, Multipliers]:
    """Return a polished answer and its multipliers."""
    answer = solve(problem, x0, search=None, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    assert answer.multipliers is not None
    return answer, answer.multipliers


def slope(cost_of: Callable[[float], float], at: float, step: float) -> float:
    """Return the central difference of an optimal cost."""
    return (cost_of(at + step) - cost_of(at - step)) / (2 * step)


@pytest.mark.parametrize("units", [(1.0, 1.0, 1.0), (1e3, 1e-4, 1e5)])
@pytest.mark.parametrize("maximize", [False, True])
def test_costates_are_gradients_of_the_riccati_cost_to_go(
    units: tuple[float, float, float], maximize: bool
) -> None:
    """V = x' P_k x in metres, stated in other units of states, controls and costs."""
    of_x, of_u, of_cost = units
    z, v = ca.SX.sym("z", 2), ca.SX.sym("v")
    x, u = z / of_x, v / of_u
    sense = -1 if maximize else 1
    dt, N = 0.2, 10
    problem = OptimalControlProblem(
        Model(states=z, controls=v, ode=of_x * ca.vertcat(x[1], u)),
        horizon=dt * N,
        intervals=N,
        stage_cost=sense * of_cost * (ca.sumsqr(x) + u**2 / 2),
        terminal_cost=sense * of_cost * 3 * ca.sumsqr(x),
        maximize=maximize,
        quadrature="left",
        substeps=1,
    )
    answer, found = answered(problem, np.array([1.0, 0.5]) * of_x)
    A, B = np.array([[1, dt], [0, 1]]), np.array([[dt**2 / 2], [dt]])
    P = 3 * np.eye(2)
    for k in reversed(range(N)):
        expected = sense * of_cost * 2 * P @ answer.states[:, k + 1] / of_x**2
        np.testing.assert_allclose(found.costates[:, k], expected, rtol=1e-5, atol=0)
        K = np.linalg.solve(dt / 2 + B.T @ P @ B, B.T @ P @ A)
        P = dt * np.eye(2) + A.T @ P @ (A - B @ K)


LIMITS = {
    "top": 4.4,
    "push": 6.0,
    "speed": 1.3,
    "end": 0.98,
    "rest": 0.1,
    "least": -5.0,
}
"""Limits of `climb`, each of them active."""


def climb(
    moved: Mapping[str, float] | None = None,
    *,
    scaled: float = 1.0,
    maximize: bool = False,
) -> OptimalControlProblem:
    """A mass pushed from 0 to 1 in a second, with limits of push and speed.

    Args:
        moved: Limits that replace those of LIMITS, in the unit of length.
        scaled: Unit of length, in metres; the unit of the cost is not changed.
        maximize: Whether the cost is negated and maximised.
    """
    limit = {**{name: v / scaled for name, v in LIMITS.items()}, **(moved or {})}
    z, v = ca.SX.sym("z", 2), ca.SX.sym("v")
    x, u = z * scaled, v * scaled
    cost = u**2 + 10 * x[0]
    return OptimalControlProblem(
        Model(states=z, controls=v, ode=ca.vertcat(z[1], v)),
        horizon=1.0,
        intervals=10,
        checks=2,
        stage_cost=-cost if maximize else cost,
        maximize=maximize,
        bounds=Bounds(
            controls=(limit["least"], limit["push"]),
            states=([-np.inf, -np.inf], [np.inf, limit["speed"]]),
        ),
        constraints=[
            PathConstraint(
                expression=ca.vertcat(scaled * z[1] * v, z[0]),
                lower=[-np.inf, -9 / scaled],
                upper=[limit["top"], np.inf],
                name="reach",
            )
        ],
        terminal=[
            TerminalConstraint(expression=z[0], lower=limit["end"], upper=np.inf),
            (z[1], limit["rest"]),
        ],
    )


def prices(found: Multipliers) -> dict[str, float]:
    """Return the worth of each limit of `climb`, summed over the time."""
    at_end = list(found.terminal.values())
    return {
        "top": found.path["reach"][0].sum(),
        "push": found.controls.clip(min=0).sum(),
        "least": found.controls.clip(max=0).sum(),
        "speed": found.states[1].sum(),
        "end": at_end[0][0],
        "rest": at_end[1][0],
    }


@pytest.mark.parametrize("scaled", [1.0, 1e-3])
def test_optimal_cost_moves_by_the_multiplier_of_a_limit(scaled: float) -> None:
    _, found = answered(climb(scaled=scaled))
    told = prices(found)
    for name, limit in LIMITS.items():
        step = 1e-4 / scaled

        def cost(at: float, name: str = name) -> float:
            return answered(climb({name: at}, scaled=scaled))[0].cost

        moved = slope(cost, limit / scaled, step)
        assert told[name] == pytest.approx(-moved, rel=1e-3), name
        assert abs(moved) > 0.01 * scaled
    assert found.path["reach"][1] == pytest.approx(np.zeros(10), abs=1e-6 * scaled)


def test_multipliers_at_upper_limits_are_above_zero_and_below_for_gains() -> None:
    _, cost = answered(climb())
    _, gain = answered(climb(maximize=True))
    told = prices(cost)
    assert told["speed"] > 0.1 and told["top"] > 0.01 and told["end"] < -0.1
    assert cost.controls.max() > 1e-3 and cost.controls.min() < -1e-3
    for of in ("costates", "controls", "states"):
        np.testing.assert_allclose(
            getattr(gain, of), -getattr(cost, of), rtol=1e-5, atol=1e-5
        )
    assert prices(gain)["top"] == pytest.approx(-told["top"], rel=1e-5, abs=1e-5)
    assert prices(gain)["rest"] == pytest.approx(-told["rest"], rel=1e-5)


def grown(horizon: float | Free, rate: float | Free, start: float | Free) -> float:
    """Return the optimal cost of a growth with some decisions."""
    return solved_growth(horizon, rate, start)[0].cost


def solved_growth(
    horizon: float | Free, rate: float | Free, start: float | Free
) -> tuple[Solution, Multipliers]:
    """Return the answer; a Free with equal bounds becomes a number."""
    x, u, p = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("rate")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=p * x + u, parameters=p),
        horizon=_range(horizon),
        intervals=8,
        stage_cost=u**2 + 1 / 10,
        initial_cost=x**2,
        terminal=[(x, 4.0)],
        start={"x": _range(start)},
        decided={"rate": _range(rate)},
    )
    return answered(problem, [np.nan])


def _range(given: float | Free) -> Free:
    return given if isinstance(given, Free) else Free(given, given)


def test_bounds_of_what_is_decided_have_prices() -> None:
    """All three are at a bound: a larger value of each would be cheaper."""
    given = {"horizon": 1.0, "rate": 0.5, "start": 1.0}
    ranges = {"horizon": Free(0.5, 1.0), "rate": Free(0, 0.5), "start": Free(0, 1.0)}
    _, found = solved_growth(**ranges)
    names = {"horizon": "end time", "rate": "rate", "start": "x"}
    assert set(found.decided) == set(names.values())
    for name, value in given.items():

        def cost(at: float, name: str = name) -> float:
            return grown(**{**given, name: at})

        moved = slope(cost, value, 1e-4)
        assert found.decided[names[name]] == pytest.approx(-moved, rel=1e-4)
        assert moved < -1e-2


def test_rows_of_a_start_that_is_decided_have_a_price() -> None:
    """The mean of both starts is at most 1, which is not a bound."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")

    def problem(most: float) -> OptimalControlProblem:
        return OptimalControlProblem(
            Model(states=x, controls=u, ode=ca.vertcat(u, -x[1])),
            horizon=1.0,
            intervals=4,
            stage_cost=u**2,
            initial_cost=ca.sumsqr(x - 2),
            constraints=[ca.sum1(x) / 2 <= most],
            start={"x_0": Free(-5, 5), "x_1": Free(-5, 5)},
        )

    _, found = answered(problem(1.0), [np.nan, np.nan])
    moved = slope(lambda most: answered(problem(most), [np.nan] * 2)[0].cost, 1.0, 1e-4)
    (price,) = found.path.values()
    assert price.sum() == pytest.approx(-moved, rel=1e-4)
    assert price[0, 0] == pytest.approx(4.0, rel=1e-3)  # 2 (1 - m)^2: 4 (1 - m).


def test_no_multipliers_without_a_polish_that_converged(
    lq: OptimalControlProblem,
) -> None:
    bounded = replace(lq, bounds=Bounds(controls=(-5, 5)))
    assert solve(bounded, X0, polish=None, budget=200, seed=0).multipliers is None


def test_names_of_constraints_are_told_apart() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0,
        intervals=3,
        stage_cost=u**2,
        constraints=[
            PathConstraint(expression=x, upper=limit, name="top") for limit in (9, 8, 7)
        ],
        terminal=[(x, 1.0)],
    )
    _, found = answered(problem, [0.0])
    assert list(found.path) == ["top", "top (2)", "top (3)"]
    assert list(found.terminal) == ["x"]
    assert found.terminal["x"] == pytest.approx([-2.0], rel=1e-6)  # d (T v^2) / dT
    assert "  x: -2" in repr(found)


def test_answer_that_was_repaired_has_prices_of_the_stated_constraints(
    double_integrator: Model,
) -> None:
    """With more checks and a margin, the rows are still those of the interval."""
    x, u = double_integrator.states, double_integrator.controls
    problem = OptimalControlProblem(
        double_integrator,
        horizon=2.0,
        intervals=4,
        stage_cost=u**2,
        bounds=Bounds(states=([-np.inf, -np.inf], [0.3, np.inf])),
        terminal=[(x, [0.0, -1.0])],
    )
    answer = solve(problem, [0, 1], search=None, repair=True, seed=0)
    assert answer.status.is_confirmed and answer.multipliers is not None
    assert answer.multipliers.states.shape == (2, 4)
    assert answer.multipliers.states[0].sum() > 1
    assert answer.multipliers.states[1] == pytest.approx(np.zeros(4), abs=1e-6)
