"""Problems without controls: what is open are starts, parameters and the end time."""

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss

NONE = ca.SX(0, 1)


def estimation() -> tuple[ss.OptimalControlProblem, ss.Known]:
    """x' = -k x, seen at 21 instants; k and x(0) are to be found."""
    x, k, seen = (ca.SX.sym(name) for name in ("x", "k", "seen"))
    model = ss.Model(states=x, controls=NONE, ode=-k * x, parameters=k)
    problem = ss.OptimalControlProblem(
        model, horizon=2.0, intervals=20, stage_cost=(x - seen) ** 2, signals=seen,
        decided={"k": ss.Free(0.1, 5)}, start={"x": ss.Free(0, 5)},
    )  # fmt: skip
    at = 2 * np.exp(-1.5 * np.linspace(0, 2, 21))
    return problem, ss.Known(signals=at[None])


@pytest.mark.parametrize("more", [{}, {"search": None}, {"lanes": 0}])
def test_default_call_estimates_a_parameter_and_a_start(more: dict[str, int]) -> None:
    problem, known = estimation()
    found = ss.solve(problem, [np.nan], known=known, seed=0, **more)  # type: ignore[arg-type]
    assert found.status is ss.SolutionStatus.CONVERGED
    assert found.decided["k"] == pytest.approx(1.5, rel=1e-3)
    assert found.states[0, 0] == pytest.approx(2.0, rel=5e-3)
    assert "zero controls" not in str(found)
    assert "  controls    none" in str(found)


def thrown(far: float) -> ss.OptimalControlProblem:
    """A stone from the ground, back on it at a distance, with the least energy."""
    p, v = ca.SX.sym("p", 2), ca.SX.sym("v", 2)
    model = ss.Model(
        states=ca.vertcat(p, v), controls=NONE, ode=ca.vertcat(v, 0, -9.81)
    )
    return ss.OptimalControlProblem(
        model, horizon=ss.Free(0.2, 5.0), intervals=10, initial_cost=ca.sumsqr(v),
        terminal=[(p, [far, 0.0])],
        start={"v_0": ss.Free(0.1, 30.0), "v_1": ss.Free(0.0, 30.0)},
    )  # fmt: skip


@pytest.mark.parametrize("more", [{}, {"search": None}])
def test_stone_with_the_least_energy_leaves_at_45_degrees(more: dict[str, int]) -> None:
    found = ss.solve(thrown(10.0), [0, 0, np.nan, np.nan], seed=0, **more)  # type: ignore[arg-type]
    assert found.status is ss.SolutionStatus.CONVERGED
    assert found.cost == pytest.approx(9.81 * 10, rel=1e-6)
    assert found.states[2, 0] == pytest.approx(found.states[3, 0], rel=1e-4)


def test_starts_drawn_from_free_bounds_find_the_basin_that_a_guess_misses() -> None:
    """The frequency of a swing: far from it the misfit has a dozen local optima."""
    x, w, seen = ca.SX.sym("x", 2), ca.SX.sym("w"), ca.SX.sym("seen")
    model = ss.Model(
        states=x, controls=NONE, ode=ca.vertcat(x[1], -(w**2) * x[0]), parameters=w
    )
    problem = ss.OptimalControlProblem(
        model, horizon=6.0, intervals=60, stage_cost=(x[0] - seen) ** 2, signals=seen,
        decided={"w": ss.Free(0.5, 12.0)},
    )  # fmt: skip
    known = ss.Known(signals=np.cos(8.2 * np.linspace(0, 6, 61))[None])
    found = ss.solve(problem, [1.0, 0.0], known=known, search=None, seed=0)
    assert found.decided["w"] == pytest.approx(8.2, rel=1e-2)
    assert found.plan.starts is not None
    assert found.plan.starts.won == "random starts"
    lone = ss.solve(problem, [1.0, 0.0], known=known, search=None, lanes=0, seed=0)
    assert lone.cost > 10 * found.cost


def test_problem_with_nothing_to_decide_is_simulated() -> None:
    x = ca.SX.sym("x")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=NONE, ode=-x), horizon=1.0, intervals=4,
        terminal_cost=x**2,
    )  # fmt: skip
    found = ss.solve(problem, [1.0], seed=0)
    assert found.status.is_confirmed
    assert found.cost == pytest.approx(np.exp(-2), rel=1e-5)
    with pytest.raises(ss.InvalidProblemError, match="needs a decision: a control, or"):
        ss.solve(problem, [1.0], search="lshade", seed=0)
