"""Soft constraints: against closed forms, and CasADi's Opti with slacks by hand."""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    Fitness,
    Free,
    InvalidProblemError,
    IpoptOptions,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Planner,
    Plant,
    PolishStatus,
    RecedingHorizon,
    SolutionStatus,
    phases,
    simulate,
    solve,
)
from swarmstart.ocp.answer.repair import at_points, tightened, with_more_checks
from swarmstart.ocp.nlp import transcription
from swarmstart.ocp.nlp.transcription import multiple_shooting
from swarmstart.ocp.rollout.fitness import NOTHING, replay
from swarmstart.ocp.rollout.kinks import kink_sizes, kinks_of, smoothed

BACKENDS = ("llvm", "casadi")


def mass(
    *,
    weight: float | None = 2.0,
    quadratic: float | None = 3.0,
    unit: float = 1.0,
    checks: int = 1,
    limit: float = 0.6,
) -> OptimalControlProblem:
    """A mass that should be at 1 after 2 s, with |speed| and speed + push limited.

    Args:
        weight: Weight of the excess of both rows.
        quadratic: Weight of the squared excess of both rows.
        unit: Unit of length, in metres.
        checks: Number of checks in an interval.
        limit: Limit of the speed, in metres per second.
    """
    z, v = ca.SX.sym("z", 2), ca.SX.sym("v")
    x, u = z * unit, v * unit
    return OptimalControlProblem(
        Model(states=z, controls=v, ode=ca.vertcat(z[1], v)),
        horizon=2.0,
        intervals=10,
        checks=checks,
        stage_cost=u**2 + x[1] ** 2 / 10,
        bounds=Bounds(controls=(-6 / unit, 6 / unit)),
        constraints=[
            PathConstraint(
                expression=ca.vertcat(z[1], z[1] + v / 2),
                lower=[-limit / unit, -np.inf],
                upper=[limit / unit, 1.0 / unit],
                weight=None if weight is None else weight * unit,
                quadratic_weight=None if quadratic is None else quadratic * unit**2,
                name="gently",
            )
        ],
        terminal=[(z, [1.0 / unit, 0.0])],
    )


def by_opti(weight: float, quadratic: float, checks: int) -> float:
    """The same by multiple shooting in CasADi's Opti, with a slack by hand."""
    opti, N = ca.Opti(), 10
    x, u, e = opti.variable(2, N + 1), opti.variable(1, N), opti.variable(2, N)
    dt, cost = 2.0 / N, ca.MX(0)
    for k in range(N):
        at = x[:, k]
        points = [at]
        for _ in range(checks):  # Exact: the push is held.
            h = dt / checks
            cost += (
                h * u[k] ** 2
                + (h * at[1] ** 2 + h**2 * at[1] * u[k] + h**3 * u[k] ** 2 / 3) / 10
            )
            at = ca.vertcat(at[0] + h * at[1] + h**2 / 2 * u[k], at[1] + h * u[k])
            points.append(at)
        opti.subject_to(x[:, k + 1] == at)
        for point in points:
            opti.subject_to(point[1] - e[0, k] <= 0.6)
            opti.subject_to(-0.6 <= point[1] + e[0, k])
            opti.subject_to(point[1] + u[k] / 2 - e[1, k] <= 1.0)
        opti.subject_to(e[:, k] >= 0)
        cost += dt * (weight * ca.sum1(e[:, k]) + quadratic * ca.sumsqr(e[:, k]))
    opti.subject_to(x[:, 0] == 0)
    opti.subject_to(x[:, -1] == ca.vertcat(1, 0))
    opti.subject_to(opti.bounded(-6, u, 6))
    opti.minimize(cost)
    opti.solver("ipopt", {"print_time": False, "ipopt.print_level": 0})
    return float(opti.solve().value(cost))


@pytest.mark.parametrize("checks", [1, 3])
@pytest.mark.parametrize(("weight", "quadratic"), [(2.0, 3.0), (1.0, 0.0), (0.0, 9.0)])
def test_cost_is_that_of_slacks_by_hand_in_opti(
    weight: float, quadratic: float, checks: int
) -> None:
    expected = by_opti(weight, quadratic, checks)
    problem = mass(weight=weight, quadratic=quadratic, checks=checks)
    answer = solve(problem, [0, 0], search=None, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    assert answer.cost == pytest.approx(expected, rel=1e-6)
    assert answer.violation < 1e-12 and answer.verified_violation < 1e-9
    assert answer.verified_cost == pytest.approx(answer.cost, rel=1e-6)
    assert answer.states[1].max() > 0.61  # It is broken.


@pytest.mark.parametrize("backend", BACKENDS)
def test_search_sees_the_excess_that_the_polish_pays_for(backend: str) -> None:
    answer = solve(
        mass(), [0, 0], search="lshade", budget=4000, seed=0, backend=backend
    )
    assert answer.status is SolutionStatus.CONVERGED
    assert answer.cost == pytest.approx(by_opti(2.0, 3.0, 1), rel=1e-6)
    assert answer.plan.search.cost >= answer.cost - 1e-6


def test_cost_of_a_rollout_is_that_of_its_excesses_by_hand() -> None:
    problem, rng = mass(checks=2), np.random.default_rng(3)
    fitness = Fitness(problem)
    for _ in range(5):
        u = rng.uniform(-6, 6, (1, 10))
        (x, v, cost), dt = (0.0, 0.0, 0.0), 0.2
        for k in range(10):
            speeds = np.array([v, v + dt / 2 * u[0, k], v + dt * u[0, k]])
            e = np.array([
                max(0, *(np.abs(speeds) - 0.6)), max(0, *(speeds + u[0, k] / 2 - 1)),
            ])  # fmt: skip
            cost += dt * (2 * e.sum() + 3 * (e**2).sum() + u[0, k] ** 2)
            cost += (dt * v**2 + dt**2 * v * u[0, k] + dt**3 * u[0, k] ** 2 / 3) / 10
            x, v = x + dt * v + dt**2 / 2 * u[0, k], v + dt * u[0, k]
        assert fitness.value(u, [0, 0])[0] == pytest.approx(cost, rel=1e-12)
        assert replay(problem, u, [0, 0])[1] == pytest.approx(cost, rel=1e-12)


@pytest.mark.parametrize("unit", [1e-3, 1e4])
def test_other_units_of_length_change_nothing(unit: float) -> None:
    answer = solve(mass(unit=unit), [0, 0], search=None, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    assert answer.cost == pytest.approx(by_opti(2.0, 3.0, 1), rel=1e-6)


def test_large_weights_keep_a_limit_exactly_and_small_ones_its_price() -> None:
    """The penalty is exact above the multiplier of the limit (Kerrigan, 2000)."""
    problem = mass(weight=1e3, quadratic=None, limit=0.65)
    stated = replace(problem.soft[0], weight=None, quadratic_weight=None)
    hard = replace(problem, constraints=[stated])
    kept = solve(hard, [0, 0], search=None, seed=0)
    exact = solve(problem, [0, 0], search=None, seed=0)
    assert exact.cost == pytest.approx(kept.cost, rel=1e-6)
    np.testing.assert_allclose(exact.controls, kept.controls, atol=1e-4)
    cheap = solve(mass(weight=1.0, quadratic=None), [0, 0], search=None, seed=0)
    assert cheap.multipliers is not None
    prices = cheap.multipliers.path["gently"]
    assert prices.max() == pytest.approx(0.2 * 1.0, rel=1e-5)  # dt times the weight.


def test_constraint_that_cannot_be_kept_has_the_least_excess() -> None:
    """From 3 with |u| <= 1 the state is above 1 for 2 s: e is 3 - t at each start."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=4.0,
        intervals=8,
        bounds=Bounds(controls=(-1, 1)),
        constraints=[PathConstraint(expression=x, upper=1.0, weight=5.0)],
    )
    for search in (None, "default"):
        answer = solve(problem, [3.0], search=search, budget=4000, seed=0)
        assert answer.status.is_confirmed
        assert answer.plan.start_excess == 0.0
        excess = sum(2.0 - k * 0.5 for k in range(4))
        assert answer.cost == pytest.approx(0.5 * 5 * excess, rel=1e-5)
        assert answer.verified_cost == pytest.approx(answer.cost, rel=1e-6)


def test_soft_equality_is_paid_for_on_both_sides() -> None:
    """u is held near sin t: the absolute deviation counts."""
    x, u, s = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("s")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0,
        intervals=4,
        stage_cost=u**2 / 100,
        constraints=[
            PathConstraint(expression=u - s, lower=0, upper=0, quadratic_weight=1.0)
        ],
        signals=s,
    )
    s_nodes = np.array([[1.0, 3.0, -1.0, 0.0, 0.0]])
    answer = solve(problem, [0.0], search=None, known=Known(signals=s_nodes), seed=0)
    middles = (s_nodes[0, 1:] + s_nodes[0, :-1]) / 2
    widths = np.abs(np.diff(s_nodes[0])) / 2

    def best(middle: float, width: float) -> float:
        tried = np.linspace(-4, 4, 80_001)
        costs = tried**2 / 100 + (np.abs(tried - middle) + width) ** 2
        return float(costs.min()) / 4

    assert answer.cost == pytest.approx(sum(map(best, middles, widths)), rel=1e-6)


def test_free_end_time_pays_for_the_time_that_a_limit_is_broken() -> None:
    """Held at 2 above a limit of 1 for T: cost T (1 + 3 (2 - 1)) + 1 / T."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.SX(0) * u),
        horizon=Free(0.1, 5.0),
        intervals=4,
        stage_cost=1 + u**2,
        constraints=[PathConstraint(expression=x, upper=1.0, weight=3.0)],
        bounds=Bounds(controls=(-1, 1)),
    )
    answer = solve(problem, [2.0], search=None, seed=0)
    assert answer.decided["end time"] == pytest.approx(0.1, rel=1e-6)
    assert answer.cost == pytest.approx(0.4, rel=1e-6)
    fixed = replace(problem, horizon=0.1)
    assert solve(fixed, [2.0], search=None, seed=0).cost == pytest.approx(0.4)


def test_discrete_time_model_pays_for_what_its_steps_leave() -> None:
    """x+ = x + u from 0: above 1 by 1 and 2 at the end of the second and the third."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, next_state=x + u),
        horizon=3.0,
        intervals=3,
        bounds=Bounds(controls=(-2, 2)),
        constraints=[PathConstraint(expression=x, upper=1.0, weight=1.0)],
        terminal=[(x, 3.0)],
    )
    cost, _ = Fitness(problem).value(np.array([[1.0, 1.0, 1.0]]), [0.0])
    assert cost == pytest.approx(0 + 1 + 2)
    answer = solve(problem, [0.0], search=None, seed=0)
    assert answer.cost == pytest.approx(2.0, abs=1e-6)  # 0, 1, then 3 in one step.
    assert answer.verified_cost == pytest.approx(answer.cost, rel=1e-9)


def test_gain_is_made_less_by_what_is_broken() -> None:
    problem = mass()
    cost = solve(problem, [0, 0], search=None, seed=0)
    gain = replace(problem, stage_cost=-problem.stage_cost, maximize=True)
    answer = solve(gain, [0, 0], search=None, seed=0)
    assert answer.cost == pytest.approx(-cost.cost, rel=1e-9)
    np.testing.assert_allclose(answer.controls, cost.controls, atol=1e-6)


def test_weight_may_be_a_parameter() -> None:
    x, u, w = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("w")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u, parameters=w),
        horizon=1.0,
        intervals=2,
        stage_cost=u**2,
        constraints=[PathConstraint(expression=u, lower=1.0, quadratic_weight=w)],
    )
    for weight in (0.5, 4.0):
        known = Known(parameters=[weight])
        answer = solve(problem, [0.0], search=None, known=known, seed=0)
        best = weight / (1 + weight)  # Least of u^2 + w (1 - u)^2.
        assert answer.controls == pytest.approx(np.full((1, 2), best), rel=1e-6)


def test_flight_outside_a_soft_limit_goes_on(double_integrator: Model) -> None:
    """The closed loop starts outside, from which a hard limit allows no plan."""
    x, u = double_integrator.states, double_integrator.controls
    problem = OptimalControlProblem(
        double_integrator,
        horizon=2.0,
        intervals=8,
        stage_cost=u**2 + ca.sumsqr(x) / 10,
        bounds=Bounds(controls=(-2, 2)),
        constraints=[PathConstraint(expression=x[0], upper=1.0, weight=50.0)],
    )
    planner = Planner(problem, search=None, polish=IpoptOptions())
    flight = simulate(
        Plant(double_integrator, dt=problem.dt, substeps=1),
        RecedingHorizon(planner=planner),
        [1.5, 0.5],
        steps=10,
        seed=0,
    )
    plans = [decision.plans[0] for decision in flight.decisions]
    assert all(plan.feasible for plan in plans)
    assert all(p.polish_status is PolishStatus.CONVERGED for p in plans)
    assert flight.states[0].max() > 1.5 and flight.states[0, -1] < 1.0 + 1e-6


def test_what_is_not_finite_is_no_plan() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0,
        intervals=2,
        bounds=Bounds(controls=(-5, 5)),
        constraints=[PathConstraint(expression=ca.log(x), upper=1.0, weight=1.0)],
    )
    for backend in BACKENDS:
        fitness = Fitness(problem, backend=backend)
        assert fitness.value(np.array([[-4.0, 4.0]]), [1.0])[1] == np.inf
        assert fitness.value(np.array([[0.0, 0.0]]), [1.0]) == (0.0, 0.0)


def test_problem_without_soft_constraints_has_no_slacks(
    lq: OptimalControlProblem,
) -> None:
    program = multiple_shooting(lq)
    assert program.nlp["x"].numel() == 10 * 3
    assert lq.slacks == 0 and not lq.soft


def test_problems_made_of_a_problem_keep_what_is_soft() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    soft = PathConstraint(expression=ca.fabs(x), upper=1.0, weight=2.0)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0,
        intervals=2,
        constraints=[soft, u <= 3, PathConstraint(expression=x, upper=9)],
    )
    (name,) = kinks_of(problem).names
    assert name == "fabs(x)"
    for other in (
        tightened(problem, []),
        at_points(problem),
        with_more_checks(problem, NOTHING, 2)[0],
        smoothed(problem, kink_sizes(problem, [0.5], NOTHING), 0.1),
    ):
        assert len(other.stated) == 2
        (kept,) = other.soft
        assert float(kept.weights[0]) == 2.0
    assert not kinks_of(other).names


def test_previous_controls_and_time_may_be_limited_softly() -> None:
    """A change of the control by 2 if 1 + 5 t is free, at dt = 0.1 each."""
    x, u, u_before, t = (ca.SX.sym(n) for n in ("x", "u", "u before", "t"))
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u, time=t),
        horizon=0.3,
        intervals=3,
        constraints=[
            PathConstraint(expression=u - u_before - 5 * t, upper=1.0, weight=10.0)
        ],
        previous=u_before,
    )
    planner = Planner(problem, search=None)
    x0, known, _ = planner.posed([0.0], Known(previous=[0.0]))
    cost, _ = planner.fitness.value(np.array([[2.0, 4.0, 6.0]]), x0, known)
    # At each start: 2 - 1, 2 - 1.5, 2 - 2.
    assert cost == pytest.approx(0.1 * 10 * (1 + 0.5 + 0))


def test_problem_tells_what_is_soft() -> None:
    problem = mass()
    assert "soft constraints: gently" in repr(problem)
    assert not problem.path_constraints and problem.slacks == 2


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"weight": -1.0}, "weight must be at least 0 and finite, got -1"),
        ({"weight": np.inf}, "weight must be at least 0 and finite, got inf"),
        ({"weight": np.nan}, "weight must not be NaN, got nan"),
        ({"quadratic_weight": [1, 2, 3]}, "quadratic_weight must be one or 2"),
        ({"weight": 1, "upper": np.inf}, "a limit in every row"),
        ({"weight": 1, "upper": [1.0, np.inf]}, "a limit in every row"),
        ({"weight": 1, "measure": "indicator"}, "the measure 'excess'"),
    ],
)
def test_refuses_weights_that_are_none(given: dict[str, object], said: str) -> None:
    stated = {"expression": ca.SX.sym("x", 2), "upper": 1.0, **given}
    with pytest.raises(InvalidProblemError, match=said):
        PathConstraint(**stated)  # type: ignore[arg-type]


def test_weights_and_limits_in_mx_are_those_in_sx() -> None:
    costs = []
    kinds: tuple[Any, ...] = (ca.SX, ca.MX)
    for kind in kinds:
        x, u, w = kind.sym("x"), kind.sym("u"), kind.sym("w")
        problem = OptimalControlProblem(
            Model(states=x, controls=u, ode=u, parameters=w),
            horizon=1.0,
            intervals=2,
            stage_cost=u**2,
            bounds=Bounds(controls=(-w, 5)),
            constraints=[
                PathConstraint(
                    expression=u - x, lower=1.0, weight=0.1, quadratic_weight=w
                )
            ],
        )
        known = Known(parameters=[2.0])
        costs.append(Fitness(problem).value(np.array([[0.1, -3.0]]), [0.0], known))
    assert costs[0] == costs[1]
    assert costs[0][1] > 0.1  # The moving bound is broken.


def test_phases_take_gains_and_refuse_soft_constraints() -> None:
    problem = mass()
    with pytest.raises(InvalidProblemError, match="no soft constraints, phase 1 has"):
        phases([problem, problem])
    cost = replace(problem, constraints=[])
    gain = replace(cost, stage_cost=-cost.stage_cost, maximize=True)
    with pytest.raises(
        InvalidProblemError, match="no other maximize than phase 1, phase 2"
    ):
        phases([cost, gain])
    found = []
    for one in (cost, gain):
        both = phases([replace(one, terminal=[]), one])
        start = both.start([0.0, 0.0])
        found.append(solve(both.problem, start, search=None, seed=0).cost)
    assert found[1] == pytest.approx(-found[0], rel=1e-6)


def test_refuses_a_weight_of_controls() -> None:
    problem = mass()
    u = problem.model.controls
    with pytest.raises(InvalidProblemError, match="a weight"):
        replace(
            problem,
            constraints=[PathConstraint(expression=u, upper=1.0, weight=u**2)],
        )


def test_long_horizons_whose_program_is_not_written_out_agree(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(transcription, "_UNROLLED", 0)
    answer = solve(mass(checks=2), [0, 0], search=None, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    assert answer.cost == pytest.approx(by_opti(2.0, 3.0, 2), rel=1e-6)


def test_guess_of_the_polish_has_the_excesses_of_its_path() -> None:
    """From an answer the solver only needs to confirm it."""
    problem = mass()
    planner = Planner(problem, search=None, polish=IpoptOptions())
    rng = np.random.default_rng(0)
    first = planner.plan([0.0, 0.0], rng=rng)
    again = planner.plan([0.0, 0.0], guess=first.controls, near=True, rng=rng)
    assert again.cost == pytest.approx(first.cost, rel=1e-7)
    fitness, program = planner.fitness, multiple_shooting(problem)
    sizes = fitness.arguments.sizes_along(
        first.controls, first.states, [0.0, 0.0], NOTHING
    )
    q = program.arguments(np.zeros(2), np.empty(0), np.empty(0), sizes)
    w = program.variables(first.controls, first.states, sizes)
    w = program.with_slacks(w, q, program.limits(sizes))
    f, _ = program.derivatives["grad_f"](w, q)
    assert float(f) * sizes.cost == pytest.approx(first.cost, rel=1e-9)


def test_other_units_of_cost_change_nothing() -> None:
    problem, unit = mass(), 2.0**30
    (soft,) = problem.soft
    linear, quadratic = (unit * weight for weight in soft.weights)
    scaled = replace(
        problem,
        stage_cost=unit * problem.stage_cost,
        constraints=[replace(soft, weight=linear, quadratic_weight=quadratic)],
    )
    answer = solve(scaled, [0, 0], search=None, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    assert answer.cost == pytest.approx(unit * by_opti(2.0, 3.0, 1), rel=1e-6)
