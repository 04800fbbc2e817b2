"""A model is called stiff exactly if the stability function of the steps says so."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.polynomial.polynomial import polyval

from swarmstart.arrays import Array
from swarmstart.ocp import (
    INTEGRATORS,
    Bounds,
    Known,
    Model,
    OptimalControlProblem,
    Planner,
    Solution,
    SolutionStatus,
    Source,
    solve,
    verified,
)
from swarmstart.ocp.rollout import status
from swarmstart.ocp.rollout.path import Tracer
from swarmstart.ocp.rollout.scaling import Sizing
from swarmstart.ocp.rollout.shooting import Shooting
from swarmstart.ocp.rollout.status import FastMode, Found, advice_for, fastest_mode
from swarmstart.tests.ocp import catalyst


def linear(A: list[list[float]], **stated: object) -> OptimalControlProblem:
    """Return x' = A x + u in the first state, over 20 steps of 0.1 s."""
    x, u = ca.SX.sym("x", len(A)), ca.SX.sym("u")
    push = ca.vertcat(u, ca.SX.zeros(len(A) - 1))
    given = {"substeps": 4, "stage_cost": ca.sumsqr(x) + u**2, **stated}
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.DM(A) @ x + push),
        horizon=2.0,
        intervals=5,
        bounds=Bounds(controls=(-1, 1)),
        **given,  # type: ignore[arg-type]
    )


def edge(growth: tuple[float, ...]) -> float:
    """Return the largest real z with |R(-z)| <= 1, from the roots of R = 1 and -1."""
    shifted = [np.array(growth) - np.eye(len(growth))[0] * sign for sign in (1, -1)]
    roots = np.concatenate([np.roots(part[::-1]) for part in shifted])
    real = -roots[np.abs(roots.imag) < 1e-9].real
    return float(real[real > 1e-9].min())


EDGES = {name: edge(m.growth) for name, m in INTEGRATORS.items() if m.growth}


def test_edges_are_the_published_ones() -> None:
    """Hairer and Wanner (1996), IV.2."""
    assert EDGES["rk4"] == pytest.approx(2.7853, abs=1e-4)
    assert EDGES["euler"] == pytest.approx(2)


def found(problem: OptimalControlProblem, controls: Array | None = None,
          x0: Array | None = None) -> FastMode | None:  # fmt: skip
    """Return the mode found along the path of controls, zero by default."""
    start = np.ones(problem.model.nx) if x0 is None else x0
    u = np.zeros((1, problem.intervals)) if controls is None else controls
    nothing, none = np.empty(0), np.empty((0, problem.nodes))
    shooting = Shooting(problem)
    sizes = Sizing(problem)(start, nothing, none)
    path = Tracer(shooting)(u, start, nothing, none, sizes)
    return fastest_mode(shooting, path, start, Known())


def judged(problem: OptimalControlProblem, x0: list[float]) -> Solution:
    planner = Planner(problem, search=None, backend="casadi")
    controls = np.zeros((1, problem.intervals))
    return verified(problem, planner.evaluated(controls, x0, source=Source.GUESS), x0)


@pytest.mark.parametrize(("integrator", "limit"), EDGES.items())
def test_mode_is_named_from_the_edge_of_the_stable_region_on(
    integrator: str, limit: float
) -> None:
    for part, named in ((0.999, False), (1.001, True)):
        mode = found(linear([[-10 * limit * part]], integrator=integrator))
        assert (mode is not None) == named
        if mode is not None:
            assert mode.is_stiff
            assert mode.rate == pytest.approx(10 * limit * part)
            stable = replace(linear([[-10 * limit]], integrator=integrator),
                             substeps=mode.substeps)  # fmt: skip
            assert found(stable) is None


@pytest.mark.parametrize("integrator", EDGES)
def test_growth_is_what_a_step_does(integrator: str) -> None:
    problem = linear([[-7.0]], integrator=integrator, substeps=1)
    u, x0 = np.zeros((1, 5)), [1.0]
    plan = Planner(problem, search=None, backend="casadi").evaluated(
        u, x0, source=Source.GUESS
    )
    one = plan.states[0, 1] / plan.states[0, 0]
    grown = polyval(-7.0 * 0.4, INTEGRATORS[integrator].growth)
    assert grown == pytest.approx(one, rel=1e-13)


def test_growing_swinging_and_slow_modes_are_no_stiffness() -> None:
    assert found(linear([[30.0]])) is None
    assert found(linear([[-3.0]])) is None
    assert found(linear([[0.0, 25.0], [-25.0, 0.0]])) is None
    damped = found(linear([[-1.0, 40.0], [-40.0, -1.0]]))
    assert damped is not None and not damped.is_stiff
    answer = judged(linear([[-1.0, 40.0], [-40.0, -1.0]]), [1, 0])
    assert not answer.status.is_confirmed
    assert answer.advice.startswith("a mode swings at 40 rad/s at 0 s")
    assert "stiff" not in answer.advice


@pytest.mark.parametrize("checks", [1, 2])
def test_fastest_of_all_modes_is_named_with_its_time_and_step(checks: int) -> None:
    """x' = -u x, with five rates over 0.4 s each."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=-u * x), horizon=2.0, intervals=5,
        checks=checks, substeps=4, stage_cost=x**2,
    )  # fmt: skip
    rates = np.array([[200.0, 600.0, 900.0, 700.0, 300.0]])
    mode = found(problem, rates)
    assert mode is not None
    assert mode.rate == 900.0
    assert mode.time == pytest.approx(0.8, abs=0.02)
    told = advice_for(problem, Found(SolutionStatus.MISMATCH, ""), mode)
    assert f"makes steps of {0.1 / checks:.3g} s of rk4 unstable" in told
    assert mode.substeps == np.ceil(900 * 0.4 / checks / 2.5)


def test_implicit_steps_are_never_called_too_long() -> None:
    assert found(linear([[-1e6]], integrator="stiff")) is None


def test_one_stiff_interval_of_many_is_enough() -> None:
    # Fast at u = 0.6 only: 7.5 per second, where 300 substeps allow for 4.2.
    problem = catalyst.problem(integrator="rk4", substeps=300)
    fast, slow = np.array([[0.6]]), np.array([[0.9]])
    once = np.hstack([slow, slow, fast, *[slow] * 7])
    mode = found(problem, once, catalyst.X0)
    assert mode is not None and mode.is_stiff
    assert 400 <= mode.time <= 600
    assert found(problem, np.hstack([slow] * 10), catalyst.X0) is None


def test_edge_of_a_domain_is_no_stiffness() -> None:
    # x' = -sqrt(x) rests after 2 s; its slope -1 / (2 sqrt(x)) has no bound before.
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=-ca.sqrt(x) + u), horizon=1.999, intervals=20
    )
    assert found(problem) is None
    assert found(replace(problem, horizon=2.5)) is None  # Beyond, of the root of < 0.


def test_one_step_with_a_mode_of_any_rate_is_no_stiffness() -> None:
    # The second state decays at 1 / sqrt(x): a million per second at the start only.
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(1, u - x[1] / ca.sqrt(x[0]))),
        horizon=2.0,
        intervals=20,
    )
    assert found(problem, x0=np.array([1e-12, 0.0])) is None


def test_explosion_is_looked_at_where_an_implicit_path_is() -> None:
    # On the slow branch of van der Pol's equation; the explicit path explodes at once.
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    ode = ca.vertcat(x[1], 100 * (1 - x[0] ** 2) * x[1] - x[0] + u)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ode),
        horizon=20.0,
        intervals=10,
        stage_cost=x[0] ** 2 + u**2,
        bounds=Bounds(controls=(-0.1, 0.1)),
    )
    explicit = solve(problem, [2.0, 0.0], budget=200, seed=0)
    assert explicit.status is SolutionStatus.NOT_FINITE
    assert "a mode decays at 300 per second at 0 s" in explicit.advice
    assert "use integrator='stiff'" in explicit.advice
    implicit = replace(problem, integrator="stiff")
    assert solve(implicit, [2.0, 0.0], budget=200, seed=0).status.is_confirmed


def test_advice_of_a_stiff_model_leads_to_a_confirmed_answer() -> None:
    problem = linear([[-1.0, 1.0], [0.0, -900.0]])
    problem = replace(problem, stage_cost=ca.sumsqr(problem.model.states[0]))
    explicit = solve(problem, [1, 1], search=None, backend="casadi", seed=0)
    assert not explicit.status.is_confirmed
    assert explicit.advice == (
        "the model is stiff: a mode decays at 900 per second at 0 s, which makes steps "
        "of 0.1 s of rk4 unstable; use integrator='stiff', or set substeps to at least "
        "144"
    )
    implicit = replace(problem, integrator="stiff")
    confirmed = solve(implicit, [1, 1], search=None, backend="casadi", seed=0)
    assert confirmed.status.is_confirmed
    assert confirmed.advice == ""


def test_signals_of_model_and_costs_are_told_apart() -> None:
    x, u, wind, wanted = (ca.SX.sym(name) for name in ("x", "u", "wind", "wanted"))
    problem = OptimalControlProblem(
        Model(states=x, controls=u, signals=wind, ode=-wind * (x - u)),
        horizon=2.0,
        intervals=4,
        stage_cost=1 + (x - wanted) ** 2,
        bounds=Bounds(controls=(-1, 1)),
        signals=wanted,
    )
    nodes = np.ones(problem.nodes)
    known = Known(signals=np.vstack([300 * nodes, 0.5 * nodes]))
    answer = solve(problem, [1.0], known=known, search=None, backend="casadi", seed=0)
    assert "a mode decays at 300 per second" in answer.advice
    implicit = replace(problem, integrator="stiff")
    answer = solve(implicit, [1.0], known=known, search=None, backend="casadi", seed=0)
    assert answer.status.is_confirmed, answer
    np.testing.assert_allclose(answer.controls, 0.5, atol=1e-2)


def many(substeps: int = 1, **stated: object) -> OptimalControlProblem:
    """x' = -u x over 100 intervals of 1 s, one point each, by Euler's steps."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    given = {"integrator": "euler", "checks": 1, **stated}
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=-u * x), horizon=100.0, intervals=100,
        substeps=substeps, stage_cost=x**2, **given,  # type: ignore[arg-type]
    )  # fmt: skip


def rates_of(fast: int, rate: float) -> Array:
    """Return rates of 1/2, but of another value in some intervals all over."""
    rates = np.full((1, 100), 0.5)
    rates[0, np.linspace(0, 99, fast).astype(int)] = rate
    return rates


@pytest.mark.parametrize(("count", "named"), [(24, False), (25, True)])
def test_a_quarter_of_the_points_makes_a_mode_the_cause(
    count: int, named: bool
) -> None:
    """By a step of 2.001 a mode grows a thousandth only."""
    assert (found(many(), rates_of(count, 2.001)) is not None) == named


@pytest.mark.parametrize(
    ("count", "substeps", "growth", "named"),
    [
        (10, 1, 3.9, False),  # 10 log 3.9 is 13.6,
        (10, 1, 3.99, True),  # 10 log 3.99 is 13.84, and log 10^6 13.82.
        (10, 1, 100.0, True),
        (9, 1, 100.0, False),  # One step counts for log 4 at most.
        (2, 4, 100.0, False),  # In four steps as four times: 8 log 4,
        (3, 4, 100.0, True),  # and 12 log 4, which is 16.6.
    ],
)
def test_growth_by_a_million_makes_a_mode_the_cause(
    count: int, substeps: int, growth: float, named: bool
) -> None:
    """1 - h rate is the factor of a step; h is 1 s over the substeps."""
    rates = rates_of(count, (1 + growth) * substeps)
    mode = found(many(substeps), rates, x0=np.array([1e-280]))
    assert (mode is not None) == named
    if mode is not None:
        assert mode.growth == pytest.approx(np.log(growth))
        assert mode.rate == pytest.approx((1 + growth) * substeps)
        assert mode.substeps == np.ceil((1 + growth) * substeps / 1.4)


def test_steps_between_checks_count_as_many() -> None:
    """Two points in each interval of 1 s: 8 of 200, each for one step."""
    rates = rates_of(4, 2 * 101.0)
    assert found(many(checks=2), rates, x0=np.array([1e-280])) is None
    rates = rates_of(5, 2 * 101.0)
    assert found(many(checks=2), rates, x0=np.array([1e-280])) is not None


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        # A step of 0.1 s by Euler is stable for |1 + z / 10| <= 1.
        ([-20.0], None),
        ([-20.1, 3.0], (20.1, np.log(1.01), 58, True)),
        ([-20.1, -30.0, -25.0], (30.0, np.log(2.0), 86, True)),
        # Circles through 0 and -20: at -1 the edge is sqrt(19).
        ([-1 + 4.35j, -1 - 4.35j], None),
        ([-1 + 4.37j, -1 - 4.37j], (abs(1 + 4.37j), None, 41, False)),
        ([-15.0 + 15j, -15.0 - 15j], (15 * 2**0.5, None, 61, True)),
        ([0.0, 50.0, 50j, -50j], None),  # What does not decay is not too fast.
        ([-1e308], None),  # No number of substeps would do.
    ],
)
def test_fast_mode_is_the_fastest_that_decays_but_grows_in_a_step(
    values: list[complex], expected: tuple[float, float | None, int, bool] | None
) -> None:
    problem = many(40, integrator="euler")
    problem = replace(problem, horizon=400.0)  # Intervals of 4 s in 40 steps.
    mode = status._too_fast(problem, 7.0, np.array(values, dtype=np.complex128))
    if expected is None or mode is None:
        assert mode is None and expected is None
        return
    rate, growth, substeps, is_stiff = expected
    assert (mode.time, mode.substeps, mode.is_stiff) == (7.0, substeps, is_stiff)
    assert mode.rate == pytest.approx(rate)
    if growth is not None:
        assert mode.growth == pytest.approx(growth)


def test_growth_beyond_all_numbers_is_growth() -> None:
    """With rk4, whose R(z) is a sum of terms with both signs: inf - inf."""
    mode = status._too_fast(many(integrator="rk4"), 0.0, np.array([-1e100 + 0j]))
    assert mode is not None and mode.growth > 700.0
    assert mode.substeps == np.ceil(1e100 / 2.5)


def test_substeps_are_advised_up_to_a_thousand() -> None:
    problem = linear([[-1.0]])
    for substeps, told in ((1000, True), (1001, False)):
        mode = FastMode(
            time=0.0, rate=9e4, growth=1.0, substeps=substeps, is_stiff=True
        )
        advice = advice_for(problem, Found(SolutionStatus.MISMATCH, ""), mode)
        assert advice.endswith("use integrator='stiff'") is not told
        assert advice.endswith(f"set substeps to at least {substeps}") is told


def test_first_fast_point_is_named_of_a_path_that_explodes() -> None:
    """Later ones may come from the explosion; the implicit path has them all."""
    rates = np.full((1, 100), 0.5)
    rates[0, 10:80], rates[0, 50] = 1e5, 9e5
    mode = found(many(), rates)
    assert mode is not None
    assert mode.time == 10.0
    assert mode.rate == pytest.approx(1e5)


def test_points_are_those_of_the_path_or_of_an_implicit_one_if_it_explodes() -> None:
    """x' = -u x: with u = 1/2 the path is looked at, with 1e5 the nodes of another."""
    problem, start, known = many(), np.ones(1), Known()
    shooting, nothing, none = Shooting(problem), np.empty(0), np.empty((0, 101))
    sizes = Sizing(problem)(start, nothing, none)
    for rate in (0.5, 1e5):
        rates = np.full((1, 100), 0.5)
        rates[0, 3:] = rate
        path = Tracer(shooting)(rates, start, nothing, none, sizes)
        times, states, controls = status._points(problem, path, start, known)
        if rate == 0.5:
            assert np.isin(times, path.times).all() and times.size == 100
            columns = np.searchsorted(path.times, times)
            np.testing.assert_array_equal(states, path.states[:, columns])
            np.testing.assert_array_equal(controls, path.controls[:, columns])
        else:
            assert not np.isfinite(path.states).all()
            np.testing.assert_array_equal(times, np.arange(100.0))
            np.testing.assert_array_equal(controls, rates)
            np.testing.assert_allclose(
                states[0, :4], np.exp(-np.arange(4) / 2), rtol=1e-4
            )
            assert np.abs(states[0, 4:]).max() < 1e-3
