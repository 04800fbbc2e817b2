"""Bounds that move: against closed forms and the same limits as path constraints."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    SolutionStatus,
    solve,
)


def pushed(*, timed: bool = False) -> OptimalControlProblem:
    """A point that moves as far as possible, at a small cost of u^2 / 1000 a second."""
    x, u, p, s, t = (ca.SX.sym(name) for name in "xupst")
    model = Model(
        states=x,
        controls=u,
        ode=u,
        parameters=p,
        time=t if timed else ca.SX(0, 1),
    )
    return OptimalControlProblem(
        model, horizon=2.0, intervals=4, stage_cost=u**2 / 1000, terminal_cost=-x,
        signals=s,
    )  # fmt: skip


SIGNALS = np.array([[1.0, 3.0, 2.0, 0.5, 4.0]])
KNOWN = Known(parameters=[2.0], signals=SIGNALS)


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
def test_control_keeps_below_a_signal_in_the_whole_interval(backend: str) -> None:
    """Held controls keep the smaller of the values of p s at an interval's ends."""
    problem = pushed()
    p, s = problem.model.parameters, problem.signals
    least = 2 * np.minimum(SIGNALS[0, 1:], SIGNALS[0, :-1])
    bounded = replace(problem, bounds=Bounds(controls=(0, p * s), search=(0, 10)))
    for search in (None, "default"):
        answer = solve(
            bounded,
            [0.0],
            known=KNOWN,
            search=search,
            budget=4000,
            seed=0,
            backend=backend,
        )
        assert answer.status is SolutionStatus.CONVERGED
        assert answer.controls[0] == pytest.approx(least, abs=1e-5)
    assert bounded.control_limits[0].tolist() == [0.0]
    assert bounded.control_limits[1].tolist() == [np.inf]


def test_state_keeps_above_and_below_what_moves_with_time() -> None:
    """t - 1 <= x <= 1 - t / 4: x' = u ends at the upper limit, 0.5 at 2 s."""
    problem = pushed(timed=True)
    t = problem.model.time
    bounded = replace(problem, bounds=Bounds(states=(t - 3, 1 - t / 4)))
    answer = solve(bounded, [1.0], known=KNOWN, search=None, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    assert answer.states[0, -1] == pytest.approx(0.5, abs=1e-6)
    # Little effort leads along the limit; its cost is a thousandth.
    assert answer.states[0] == pytest.approx(1 - answer.times / 4, abs=1e-3)
    with pytest.raises(
        InvalidProblemError, match=r"the start must keep.*moving bounds"
    ):
        solve(bounded, [1.1], known=KNOWN, search=None, seed=0)


def test_numbers_beside_expressions_stay_bounds() -> None:
    x, u, s = ca.SX.sym("x", 2), ca.SX.sym("u", 2), ca.SX.sym("s")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0,
        intervals=2,
        signals=s,
        bounds=Bounds(controls=([-1, -s], [s, 1]), states=(-5, [7, 8])),
    )
    lower, upper = problem.control_limits
    assert (lower.tolist(), upper.tolist()) == ([-1, -np.inf], [np.inf, 1])
    (moving,) = problem.stated
    assert moving.name == "moving bounds of the controls"
    assert moving.expression.numel() == 2
    assert problem.state_limits[1].tolist() == [7, 8]
    again = replace(problem, horizon=2.0)
    assert len(again.stated) == 1


def test_broken_moving_bound_is_told_by_its_name() -> None:
    problem = pushed()
    s = problem.signals
    bounded = replace(problem, bounds=Bounds(controls=(5.0, s)))
    answer = solve(bounded, [0.0], known=KNOWN, search=None, seed=0)
    assert answer.status is SolutionStatus.INFEASIBLE
    assert "'moving bounds of the controls' is broken by" in answer.reason


def test_search_asks_for_a_box_where_a_bound_moves() -> None:
    problem = pushed()
    bounded = replace(problem, bounds=Bounds(controls=(0, problem.signals)))
    with pytest.raises(InvalidProblemError, match=r"Bounds\(search=\(lower, upper\)\)"):
        solve(bounded, [0.0], known=KNOWN, seed=0)


def test_refuses_bounds_of_what_is_decided_and_other_numbers_of_them() -> None:
    problem = pushed()
    x, s = problem.model.states, problem.signals
    for limit, said in (
        (x, "bounds of the controls may depend on parameters, signals only, found x"),
        (ca.vertcat(s, s), "bounds of the controls must be one or 1 of them, got 2"),
    ):
        with pytest.raises(InvalidProblemError, match=said):
            replace(problem, bounds=Bounds(controls=(0, limit)))


def test_equality_and_range_along_the_path_hold_in_search_polish_and_path() -> None:
    """u_0 + u_1 = 1 and 0.2 <= u_0 - u_1 <= 0.4, which make u_0 0.6 at least."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u", 2)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u[0]),
        horizon=1.0,
        intervals=3,
        stage_cost=ca.sumsqr(u),
        bounds=Bounds(controls=(-2, 2)),
        constraints=[
            ca.sum1(u) == 1,
            PathConstraint(expression=u[0] - u[1], lower=0.2, upper=0.4, name="apart"),
        ],
    )
    for backend in ("llvm", "casadi"):
        for search in (None, "default"):
            answer = solve(
                problem, [0.0], search=search, budget=4000, seed=0, backend=backend
            )
            assert answer.status is SolutionStatus.CONVERGED
            held = np.repeat([[0.6], [0.4]], 3, axis=1)
            np.testing.assert_allclose(answer.controls, held, atol=1e-6)
            assert answer.verified_violation < 1e-6
            assert answer.multipliers is not None
            # d cost / d gap: 2 (u_0 du_0 + u_1 du_1) T = 0.6 - 0.4.
            assert answer.multipliers.path["apart"].sum() == pytest.approx(
                -0.2, rel=1e-5
            )
