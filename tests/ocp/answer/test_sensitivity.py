"""Derivatives of answers: a Riccati recursion, and the same problems solved again."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Free,
    IpoptOptions,
    Known,
    Model,
    NoSensitivityError,
    OptimalControlProblem,
    PathConstraint,
    Polisher,
    Sensitivities,
    Sensitivity,
    Solution,
    Solutions,
    SolutionStatus,
    TransportDelay,
    ensemble,
    solve,
    solve_many,
)

EXACT = IpoptOptions(tolerance=1e-11, options={"acceptable_tol": 1e-11})
X, U, P = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("p")
T = ca.SX.sym("t")
PENDULUM = Model(
    states=X, controls=U, parameters=P, ode=ca.vertcat(X[1], U - P * ca.sin(X[0]))
)


def pendulum(**changes: object) -> OptimalControlProblem:
    """Return a pendulum with a parameter, two seconds and twelve intervals."""
    stated = OptimalControlProblem(
        PENDULUM,
        horizon=2.0,
        intervals=12,
        stage_cost=U**2 + ca.sumsqr(X),
        terminal_cost=5 * ca.sumsqr(X),
        bounds=Bounds(controls=(-3, 3)),
    )
    return replace(stated, **changes)  # type: ignore[arg-type]


Y, V = ca.SX.sym("y"), ca.SX.sym("v")
HANGING = Model(
    states=ca.vertcat(X, Y), controls=U, parameters=ca.vertcat(P, V),
    ode=ca.vertcat(X[1], U - P * X[0] ** 3, V * X[0] - Y),
)  # fmt: skip
SHORTEST = OptimalControlProblem(
    PENDULUM,
    horizon=Free(0.2, 9),
    intervals=10,
    stage_cost=1 + U**2 / 4,
    bounds=Bounds(controls=(-2, 2)),
    terminal=[X - ca.vertcat(1, 0)],
)


@dataclass(frozen=True)
class Case:
    """A problem with its data."""

    problem: OptimalControlProblem
    x0: Sequence[float] = (1.0, 0.3)
    parameters: Sequence[float] = (2.0,)
    step: float = 1e-4


CASES = {
    "free": Case(pendulum(bounds=Bounds())),
    "bounds of controls": Case(pendulum(), (2.5, 2.0)),
    "path constraint": Case(
        pendulum(constraints=[PathConstraint(expression=X[1], lower=-0.3)]),
        (1.0, 0.0),
    ),
    "end conditions": Case(pendulum(terminal=[X])),
    "one-sided end": Case(pendulum(terminal=[X[0] >= 0.4])),
    "free end time": Case(SHORTEST, (0.0, 0.1)),
    "decided parameter": Case(
        OptimalControlProblem(
            HANGING,
            horizon=1.5,
            intervals=8,
            stage_cost=ca.sumsqr(X) + U**2 + Y**2,
            terminal_cost=(V - 1) ** 2,
            decided={"v": Free(-3, 3)},
            bounds=Bounds(controls=(-3, 3)),
        ),
        (1.0, 0.0, 0.5),
    ),
    "linear controls": Case(pendulum(control_shape="linear")),
    "blocks": Case(pendulum(blocks=[1, 1, 2, 8])),
    "maximised": Case(
        pendulum(stage_cost=-(U**2) - ca.sumsqr(X), terminal_cost=0, maximize=True)
    ),
    "collocation": Case(pendulum(transcription="radau")),
    "machine code": Case(pendulum(intervals=40, substeps=30)),
    "delay": Case(pendulum(features=[TransportDelay({"u": 1 / 3})])),
    "far origin": Case(
        OptimalControlProblem(
            Model(states=X, controls=U, parameters=P, ode=ca.vertcat(X[1], P * U)),
            horizon=1.0,
            intervals=6,
            stage_cost=U**2,
            terminal_cost=(X[0] - 1e9) ** 2 + X[1] ** 2,
            bounds=Bounds(controls=(-9, 9)),
        ),
        (1e9 + 2, 0.0),
        step=0.125,  # A double there has seven digits behind the point.
    ),
    "soft": Case(
        pendulum(constraints=[PathConstraint(expression=X[1], lower=-0.3, weight=2.0)])
    ),
    "time": Case(
        OptimalControlProblem(
            Model(
                states=X, controls=U, parameters=P, time=T,
                ode=ca.vertcat(X[1], U - P * ca.sin(X[0] + T)),
            ),
            horizon=2.0,
            intervals=12,
            stage_cost=U**2 + ca.sumsqr(X),
            bounds=Bounds(controls=(-3, 3)),
        )
    ),
    "discrete, with a parameter in costs and limits": Case(
        OptimalControlProblem(
            Model(
                states=X, controls=U, parameters=P,
                next_state=ca.vertcat(X[0] + 0.2 * X[1], X[1] + 0.2 * U),
            ),
            horizon=10.0,
            intervals=10,
            stage_cost=P * ca.sumsqr(X) + U**2 / P,
            bounds=Bounds(controls=(-3, 3)),
            constraints=[PathConstraint(expression=P * X[1], lower=-1.5)],
        ),
        (2.0, 0.0),
    ),
}  # fmt: skip


def solved(case: Case, guess: Solution | None = None, **changes: object) -> Solution:
    """Return an answer to a case, near another one."""
    case = replace(case, **changes)  # type: ignore[arg-type]
    return solve(
        case.problem,
        case.x0,
        known=Known(parameters=np.array(case.parameters)),
        search=None,
        lanes=0,
        polish=EXACT,
        repair=False,
        guess=None if guess is None else guess.as_guess(),
        seed=0,
    )


def measured(case: Case, at: Solution, name: str) -> tuple[Array, ...]:
    """Return central differences of cost, controls, states and decisions."""
    names = case.problem.model.state_names
    step = case.step if name in names else 1e-4

    def moved(sign: int) -> Solution:
        if name in names:
            x0 = np.array(case.x0)
            x0[names.index(name)] += sign * step
            return solved(case, at, x0=x0)
        values = np.array(case.parameters)
        values[0] += sign * step
        return solved(case, at, parameters=values)

    ahead, behind = moved(1), moved(-1)
    checks = case.problem.checks

    def slope(of: Callable[[Solution], Array]) -> Array:
        return (of(ahead) - of(behind)) / (2 * step)

    return (
        slope(lambda s: np.array(s.cost)),
        slope(lambda s: s.controls),
        slope(lambda s: s.plan.states[: len(names), ::checks]),
        slope(lambda s: np.array([*s.decided.values()])),
    )


def solved_at_once(case: Case) -> Solutions:
    """Return the answer to a case among those to similar instances."""
    x0 = np.array(case.x0)[:, None] * [0.99, 1.0, 1.01]
    p = np.array([1.0, case.parameters[0], 1.01 * case.parameters[0]])
    return solve_many(case.problem, x0, known={"p": p}, seed=0, progress=False)


@pytest.mark.parametrize("name", CASES)
def test_derivatives_are_those_of_problems_solved_again(name: str) -> None:
    case = CASES[name]
    at = solved(case)
    found = at.sensitivity()
    assert found.unclear == 0
    every = solved_at_once(case).sensitivity(threads=1)
    assert (every.data, every.reasons) == (found.data, {})
    for number, datum in enumerate(found.data):
        cost, controls, states, decided = measured(case, at, datum)
        close = {"rtol": 1e-5, "atol": 1e-5 * (1 + np.abs(controls).max())}
        for way in (found, instance(every, 1)):
            np.testing.assert_allclose(way.cost[number], cost, **close)
            np.testing.assert_allclose(way.controls[..., number], controls, **close)
            np.testing.assert_allclose(way.states[..., number], states, **close)
            values = np.array([one[number] for one in way.decided.values()])
            np.testing.assert_allclose(values, decided, **close)


def instance(every: Sensitivities, number: int) -> Sensitivity:
    """Return the derivatives of one instance."""
    return Sensitivity(
        data=every.data,
        cost=every.cost[:, number],
        controls=every.controls[..., number],
        states=every.states[..., number],
        decided={name: one[:, number] for name, one in every.decided.items()},
        unclear=int(every.unclear[number]),
    )


def test_nothing_is_solved_again_where_the_nlp_explains_an_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    explained = solved_at_once(CASES["bounds of controls"])
    with_margins = solved_at_once(CASES["path constraint"])

    def refused(*_: object, **__: object) -> Solution:
        raise AssertionError("an answer was solved again")

    monkeypatch.setattr(Polisher, "__call__", refused)
    assert not explained.sensitivity(threads=1).reasons
    with pytest.raises(AssertionError, match="solved again"):
        with_margins.sensitivity(threads=1)


@pytest.mark.parametrize("threads", [1, 3])
def test_an_instance_without_derivatives_has_a_reason(threads: int) -> None:
    """The sum of controls that cost nothing can be reached in many ways."""
    x, u, p = ca.SX.sym("x"), ca.SX.sym("u", 2), ca.SX.sym("p")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, parameters=p, ode=u[0] + u[1]),
        horizon=1.0, intervals=2, terminal_cost=x**2,
        stage_cost=p * ca.sumsqr(u),
        bounds=Bounds(controls=([-2, -2], [2, 2]), states=(-9, 9)),
    )  # fmt: skip
    x0, weights = [[0.3, 0.3, 10.0, 0.4]], {"p": [1.0, 0.0, 1.0, 1.0]}
    answers = solve_many(problem, x0, known=weights, seed=0)
    assert answers.status[2] is SolutionStatus.INVALID
    found = answers.sensitivity(threads=threads)
    assert sorted(found.reasons) == [1, 2]
    assert "expected a strict minimum" in found.reasons[1]
    assert found.reasons[2] == "the answer is not confirmed: INVALID"
    for values in (found.cost, found.controls, found.states):
        is_missing = np.isnan(values).reshape((-1, 4))
        np.testing.assert_array_equal(
            is_missing, [[False, True, True, False]] * len(is_missing)
        )
    # All controls are -x0 / (p + 2), and the cost is x0^2 / (1 + 2 / p).
    np.testing.assert_allclose(found.cost[0, 0], 2 * 0.3 / (1 + 2 / 1.0), rtol=1e-6)
    assert "2 without derivatives" in repr(found)


@pytest.mark.parametrize("units", [(1.0, 1.0), (1e4, 1e-3)])
def test_feedback_is_that_of_the_riccati_recursion(units: tuple[float, float]) -> None:
    """u_k = -K_k A_c^k x0 and V = x0' P_0 x0, in two systems of units."""
    of_x, of_u = units
    z, v, dt, N = ca.SX.sym("z", 2), ca.SX.sym("v"), 0.25, 8
    x, u = z / of_x, v / of_u
    problem = OptimalControlProblem(
        Model(states=z, controls=v, ode=of_x * ca.vertcat(x[1], u)),
        horizon=dt * N, intervals=N, stage_cost=u**2, terminal_cost=3 * ca.sumsqr(x),
    )  # fmt: skip
    x0 = np.array([1.0, -0.5])
    answer = solve(problem, x0 * of_x, search=None, lanes=0, polish=EXACT, seed=0)
    A, B = np.array([[1, dt], [0, 1]]), np.array([[dt**2 / 2], [dt]])
    V, gains = 3 * np.eye(2), list[Array]()
    for _ in range(N):
        K = np.linalg.solve(dt + B.T @ V @ B, B.T @ V @ A)
        V = A.T @ V @ (A - B @ K)
        gains.insert(0, K)
    found = answer.sensitivity(by=["x0"])
    np.testing.assert_allclose(found.cost * of_x, 2 * V @ x0, rtol=1e-7)
    ahead = np.eye(2)
    for k, K in enumerate(gains):
        np.testing.assert_allclose(
            found.controls[0, k] * of_x / of_u, (-K @ ahead)[0], rtol=1e-7, atol=1e-9
        )
        np.testing.assert_allclose(found.states[:, k], ahead, rtol=1e-7, atol=1e-9)
        ahead = (A - B @ K) @ ahead


def test_decisions_are_no_data() -> None:
    names = PENDULUM.state_names
    free = solved(Case(pendulum(start={names[0]: Free(0.5, 3)})))
    assert free.sensitivity(by=["x0"]).data == (names[1],)
    assert free.sensitivity(by=["parameters"]).data == ("p",)
    assert solved(CASES["decided parameter"]).sensitivity().data[-1] == "p"


def test_without_data_there_is_nothing_to_derive() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0, intervals=4, stage_cost=u**2, terminal_cost=x**2,
    )  # fmt: skip
    found = solve(problem, [1.0], search=None, lanes=0, seed=0)
    slopes = found.sensitivity(by=["parameters"])
    assert slopes.data == ()
    assert slopes.cost.shape == (0,)
    assert (slopes.controls.shape, slopes.states.shape) == ((1, 4, 0), (1, 5, 0))
    several = solve_many(problem, [[1.0, 2.0]], seed=0).sensitivity(by=["parameters"])
    assert several.controls.shape == (1, 4, 0, 2)


def test_members_are_refused() -> None:
    members = ensemble(pendulum(), {"p": [1.0, 2.0]}, risk="worst")
    answer = solve(members, [1.0, 0.3], search=None, lanes=0, polish=EXACT, seed=0)
    with pytest.raises(NoSensitivityError, match="without members"):
        answer.sensitivity()
    answers = solve_many(members, [[1.0], [0.3]], seed=0)
    with pytest.raises(NoSensitivityError, match="without members"):
        answers.sensitivity()


def test_limit_that_is_about_to_act_is_counted() -> None:
    """The free optimum is exactly at the bound: to one side the control stays there."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0, intervals=1, stage_cost=u**2, terminal_cost=x**2,
        bounds=Bounds(controls=(-0.5, 0.5)),
    )  # fmt: skip
    at_corner = solve(problem, [1.0], search=None, lanes=0, seed=0)
    beside = solve(problem, [0.8], search=None, lanes=0, seed=0)
    many = solve_many(problem, [[1.0, 0.8]], seed=0).sensitivity(threads=1)
    assert many.unclear.tolist() == [1, 0]
    assert "1 with limits that may change" in repr(many)
    assert at_corner.sensitivity().unclear == 1
    assert beside.sensitivity().unclear == 0
    assert "may change" in repr(at_corner.sensitivity())


def test_answer_without_a_polish_has_none() -> None:
    answer = solve(pendulum(), [1, 0], known=Known(parameters=np.ones(1)), polish=None,
                   budget=400, seed=0)  # fmt: skip
    with pytest.raises(NoSensitivityError, match="has converged, found none"):
        answer.sensitivity()


def test_flat_minimum_has_none() -> None:
    """Any control costs the same."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u", 2)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u[0] + u[1]),
        horizon=1.0, intervals=2, terminal_cost=x**2,
        bounds=Bounds(controls=([-2, -2], [2, 2])),
    )  # fmt: skip
    answer = solve(problem, [0.3], search=None, lanes=0, seed=0)
    with pytest.raises(NoSensitivityError, match="expected a strict minimum"):
        answer.sensitivity()


def test_limits_that_depend_on_each_other_are_said() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0, intervals=3, stage_cost=u**2,
        bounds=Bounds(controls=(-9, 9)), terminal=[(x, 0), (2 * x, 0)],
    )  # fmt: skip
    answer = solve(problem, [1.0], search=None, lanes=0, seed=0)
    with pytest.raises(NoSensitivityError, match="independent of each other"):
        answer.sensitivity()


def test_only_known_data_are_taken() -> None:
    with pytest.raises(ValueError, match="by must be names of data"):
        solved(CASES["free"]).sensitivity(by=["signals"])  # type: ignore[list-item]
