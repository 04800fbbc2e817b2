"""Free end times, parameters and starts, against closed forms and CasADi's Opti."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.typing import ArrayLike

from swarmstart.ocp import (
    Bounds,
    Free,
    InvalidProblemError,
    Known,
    Model,
    OptimalControlProblem,
    Planner,
    Separation,
    Solution,
    SolutionStatus,
    solve,
    verified,
)

BACKENDS = ("llvm", "casadi")


def both_ways(
    problem: OptimalControlProblem, x0: ArrayLike, **options: object
) -> list[Solution]:
    """Return the answers of the polish alone, and of a search with a polish."""
    polished = solve(problem, x0, search=None, seed=0, **options)  # type: ignore[arg-type]
    searched = solve(problem, x0, budget=4000, seed=0, **options)  # type: ignore[arg-type]
    return [polished, searched]


def brachistochrone() -> OptimalControlProblem:
    """A bead from (0, 0) to (2, -2)."""
    x, y, v, slope = (ca.SX.sym(n) for n in ("x", "y", "v", "slope"))
    model = Model(
        states=ca.vertcat(x, y, v),
        controls=slope,
        ode=ca.vertcat(v * ca.sin(slope), -v * ca.cos(slope), 9.8 * ca.cos(slope)),
    )
    return OptimalControlProblem(
        model,
        horizon=Free(0.1, 5.0, guess=1.0),
        intervals=20,
        stage_cost=ca.SX(1),
        bounds=Bounds(controls=(0.0, np.pi), states=([-np.inf, -np.inf, 0], np.inf)),
        terminal=[(ca.vertcat(x, y), [2.0, -2.0])],
    )


def opti_brachistochrone() -> float:
    """The same problem by multiple shooting in CasADi's Opti."""
    opti = ca.Opti()
    x, u, T = opti.variable(3, 21), opti.variable(1, 20), opti.variable()
    state, slope = ca.SX.sym("x", 3), ca.SX.sym("u")
    v = state[2]
    rate = ca.vertcat(v * ca.sin(slope), -v * ca.cos(slope), 9.8 * ca.cos(slope))
    f = ca.Function("f", [state, slope], [rate])
    for k in range(20):
        at, h = x[:, k], T / 20 / 4
        for _ in range(4):
            k1 = f(at, u[k])
            k2 = f(at + h / 2 * k1, u[k])
            k3 = f(at + h / 2 * k2, u[k])
            k4 = f(at + h * k3, u[k])
            at = at + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        opti.subject_to(x[:, k + 1] == at)
    opti.subject_to(x[:, 0] == 0)
    opti.subject_to(x[:2, -1] == ca.vertcat(2, -2))
    opti.subject_to(opti.bounded(0, u, np.pi))
    opti.subject_to(x[2, 1:] >= 0)
    opti.subject_to(opti.bounded(0.1, T, 5))
    opti.set_initial(T, 1)
    opti.set_initial(u, 1)
    opti.minimize(T)
    opti.solver("ipopt", {"print_time": False, "ipopt.print_level": 0})
    return float(opti.solve().value(T))


def test_free_end_time_is_that_of_opti_and_in_seconds() -> None:
    expected = opti_brachistochrone()
    assert expected == pytest.approx(0.824884, abs=1e-6)
    for answer in both_ways(brachistochrone(), np.zeros(3)):
        assert answer.status is SolutionStatus.CONVERGED
        assert answer.cost == pytest.approx(expected, rel=1e-6)
        assert answer.decided == {"end time": pytest.approx(answer.cost)}
        assert answer.times[-1] == pytest.approx(answer.cost)
        assert answer.states.shape == (3, 21)
        assert answer.path.times[-1] == pytest.approx(answer.cost)
        assert "decided     end time 0.8248" in repr(answer)


def test_polish_starts_at_the_guess_of_a_free_end_time() -> None:
    for guess, first in ((0.7, 0.7), (None, 2.55)):
        stated = replace(brachistochrone(), horizon=Free(0.1, 5.0, guess=guess))
        planner = Planner(stated, search=None)
        x0, known, _ = planner.posed(np.zeros(3))
        plan = planner.plan(x0, known=known, rng=np.random.default_rng(0))
        assert plan.x0.tolist() == [0, 0, 0, pytest.approx(first)]
        assert verified(planner.tracer, plan, x0).times[-1] == pytest.approx(first)


def test_search_is_never_worse_than_the_polish_of_the_guess_alone() -> None:
    for seed in range(3):
        answer = solve(brachistochrone(), np.zeros(3), seed=seed)
        assert answer.cost == pytest.approx(0.824884, abs=1e-6)


def fitted() -> tuple[OptimalControlProblem, np.ndarray]:
    """A decay whose rate and start are estimated from measurements."""
    x, rate, measured = ca.SX.sym("x"), ca.SX.sym("rate"), ca.SX.sym("measured")
    known = ca.SX.sym("known")
    model = Model(
        states=x, controls=ca.SX(0, 1), ode=-rate * x + known,
        parameters=ca.vertcat(rate, known),
    )  # fmt: skip
    problem = OptimalControlProblem(
        model,
        horizon=2.0,
        intervals=40,
        stage_cost=(x - measured) ** 2,
        signals=measured,
        decided={"rate": Free(0.1, 5.0)},
        start={"x": Free(0.0, 10.0)},
    )
    t = np.linspace(0, 2, 41)
    return problem, (3 - 0.5 / 1.5) * np.exp(-1.5 * t) + 0.5 / 1.5


def test_parameters_and_start_of_a_decay_are_found_from_its_course() -> None:
    problem, course = fitted()
    answer = solve(
        problem, [np.nan], search=None, known=Known([0.5], course[None, :]), seed=0
    )
    assert answer.status is SolutionStatus.CONVERGED
    # The signal is linear between the nodes, whereas the decay is not.
    assert answer.decided["rate"] == pytest.approx(1.5, rel=1e-3)
    assert answer.states[0, 0] == pytest.approx(3.0, rel=1e-3)


@pytest.mark.parametrize("backend", BACKENDS)
def test_start_that_is_decided_follows_its_closed_form(backend: str) -> None:
    """x' = u, cost u^2 + (x(0) - 2)^2 + x(1)^2 over 1 s: x0 = 4/3, u = -2/3."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0,
        intervals=4,
        stage_cost=u**2,
        initial_cost=(x - 2) ** 2,
        terminal_cost=x**2,
        bounds=Bounds(controls=(-3, 3)),
        start={"x": Free(-5, 5)},
    )
    for answer in both_ways(problem, [np.nan], backend=backend):
        assert answer.status is SolutionStatus.CONVERGED
        assert answer.states[0, 0] == pytest.approx(4 / 3, rel=1e-6)
        np.testing.assert_allclose(answer.controls, -2 / 3, rtol=1e-5)
        assert answer.cost == pytest.approx(4 / 3, rel=1e-9)
        assert answer.verified_cost == pytest.approx(4 / 3, rel=1e-9)


@pytest.mark.parametrize("checks", [1, 3])
def test_controls_and_parameters_tied_by_equations_are_polished(checks: int) -> None:
    """x' = u + w, w = u / 2, q = 2 p, x(1) = 3 u / 2 + 3 p: least squares."""
    x, u, w, p, q = (ca.SX.sym(n) for n in ("x", "u", "w", "p", "q"))
    problem = OptimalControlProblem(
        Model(
            states=x, controls=ca.vertcat(u, w), ode=u + w + p + q,
            parameters=ca.vertcat(p, q),
        ),
        horizon=1.0,
        intervals=4,
        stage_cost=u**2 + w**2,
        terminal_cost=(x - 1) ** 2 + p**2 + q**2,
        constraints=[w - u / 2 == 0, q - 2 * p == 0],
        decided={"p": Free(-1, 1), "q": Free(-1, 1)},
        checks=checks,
    )  # fmt: skip
    answer = solve(problem, [0.0], search=None, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    # With z = (u, 2 p): 5/4 |z|^2 + (3/2 (1, 1) z - 1)^2, z = 6/23 (1, 1).
    np.testing.assert_allclose(answer.controls[0], 6 / 23, rtol=1e-6)
    assert answer.decided["q"] == pytest.approx(6 / 23, rel=1e-6)
    assert answer.cost == pytest.approx(5 / 23, rel=1e-6)


def test_path_constraint_and_bounds_hold_at_a_start_that_is_decided() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0,
        intervals=4,
        stage_cost=u**2,
        initial_cost=(x - 2) ** 2,
        bounds=Bounds(controls=(-3, 3), states=(-np.inf, 1.5)),
        constraints=[x**3 <= 1],
        start={"x": Free(-5, 5)},
    )
    for answer in both_ways(problem, [0.0]):
        assert answer.states[0, 0] == pytest.approx(1.0, abs=1e-5)
        assert answer.cost == pytest.approx(1.0, abs=1e-5)
        assert answer.status.is_confirmed


def test_periodic_states_end_where_they_start() -> None:
    """x' = -x + u with u >= 1 half of the time: the start is the steady state."""
    x, v, u, t = (ca.SX.sym(n) for n in ("x", "v", "u", "t"))
    model = Model(
        states=ca.vertcat(x, v), controls=u, ode=ca.vertcat(-x + u + ca.sin(t), x),
        time=t,
    )  # fmt: skip
    problem = OptimalControlProblem(
        model,
        horizon=2 * np.pi,
        intervals=24,
        stage_cost=u**2,
        bounds=Bounds(controls=(-1, 1)),
        start={"x": Free(-4, 4)},
        periodic=["x"],
    )
    for answer in both_ways(problem, [np.nan, 1.0]):
        assert answer.status.is_confirmed
        # The periodic solution of x' = -x + sin t is (sin t - cos t) / 2.
        assert answer.states[0, 0] == pytest.approx(-0.5, abs=1e-4)
        assert answer.states[0, -1] == pytest.approx(-0.5, abs=1e-4)
        assert answer.states[1, 0] == 1.0
        np.testing.assert_allclose(answer.controls, 0.0, atol=1e-4)


def test_time_is_that_since_the_start_of_the_flight() -> None:
    x, u, t = (ca.SX.sym(n) for n in "xut")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u + t, time=t),
        horizon=1.0,
        intervals=5,
        stage_cost=u**2 + 0 * t,
        bounds=Bounds(controls=(-1, 1)),
    )
    for begin, end in ((0.0, 0.5), (2.0, 2.5)):
        answer = solve(problem, [0.0], search=None, known=Known(time=begin), seed=0)
        assert answer.states[0, -1] == pytest.approx(end)


def test_search_without_bounds_of_what_is_decided_asks_for_them() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    model = Model(states=x, controls=u, ode=u)
    problem = OptimalControlProblem(
        model, horizon=Free(0.5), intervals=4, stage_cost=u**2,
        bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    with pytest.raises(InvalidProblemError, match=r"end time in \[0.5, inf\]: give"):
        solve(problem, [0.0], seed=0)
    unbounded = OptimalControlProblem(
        model, horizon=1.0, intervals=4, stage_cost=(u - 2) ** 2,
        bounds=Bounds(search=(-1, 1)),
    )  # fmt: skip
    answer = solve(unbounded, [0.0], budget=500, seed=0)
    np.testing.assert_allclose(answer.controls, 2.0, rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"horizon": Free(0.0, 1.0)}, "lower bound above 0"),
        ({"start": {"y": Free(0, 1)}}, "start must name states, one of x, got 'y'"),
        ({"start": {"x": (0, 1)}}, "start of 'x' must be a swarmstart.Free"),
        ({"decided": {"q": Free(0, 1)}}, "decided must name"),
        ({"decided": {"p": 1.0}}, "decided parameter 'p' must be a swarmstart.Free"),
        ({"periodic": ["x", "x"]}, "periodic must "),
        ({"periodic": "x"}, "periodic must "),
        (
            {"previous": ca.SX.sym("v", 3)},
            "previous must be a symbol for each of the 1",
        ),
        ({"start": {"x": Free(2, 3)}, "bounds": Bounds(states=(0, 1))}, "leave room"),
    ],
)
def test_what_cannot_be_decided_is_refused(
    change: dict[str, object], message: str
) -> None:
    x, u, p = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("p")
    stated = {"horizon": 1.0, "intervals": 2, "stage_cost": u**2} | change
    with pytest.raises(InvalidProblemError, match=message):
        OptimalControlProblem(
            Model(states=x, controls=u, ode=u, parameters=p), **stated  # type: ignore[arg-type]
        )  # fmt: skip


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((2.0, 1.0), "lower <= upper"),
        ((np.nan, 1.0), "lower <= upper"),
        ((0.0, 1.0, 2.0), "guess of a Free must be within"),
        (("0", 1.0), "lower of a Free must be a number"),
    ],
)
def test_bounds_of_what_is_decided_are_numbers_in_order(
    given: tuple[object, ...], message: str
) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        Free(*given)  # type: ignore[arg-type]


def test_goddard_rocket_is_solved_without_a_guess() -> None:
    """With zero thrust the rocket falls; states lead straight to the end instead."""
    h, v, m, thrust = (ca.SX.sym(n) for n in ("h", "v", "m", "thrust"))
    drag = 310 * v**2 * ca.exp(-500 * (h - 1))
    model = Model(
        states=ca.vertcat(h, v, m),
        controls=thrust,
        ode=ca.vertcat(v, (thrust - drag) / m - 1 / h**2, -2 * thrust),
    )
    problem = OptimalControlProblem(
        model,
        horizon=Free(0.02, 0.5),
        intervals=50,
        terminal_cost=-h,
        bounds=Bounds(controls=(0, 3.5), states=([1, 0, 0.6], np.inf)),
        terminal=[(m, 0.6)],
    )
    answer = solve(problem, [1.0, 0.0, 1.0], search=None, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    # COPS 3 gives 1.01284 for its finest grid.
    assert answer.cost == pytest.approx(-1.0128366, abs=1e-6)


def test_time_stands_beside_the_only_signal_of_a_model() -> None:
    x, wind, t = (ca.SX.sym(n) for n in ("x", "wind", "t"))
    model = Model(states=x, controls=ca.SX(0, 1), ode=wind + t, signals=wind, time=t)
    problem = OptimalControlProblem(
        model, horizon=1.0, intervals=2, initial_cost=x**2, terminal_cost=(x - 3) ** 2,
        start={"x": Free(-9, 9)},
    )  # fmt: skip
    known = Known((), np.array([[1.0, 1.0, 1.0]]), time=1.0)
    answer = solve(problem, [0.0], search=None, known=known, seed=0)
    # x grows by 1 + 1.5: x0^2 + (x0 - 1/2)^2 is least at 1/4.
    assert answer.states[0, 0] == pytest.approx(0.25, abs=1e-7)
    assert answer.states[0, -1] == pytest.approx(2.75, abs=1e-7)


@pytest.mark.parametrize(
    ("x0", "known", "message"),
    [
        ([0.0, 1.0], Known(), r"x0 must have shape \(1,\), got \(2,\)"),
        ([np.nan], Known(), "x0 must be finite"),
        (["a"], Known(), "x0 must be an array or a list of real numbers"),
        ([0.0], Known(previous=[1.0, 2.0]), r"numbers of shape \(1,\), one"),
        ([0.0], Known(previous=[np.nan]), r"must be finite numbers of shape \(1,\)"),
        ([0.0], Known(signals=np.zeros((1, 5))), "signals must have shape"),
        ([0.0], Known(parameters=[1.0, 2.0, 3.0]), "parameters must have shape"),
    ],
)
def test_what_is_known_must_fit_the_stated_problem(
    x0: list[float], known: Known, message: str
) -> None:
    x, u, p, t = (ca.SX.sym(n) for n in "xupt")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u + p * t, parameters=p, time=t),
        horizon=Free(0.5, 2.0), intervals=4, stage_cost=u**2, previous=ca.SX.sym("v"),
        decided={"p": Free(0, 1)},
    )  # fmt: skip
    with pytest.raises(InvalidProblemError, match=message):
        solve(problem, x0, search=None, known=known, seed=0)


def test_time_may_stand_beside_signals_and_in_distances() -> None:
    x, u, t, wind = (ca.SX.sym(n) for n in ("x", "u", "t", "wind"))
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=wind + t, signals=wind, time=t),
        horizon=2.0,
        intervals=4,
        terminal_cost=x,
        constraints=[Separation(relative=ca.vertcat(x + t + 1, 0), distance=0.5)],
    )
    signals = 2 * np.linspace(0, 2, 5)[None, :]
    answer = solve(problem, [0.0], search=None, known=Known((), signals), seed=0)
    assert answer.cost == pytest.approx(6.0)


def test_discrete_time_model_of_one_control_may_have_a_decided_parameter() -> None:
    x, u, gain = (ca.SX.sym(n) for n in ("x", "u", "gain"))
    problem = OptimalControlProblem(
        Model(states=x, controls=u, next_state=gain * x, parameters=gain),
        horizon=2,
        intervals=2,
        terminal_cost=(x - 4) ** 2,
        decided={"gain": Free(0.5, 3.0)},
    )
    answer = solve(problem, [1.0], search=None, seed=0)
    assert answer.decided["gain"] == pytest.approx(2.0, rel=1e-5)


def test_four_discs_are_passed_on_the_best_side() -> None:
    """With feasibility first, 7 of 12 seeds end on the side on which they began."""
    x, y, heading, rate = (ca.SX.sym(n) for n in ("x", "y", "heading", "rate"))
    discs = [(2.0, 0.3, 0.9), (4.2, -0.6, 1.0), (6.2, 0.5, 1.0), (8.2, -0.3, 0.9)]
    problem = OptimalControlProblem(
        Model(
            states=ca.vertcat(x, y, heading),
            controls=rate,
            ode=ca.vertcat(ca.cos(heading), ca.sin(heading), rate),
        ),
        horizon=Free(10, 20),
        intervals=40,
        substeps=2,
        stage_cost=1 + 0.1 * rate**2,
        bounds=Bounds(controls=(-3, 3)),
        constraints=[(x - a) ** 2 + (y - b) ** 2 >= r**2 for a, b, r in discs],
        terminal=[(x, 10), (y, 0)],
    )
    for seed in range(4):
        answer = solve(problem, np.zeros(3), repair=False, seed=seed)
        assert answer.cost == pytest.approx(10.818588, abs=1e-5)
    kept = solve(problem, np.zeros(3), repair=True, seed=0)
    assert kept.status is SolutionStatus.CONVERGED
    assert kept.cost == pytest.approx(10.8214, abs=2e-3)
