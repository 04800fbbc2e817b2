"""The one-call solution, on problems with known answers."""

from collections.abc import Callable, Iterator

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.heuristics import Budget, ChaoticPSO, RandomSearch, feasibility_first
from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    IpoptOptions,
    Known,
    Model,
    OptimalControlProblem,
    SolutionStatus,
    Source,
    Start,
    solve,
)
from swarmstart.ocp.answer import solving
from swarmstart.ocp.answer.solving import SolveInterrupted

Posed = tuple[OptimalControlProblem, Array, Known]


def test_pendulum_swings_up_and_scipy_agrees(
    swing_up: Callable[..., OptimalControlProblem],
) -> None:
    problem = swing_up(50, 4)
    solution = solve(
        problem,
        [0, 0],
        search=RandomSearch(size=10),
        budget=Budget(evaluations=100),
        polish=IpoptOptions(),
        rng=np.random.default_rng(0),
    )
    assert solution.status is SolutionStatus.CONVERGED
    assert (np.abs(solution.controls) <= 8).all()
    y, spent = np.zeros(2), 0.0
    for u in solution.controls[0]:
        flown = solve_ivp(
            lambda _, z, u=u: [z[1], u - 9.81 * np.sin(z[0])],
            (0, problem.dt),
            y,
            rtol=1e-10,
            atol=1e-12,
        )
        y, spent = flown.y[:, -1], spent + u**2 * problem.dt
    # The solver's RK4 steps are 15 ms long: 6e-6 off at the end.
    np.testing.assert_allclose(y, [np.pi, 0], atol=2e-5)
    np.testing.assert_allclose(solution.states[:, -1], y, atol=1e-8)
    assert solution.cost == pytest.approx(spent, rel=1e-12)


@pytest.mark.parametrize("intervals", [6, 10])
def test_optimum_of_a_coarse_integrator_is_called_a_mismatch(
    swing_up: Callable[..., OptimalControlProblem], intervals: int
) -> None:
    solution = solve(
        swing_up(intervals, 1),
        [0, 0],
        search=None,
        polish=IpoptOptions(),
        rng=np.random.default_rng(0),
    )
    assert solution.status is SolutionStatus.MISMATCH
    assert solution.violation <= 1e-6
    assert solution.verified_violation > 0.1


def test_impossible_problem_is_called_infeasible(double_integrator: Model) -> None:
    problem = OptimalControlProblem(
        double_integrator,
        horizon=1.0,
        intervals=5,
        stage_cost=double_integrator.controls**2,
        bounds=Bounds(controls=(-1, 1)),
        terminal=[double_integrator.states - ca.vertcat(10, 0)],
    )
    solution = solve(
        problem,
        [0, 0],
        search=RandomSearch(size=5),
        budget=Budget(evaluations=20),
        order=feasibility_first(),
        polish=IpoptOptions(),
        rng=np.random.default_rng(0),
    )
    assert solution.status is SolutionStatus.INFEASIBLE
    assert solution.violation >= 0.975 - 1e-6  # Of 10 m.


def test_gradient_alone_passes_on_the_expensive_side(passing_side: Posed) -> None:
    """Scenario passing_side: cold IPOPT ends at 1810.2."""
    problem, x0, known = passing_side
    solution = solve(
        problem,
        x0,
        search=None,
        polish=IpoptOptions(),
        known=known,
        lanes=0,
        repair=True,
        rng=np.random.default_rng(0),
    )
    assert solution.status is SolutionStatus.CONVERGED
    assert solution.cost == pytest.approx(1810.2, rel=5e-3)
    assert solution.states[3].min() < -10  # below a circle around (0, 1)


def test_search_finds_the_cheap_side_and_the_polish_its_optimum(
    passing_side: Posed,
) -> None:
    """Scenario passing_side: the best known answer costs 446.7 and cuts the disc
    between its checks, 1/4 s apart; an answer that keeps clear of it costs more."""
    problem, x0, known = passing_side

    def solved(
        seed: int, polish: IpoptOptions | None, repair: bool = False
    ) -> tuple[object, float, float]:
        solution = solve(
            problem,
            x0,
            search=ChaoticPSO(size=20),
            budget=Budget(evaluations=2000),
            polish=polish,
            known=known,
            repair=repair,
            rng=np.random.default_rng(seed),
        )
        plan = solution.plan
        return solution.status, solution.cost, plan.search.cost

    status, cost, search_cost = solved(0, IpoptOptions())
    assert status is SolutionStatus.BROKEN
    assert cost == pytest.approx(446.7, rel=1e-3)
    assert solved(0, IpoptOptions()) == (status, cost, search_cost)
    # Its lanes and cold starts are left out without a polish, and their random numbers.
    _, alone, searched = solved(0, None)
    assert alone == searched
    status, clear, _ = solved(0, IpoptOptions(), repair=True)
    assert status is SolutionStatus.CONVERGED
    assert cost < clear < 1.05 * cost


def test_guess_is_where_the_polish_starts(passing_side: Posed) -> None:
    problem, x0, known = passing_side
    guess = np.zeros((2, 8))
    guess[1, :4] = 0.15, 0.15, -0.1, -0.1
    solution = solve(
        problem,
        x0,
        search=None,
        polish=IpoptOptions(),
        guess=guess,
        known=known,
        repair=False,
        rng=np.random.default_rng(0),
    )
    assert solution.cost == pytest.approx(446.7, rel=1e-3)
    assert solution.plan.source is Source.POLISH


def test_refuses_to_solve_with_nothing(lq: OptimalControlProblem) -> None:
    with pytest.raises(InvalidProblemError, match="a search, a polish or both"):
        solve(lq, [0, 0], search=None, polish=None, rng=np.random.default_rng(0))


def test_a_guess_of_states_leads_the_polish_where_controls_do_not() -> None:
    """Zero controls never move a hanging pendulum: their path is stationary."""
    angle, speed, torque = (ca.SX.sym(name) for name in ("angle", "speed", "torque"))
    problem = OptimalControlProblem(
        Model(
            states=ca.vertcat(angle, speed),
            controls=torque,
            ode=ca.vertcat(speed, torque - 9.81 * ca.sin(angle)),
        ),
        horizon=3.0,
        intervals=50,
        stage_cost=torque**2,
        bounds=Bounds(controls=(-8.0, 8.0)),
        terminal=[ca.vertcat(ca.cos(angle) + 1, speed)],
    )
    controls = np.zeros((1, 50))
    turns = [np.linspace(0, way * np.pi, 51) for way in (1, -1)]
    ends = []
    for turn in turns:
        start = Start(controls, np.stack([turn, np.gradient(turn, 3 / 50)]))
        answer = solve(problem, np.zeros(2), search=None, guess=start, seed=0)
        assert answer.status.is_confirmed
        ends.append(float(answer.states[0, -1]))
    assert ends == pytest.approx([np.pi, -np.pi], abs=1e-3)


def test_ctrl_c_while_an_answer_is_verified_keeps_it(
    swing_up: Callable[..., OptimalControlProblem], monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = solve(swing_up(20, 4), [0, 0], search=None, lanes=0, seed=0)

    def interrupted(*_: object, **__: object) -> Iterator[None]:
        raise KeyboardInterrupt
        yield

    monkeypatch.setattr(solving, "improved", interrupted)
    with pytest.raises(SolveInterrupted) as stopped:
        solve(swing_up(20, 4), [0, 0], search=None, lanes=0, seed=0)
    assert stopped.value.partial.cost == whole.cost
    assert stopped.value.partial.verified_cost == whole.verified_cost
