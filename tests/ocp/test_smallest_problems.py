"""Smallest possible problems: one state, one interval, no control, empty lists.

CasADi's slices and products of 1 x 1 and of empty matrices have other shapes, and it
drops expressions that are always zero. Users must not notice this.
"""

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Separation,
    Solution,
    SolutionStatus,
    TerminalConstraint,
    solve,
)

X, U = ca.SX.sym("x"), ca.SX.sym("u")
inf = np.inf


def posed(**stated: object) -> OptimalControlProblem:
    """x' = u over 1 s with |u| <= 4, minimising u^2."""
    given = {
        "intervals": 1, "stage_cost": U**2, "bounds": Bounds(controls=(-4, 4)), **stated
    }  # fmt: skip
    model = Model(states=X, controls=U, ode=U)
    return OptimalControlProblem(model, horizon=1.0, **given)  # type: ignore[arg-type]


def solved(problem: OptimalControlProblem, **asked: object) -> Solution:
    given = {"search": "lshade", "budget": 400, "seed": 0, "backend": "casadi", **asked}
    return solve(problem, [0], **given)  # type: ignore[arg-type]


@pytest.mark.parametrize("checks", [1, 2])
@pytest.mark.parametrize("intervals", [1, 2])
def test_one_state_and_few_intervals_have_both_ends(
    intervals: int, checks: int
) -> None:
    """To 1 in 1 s: at speed 1."""
    found = solved(posed(intervals=intervals, checks=checks, terminal=[X - 1]))
    assert found.status is SolutionStatus.CONVERGED
    assert found.cost == pytest.approx(1)
    np.testing.assert_allclose(found.states, found.times[None], atol=1e-8)
    assert found.states.shape == (1, intervals * checks + 1)


@pytest.mark.parametrize("intervals", [1, 2])
@pytest.mark.parametrize(
    ("stated", "end"),
    [
        ({"constraints": [X <= 0.3]}, 0.3),
        ({"bounds": Bounds(controls=(-4, 4), states=(-1, 0.3))}, 0.3),
        ({"constraints": [U <= 0.25]}, 0.25),
        ({"constraints": X <= 0.3, "terminal": X - 0.1}, 0.1),
        ({}, 0.5),
    ],
)
def test_one_row_is_a_row(
    stated: dict[str, object], end: float, intervals: int
) -> None:
    """min u^2 - x(1): at speed 1/2 without further constraints."""
    found = solved(posed(intervals=intervals, terminal_cost=-X, **stated))
    assert found.status is SolutionStatus.CONVERGED
    np.testing.assert_allclose(found.states[0, -1], end, atol=1e-6)


def test_row_with_a_control_holds_as_the_only_interval_begins() -> None:
    """u - x <= 1/4: at the start u alone, at the end 0, since x(1) = u."""
    found = solved(posed(terminal_cost=-X, constraints=[U - X <= 0.25]), search=None)
    assert found.status is SolutionStatus.CONVERGED
    np.testing.assert_allclose(found.controls, 0.25, atol=1e-6)


@pytest.mark.parametrize(
    "stated",
    [
        {"constraints": [], "terminal": []},
        {"constraints": (), "terminal": ()},
        {"constraints": [PathConstraint(expression=X)]},
        {"constraints": [PathConstraint(expression=[X, U], upper=[inf, inf])]},  # type: ignore[arg-type]
        {"constraints": [PathConstraint(expression=[])]},  # type: ignore[arg-type]
        {"terminal": [TerminalConstraint(expression=X, lower=-inf, upper=inf)]},
        {"terminal": [TerminalConstraint(expression=[])]},  # type: ignore[arg-type]
        {"constraints": [PathConstraint(expression=ca.SX(1), upper=2)]},
        {"terminal": [ca.SX(0)]},  # Always kept: IPOPT once refused it.
    ],
)
def test_constraints_that_demand_nothing_change_nothing(
    stated: dict[str, object],
) -> None:
    found = solved(posed(terminal_cost=-X, **stated))
    assert found.status is SolutionStatus.CONVERGED
    np.testing.assert_allclose(found.controls, 0.5, atol=1e-6)


def test_model_without_controls_is_simulated() -> None:
    """x' = -x from 1: the integral of x^2 over 1 s is (1 - e^-2) / 2."""
    problem = OptimalControlProblem(
        Model(states=X, controls=ca.SX(0, 1), ode=-X), horizon=1.0, intervals=3,
        stage_cost=X**2,
    )  # fmt: skip
    found = solve(problem, [1], search=None, backend="casadi", seed=0)
    assert found.status is SolutionStatus.CONVERGED
    assert found.cost == pytest.approx((1 - np.exp(-2)) / 2, rel=1e-4)
    assert found.controls.shape == (0, 3)


def test_fixed_control_is_kept() -> None:
    found = solved(posed(bounds=Bounds(controls=(1, 1))), search=None)
    np.testing.assert_array_equal(found.controls, [[1]])
    assert found.status is SolutionStatus.CONVERGED


@pytest.mark.parametrize("tiny", [1e-17, 1e-300])
def test_guess_that_is_zero_by_rounding_is_as_good_as_zero(tiny: float) -> None:
    """IPOPT once called this infeasible, since the control's size was 1e-17."""
    free = posed(bounds=Bounds(), terminal=[X - 1], intervals=4)
    found = solved(free, search=None, guess=np.full((1, 4), tiny))
    assert found.status is SolutionStatus.CONVERGED
    np.testing.assert_allclose(found.controls, 1, atol=1e-6)


def test_cost_without_end_is_a_status_and_one_that_is_no_number_is_refused() -> None:
    for name in ("stage_cost", "terminal_cost"):
        endless = posed(**{name: ca.SX(inf)})
        assert solved(endless).status is SolutionStatus.NOT_FINITE
        with pytest.raises(InvalidProblemError, match=f"{name} must not be NaN"):
            posed(**{name: ca.SX(np.nan)})


@pytest.mark.parametrize("factor", [1e-300, 1e-200, 1e200, 1e300])
def test_costs_of_any_size_end_in_a_status(factor: float) -> None:
    found = solved(posed(stage_cost=factor * U**2, terminal=[X - 1], intervals=2))
    assert found.plan.feasible
    assert found.cost == pytest.approx(factor, rel=1e-3)


def test_refuses_a_model_without_states_and_no_distance() -> None:
    with pytest.raises(InvalidProblemError, match="states must hold at least one"):
        Model(states=ca.SX(0, 1), controls=U, ode=ca.SX(0, 1))
    with pytest.raises(InvalidProblemError, match="at least one row"):
        Separation(relative=ca.SX(0, 1), distance=1.0)
