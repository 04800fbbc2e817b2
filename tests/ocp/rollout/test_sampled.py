"""The value of a path at the nodes is that of the roll-out it comes from."""

from typing import Any

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.ocp.rollout import SampledValue
from swarmstart.ocp.rollout.fitness import replay


def problem(**more: Any) -> ss.OptimalControlProblem:
    x, u, s = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("s")
    fields: dict[str, Any] = {
        "stage_cost": (x[0] - s) ** 2 + u**2,
        "step_cost": 0.1 * u**2,
        "initial_cost": 3 * x[1],
        "terminal_cost": 5 * x[0] ** 2,
        "constraints": [ss.PathConstraint(expression=x[0], upper=0.5)],
        "terminal": [ss.TerminalConstraint(expression=x[1], lower=0.0, upper=0.1)],
        "bounds": ss.Bounds(controls=(-1, 1)),
    }
    return ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u)), horizon=2.0,
        intervals=4, checks=4, substeps=1, signals=s, **fields | more,
    )  # fmt: skip


def known(one: ss.OptimalControlProblem) -> ss.Known:
    return ss.Known(signals=np.linspace(0, 1, one.nodes)[None, :])


@pytest.mark.parametrize("maximize", [False, True])
def test_value_is_that_of_the_rollout(maximize: bool) -> None:
    """The stage cost is of degree 4 within a check: Simpson's error is 1e-4."""
    one = problem(maximize=maximize)
    fitness = ss.Fitness(one, backend="casadi")
    rng, x0 = np.random.default_rng(0), np.array([0.3, -0.2])
    value = SampledValue(one)
    for _ in range(5):
        controls = rng.uniform(-1, 1, (1, 4))
        states, *_ = replay(one, controls, x0, known(one))
        cost, violation = fitness.objective(x0, known(one))(controls.T)
        found = value(states, controls, x0, known(one))
        assert found.cost == pytest.approx(cost[0], rel=2e-4)
        assert found.violation == pytest.approx(violation[0], rel=1e-9, abs=1e-12)
    assert violation[0] > 0


def test_odd_numbers_of_checks_use_the_trapezoidal_rule() -> None:
    """Of a stage cost that is linear in time both rules are exact."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    for checks in (1, 2, 3):
        one = ss.OptimalControlProblem(
            ss.Model(states=x, controls=u, ode=u), horizon=2.0, intervals=2,
            checks=checks, stage_cost=x, bounds=ss.Bounds(controls=(-1, 1)),
        )  # fmt: skip
        controls = np.array([[1.0, -0.5]])
        states, *_ = replay(one, controls, np.zeros(1), ss.Known())
        found = SampledValue(one)(states, controls, np.zeros(1), ss.Known())
        assert found == pytest.approx((0.5 + 0.75, 0.0), abs=1e-12)


def test_a_state_that_is_no_number_has_an_infinite_violation() -> None:
    one = problem()
    states = np.full((2, one.nodes), np.nan)
    found = SampledValue(one)(states, np.zeros((1, 4)), np.zeros(2), known(one))
    assert not found.violation < np.inf


def test_controls_outside_of_their_bounds_are_a_violation() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    one = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=1, checks=1,
        stage_cost=x, bounds=ss.Bounds(controls=(-1, 1)),
    )  # fmt: skip
    found = SampledValue(one)(np.zeros((1, 2)), np.array([[3.0]]), [0.0], ss.Known())
    assert found.violation == pytest.approx(1.0)


@pytest.mark.parametrize("what", ["end", "knots"])
def test_decisions_besides_held_controls_are_refused(what: str) -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    fields: dict[str, Any] = {"horizon": 1.0}
    if what == "end":
        fields["horizon"] = ss.Free(0.5, 2.0)
    else:
        fields["control_shape"] = "linear"
    one = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u), intervals=2, stage_cost=x**2 + u**2,
        bounds=ss.Bounds(controls=(-1, 1)), **fields,
    )  # fmt: skip
    with pytest.raises(ss.InvalidProblemError, match="held controls as decisions"):
        SampledValue(one)


@pytest.mark.parametrize("cost", [np.inf, np.nan])
def test_a_cost_that_is_no_number_is_no_kept_constraint(cost: float) -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    one = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=1,
        stage_cost=u**2, terminal_cost=1e300 * x, bounds=ss.Bounds(controls=(-1, 1)),
    )  # fmt: skip
    states = np.array([[0.0, 1e300 if cost == np.inf else cost]])
    found = SampledValue(one)(states, np.zeros((1, 1)), [0.0], ss.Known())
    assert not np.isfinite(found.cost) and found.violation == np.inf
