"""Ensembles, against closed forms, copies in CasADi's Opti and SciPy."""

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarmstart.ocp import (
    AlgebraicEquations,
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
    RecedingHorizon,
    Solution,
    SolutionStatus,
    disc,
    ensemble,
    simulate,
    solve,
)
from swarmstart.ocp.statement.problem import Quadrature
from swarmstart.ocp.statement.risk import Measure

GAINS = [0.5, 1.0, 1.5, 2.0]
N, STEPS = 8, 4


def one(**more: object) -> OptimalControlProblem:
    """A lag of unknown gain k, driven to 1."""
    x, u, k = (ca.SX.sym(n) for n in "xuk")
    stated: dict[str, object] = {
        "horizon": 2.0,
        "intervals": N,
        "stage_cost": (x - 1) ** 2 + 0.1 * u**2,
        "terminal_cost": (x - 1) ** 2,
        "bounds": Bounds(controls=(-3, 3)),
    }
    model = Model(states=x, controls=u, ode=-x + k * u, parameters=k)
    return OptimalControlProblem(model, **(stated | more))  # type: ignore[arg-type]


def opti_cost(risk: str, weights: list[float], level: float) -> float:
    """The same by copies of the lag in CasADi's Opti, multiple shooting and RK4."""
    opti, h = ca.Opti(), 2.0 / N / STEPS
    u, costs = opti.variable(N), []
    for k in GAINS:

        def rate(y: ca.MX, v: ca.MX, k: float = k) -> ca.MX:
            return ca.vertcat(-y[0] + k * v, (y[0] - 1) ** 2 + 0.1 * v**2)

        y = ca.MX(2, 1)
        for i in range(N):
            for _ in range(STEPS):
                k1 = rate(y, u[i])
                k2 = rate(y + h / 2 * k1, u[i])
                k3 = rate(y + h / 2 * k2, u[i])
                k4 = rate(y + h * k3, u[i])
                y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        costs.append(y[1] + (y[0] - 1) ** 2)
    t, e = opti.variable(), opti.variable(len(GAINS))
    J, w = ca.vertcat(*costs), ca.DM(weights) / sum(weights)
    opti.subject_to(opti.bounded(-3, u, 3))
    if risk == "mean":
        opti.minimize(ca.dot(w, J))
        opti.subject_to([t == 0, e == 0])
    elif risk == "worst":
        opti.minimize(t)
        opti.subject_to([t >= J, e == 0])
    else:
        opti.minimize(t + ca.dot(w, e) / (1 - level))
        opti.subject_to([e >= 0, e >= J - t])
    opti.solver("ipopt", {"print_time": False, "ipopt.print_level": 0})
    solution = opti.solve()
    return float(solution.value(opti.f))


def value_at_risk(costs: np.ndarray, weights: np.ndarray, level: float) -> float:
    """CVaR by sorting: the mean of the costliest mass 1 - level."""
    left, total = 1 - level, 0.0
    for cost, weight in sorted(zip(costs, weights, strict=True), reverse=True):
        part = min(weight, left)
        total, left = total + part * cost, left - part
    return total / (1 - level)


@pytest.mark.parametrize("risk", ["mean", "worst", "cvar"])
@pytest.mark.parametrize("backend", ["llvm", "casadi"])
def test_each_risk_has_the_cost_of_copies_in_opti(risk: Measure, backend: str) -> None:
    weights, level = [1.0, 4.0, 3.0, 2.0], 0.75
    problem = ensemble(
        one(), {"k": GAINS}, risk=risk, weights=weights, level=level
    )  # fmt: skip
    expected = opti_cost(risk, weights, level)
    for search, budget in ((None, None), ("default", 3000)):
        answer = solve(
            problem, [0.0], search=search, budget=budget, backend=backend, seed=0
        )
        assert answer.status is SolutionStatus.CONVERGED
        assert answer.cost == pytest.approx(expected, rel=1e-7)
        assert answer.verified_cost == pytest.approx(expected, rel=1e-5)
        normal = np.array(weights) / sum(weights)
        told = {
            "mean": float(normal @ answer.member_costs),
            "worst": float(answer.member_costs.max()),
            "cvar": value_at_risk(answer.member_costs, normal, level),
        }
        assert told[risk] == pytest.approx(answer.cost, rel=1e-12)
        assert "members     4, costs from" in repr(answer)


def static(risk: Measure, level: float = 0.0) -> Solution:
    """x' = k u over 1 s, one interval, cost (x(1) - 1)^2, k = 1 and 2."""
    x, u, k = (ca.SX.sym(n) for n in "xuk")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=k * u, parameters=k),
        horizon=1.0,
        intervals=1,
        terminal_cost=(x - 1) ** 2,
        bounds=Bounds(controls=(-3, 3)),
    )
    values = {"k": [1.0, 2.0]}
    return solve(
        ensemble(problem, values, risk=risk, level=level, weights=[1, 3]),
        [0.0], budget=500, seed=0,
    )  # fmt: skip


def test_control_of_each_risk_is_that_of_its_closed_form() -> None:
    """Costs (u - 1)^2 and (2 u - 1)^2 with weights of one and three quarters.

    The mean is smallest at u = 7 / 13; both are equal at u = 2 / 3. CVaR of level 1/4
    drops mass 1/4 of the cheaper member. At u = 4/7 the first is the costlier, with the
    weight 1/3, and the second has 2/3: u = (1/3 + 4/3) / (1/3 + 8/3) = 5/9.
    """
    assert static("mean").controls[0, 0] == pytest.approx(7 / 13, rel=1e-6)
    assert static("worst").controls[0, 0] == pytest.approx(2 / 3, rel=1e-6)
    assert static("cvar", 0.25).controls[0, 0] == pytest.approx(5 / 9, rel=1e-5)
    assert static("cvar", 0.0).controls[0, 0] == pytest.approx(7 / 13, rel=1e-5)
    assert static("cvar", 0.8).controls[0, 0] == pytest.approx(2 / 3, rel=1e-6)


@pytest.mark.parametrize("risk", ["mean", "worst", "cvar"])
def test_one_member_is_the_plain_problem(risk: Measure) -> None:
    x, u, k = (ca.SX.sym(n) for n in "xuk")
    cost = (x - 1) ** 2 + 0.1 * u**2
    plain = OptimalControlProblem(
        Model(states=x, controls=u, ode=-x + k * u, parameters=k),
        horizon=2.0, intervals=N, stage_cost=cost, bounds=Bounds(controls=(-3, 3)),
    )  # fmt: skip
    many = ensemble(plain, {"k": [1.5]}, risk=risk)
    asked = {"search": "lshade", "budget": 500, "seed": 3}
    alone = solve(plain, [0.0], known=Known([1.5]), **asked)  # type: ignore[arg-type]
    found = solve(many, [0.0], **asked)  # type: ignore[arg-type]
    np.testing.assert_allclose(found.controls, alone.controls, rtol=0, atol=1e-9)
    assert found.cost == pytest.approx(alone.cost, rel=1e-12)
    assert found.member_costs.tolist() == [pytest.approx(alone.cost, rel=1e-12)]


@pytest.mark.parametrize("risk", ["mean", "worst", "cvar"])
def test_constraints_hold_in_every_member(risk: Measure) -> None:
    """The members, simulated by SciPy, keep bounds, path and terminal constraint."""
    base = one()
    x, u = base.model.states, base.model.controls
    limited = replace(
        base,
        bounds=Bounds(controls=(-3, 3), states=(-np.inf, 1.15)),
        constraints=[x**2 + u <= 2.0],
        terminal=[x >= 0.28],
        checks=4,
    )
    answer = solve(ensemble(limited, {"k": GAINS}, risk=risk), [0.0], seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    tightest = []
    for k in GAINS:
        state, high = 0.0, []
        for v in answer.controls[0]:
            ran = solve_ivp(
                lambda _, y, k=k, v=v: -y + k * v, (0, 2 / N), [state],
                rtol=1e-10, atol=1e-12, t_eval=np.linspace(0, 2 / N, 9),
            )  # fmt: skip
            assert (ran.y[0] ** 2 + v <= 2 + 1e-5).all()
            high.append(ran.y[0].max())
            state = float(ran.y[0, -1])
        assert max(high) <= 1.15 + 1e-5
        assert state >= 0.28 - 1e-6
        tightest.append(1.15 - max(high))
    assert min(tightest) < 1e-3  # The bound is active.


def test_members_may_have_starts_of_their_own_and_known_parameters() -> None:
    x, u, k, b = (ca.SX.sym(n) for n in "xukb")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=k * u + b, parameters=ca.vertcat(k, b)),
        horizon=1.0, intervals=2, terminal_cost=x**2, stage_cost=1e-3 * u**2,
        bounds=Bounds(controls=(-3, 3)),
    )  # fmt: skip
    pair = ensemble(problem, [{"k": 1.0}, {"k": 2.0}])
    assert pair.model.np == 1
    answer = solve(pair, [1.0, -1.0], known=Known([0.5]), search=None, seed=0)
    assert answer.states[:, 0].tolist() == [1.0, -1.0]
    # J = ((1.5 + u)^2 + (2 u - 0.5)^2) / 2 + 1e-3 u^2, u constant.
    np.testing.assert_allclose(answer.controls, -0.5 / 5.002, rtol=1e-6)


def discrete(quadrature: Quadrature) -> OptimalControlProblem:
    x, u, k, v = (ca.SX.sym(n) for n in "xukv")
    return OptimalControlProblem(
        Model(states=x, controls=u, next_state=0.9 * x + k * u, parameters=k),
        horizon=5.0, intervals=5, stage_cost=(x - 1) ** 2, previous=v,
        step_cost=0.2 * (u - v) ** 2, terminal_cost=x**2, quadrature=quadrature,
        bounds=Bounds(controls=(-2, 2)),
    )  # fmt: skip


@pytest.mark.parametrize("quadrature", ["integral", "left", "right"])
def test_worst_of_a_discrete_time_model_with_costs_of_moves(
    quadrature: Quadrature,
) -> None:
    answer = solve(
        ensemble(discrete(quadrature), {"k": [0.3, 0.6]}, risk="worst"), [0.0], seed=0
    )
    assert answer.status is SolutionStatus.CONVERGED
    costs = []
    for k in (0.3, 0.6):
        x = before = cost = 0.0
        for u in answer.controls[0]:
            after = 0.9 * x + k * u
            cost += 0.2 * (u - before) ** 2
            cost += ((after if quadrature == "right" else x) - 1) ** 2
            x, before = after, u
        costs.append(cost + x**2)
    np.testing.assert_allclose(answer.member_costs, costs, rtol=1e-9)
    assert answer.cost == pytest.approx(max(costs), rel=1e-9)


def test_free_end_time_and_time_count_in_the_worst_cost() -> None:
    """x' = k u - t from 0 to 1 in every member's cost: T + 10 (x(T) - 1)^2."""
    x, u, k, t = (ca.SX.sym(n) for n in "xukt")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=k * u - t, parameters=k, time=t),
        horizon=Free(0.2, 2.0), intervals=4, stage_cost=ca.SX(1) + 0.1 * u**2 + t,
        terminal_cost=10 * (x - 1) ** 2, bounds=Bounds(controls=(0, 4)),
    )  # fmt: skip
    answer = solve(ensemble(problem, {"k": [1.0, 1.5]}, risk="worst"), [0.0], seed=0)
    T = answer.decided["end time"]
    for gain, told in zip((1.0, 1.5), answer.member_costs, strict=True):
        end = gain * answer.controls[0].mean() * T - T**2 / 2
        spent = T + T**2 / 2 + 0.1 * T * np.square(answer.controls[0]).mean()
        assert told == pytest.approx(spent + 10 * (end - 1) ** 2, rel=1e-9)
    assert answer.status is SolutionStatus.CONVERGED
    assert answer.cost == pytest.approx(answer.member_costs.max(), rel=1e-12)


def test_start_that_is_decided_is_one_for_all_members() -> None:
    problem = replace(one(), start={"x": Free(-1, 1)})
    answer = solve(ensemble(problem, {"k": [0.5, 2.0]}), [np.nan], seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    assert answer.states[0, 0] == answer.states[1, 0]


def test_distances_and_names_are_those_of_each_member() -> None:
    x, u, k = ca.SX.sym("x", 2), ca.SX.sym("u", 2), ca.SX.sym("k")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=k * u, parameters=k),
        horizon=1.0, intervals=3, stage_cost=u.T @ u,
        constraints=[disc(x, centre=[0, 0], radius=0.5, name="tree")],
    )  # fmt: skip
    pair = ensemble(problem, np.array([[1.0, 2.0]]))
    assert [c.name for c in pair.stated] == ["tree_0", "tree_1"]
    assert pair.model.state_names == ("x_0_0", "x_1_0", "x_0_1", "x_1_1")
    first, second = (c.expression for c in pair.stated)
    assert ca.depends_on(first, pair.model.states[:2])
    assert not ca.depends_on(second, pair.model.states[:2])


def test_members_are_drawn_from_the_generator_that_is_given() -> None:
    def drawn(seed: int) -> np.ndarray:
        problem = ensemble(
            one(), lambda rng: {"k": float(rng.uniform(0.5, 2))}, samples=3,
            rng=np.random.default_rng(seed),
        )  # fmt: skip
        x = problem.model.states
        f = ca.Function("f", [x, problem.model.controls], [problem.model.ode])
        return np.array(f(np.zeros(3), 1.0)).ravel()

    rng = np.random.default_rng(5)
    np.testing.assert_array_equal(drawn(5), [rng.uniform(0.5, 2) for _ in range(3)])


def test_ensemble_is_planned_from_one_measured_state_in_closed_loop() -> None:
    """The plant's gain differs from that of every member."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    many = ensemble(one(), {"k": GAINS}, risk="worst")
    planner = Planner(many, search=None, polish=IpoptOptions())
    plant = Plant(
        Model(states=x, controls=u, ode=-x + 1.2 * u), dt=2.0 / N, substeps=10
    )
    loop = RecedingHorizon(planner=planner)
    flight = simulate(plant, loop, [0.0], steps=4, seed=0)
    first = solve(many, [0.0], search=None, seed=0)
    np.testing.assert_allclose(flight.controls[0, 0], first.controls[0, 0])
    assert flight.states[0, -1] > 0.5


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda p: ensemble(p, {"q": [1.0]}), "values of some of k, got 1 row"),
        (lambda p: ensemble(p, {}), "values of some of k, got 0 row"),
        (lambda p: ensemble(p, [{"k": 1.0}, {}]), "value of the same parameters"),
        (lambda p: ensemble(p, {"k": [1.0, np.nan]}), "finite values for each"),
        (lambda p: ensemble(p, {"k": []}), "finite values for each"),
        (lambda p: ensemble(p, {"k": "ab"}), "as many values, numbers"),
        (lambda p: ensemble(p, np.ones((2, 3))), "got 2 row"),
        (lambda p: ensemble(p, {"k": [1, 2]}, weights=[1, 0]), "2 positive numbers"),
        (lambda p: ensemble(p, {"k": [1, 2]}, weights=[1]), "2 positive numbers"),
        (lambda p: ensemble(p, {"k": [1, 2]}, level=1.0), "level must be in"),
        (
            lambda p: ensemble(p, {"k": [1, 2]}, risk="median"),  # type: ignore[arg-type]
            "risk must be",
        ),
        (lambda p: ensemble(p, lambda rng: {"k": 1.0}), "need samples, at least 1"),
        (lambda p: ensemble(ensemble(p, {"k": [1]}), {"k": [1]}), "got an ensemble"),
        (
            lambda p: ensemble(
                replace(p, initial_cost=p.model.states), {"k": [1, 2]}, risk="worst"
            ),
            "'mean' for a problem with an initial cost",
        ),
        (
            lambda p: ensemble(
                replace(p, quadrature="left"), {"k": [1, 2]}, risk="cvar"
            ),
            "more than the controls",
        ),
    ],
)
def test_what_is_no_ensemble_is_refused(
    make: Callable[[OptimalControlProblem], object], message: str
) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        make(one())


def test_each_member_solves_algebraic_equations_of_its_own() -> None:
    x, u, k, z = (ca.SX.sym(n) for n in "xukz")
    drive = AlgebraicEquations(symbols=z, residual=k * z - ca.exp(-z) - x, start=0.0)
    model = Model(states=x, controls=u, ode=u - z, parameters=k, algebraic=drive)
    problem = OptimalControlProblem(
        model, horizon=1.0, intervals=3, stage_cost=z**2 + u**2
    )
    values, x0 = [1.0, 2.0], [0.5]
    apart = [
        Fitness(problem).value(np.ones((1, 3)), x0, Known(parameters=[one]))
        for one in values
    ]
    both = ensemble(problem, {"k": values})
    cost, violation = Fitness(both).value(np.ones((1, 3)), 2 * x0)
    assert cost == pytest.approx(np.mean([one for one, _ in apart]), rel=1e-13)
    assert violation == 0.0
    answer = solve(both, x0, search=None, seed=0)
    assert answer.algebraic_names == ("z_0", "z_1")
    residuals = np.outer(values, np.ones(4)) * answer.algebraic
    residuals -= np.exp(-answer.algebraic) + answer.states
    np.testing.assert_allclose(residuals, 0.0, atol=1e-12)


@pytest.mark.parametrize("risk", ["worst", "cvar"])
@pytest.mark.parametrize("only_end", [False, True])
def test_unit_of_the_cost_changes_nothing(risk: Measure, only_end: bool) -> None:
    controls = []
    for unit in (2.0**-40, 1.0, 2.0**40):
        base = one()
        scaled = replace(
            base,
            stage_cost=ca.SX(0) if only_end else unit * base.stage_cost,
            terminal_cost=unit * base.terminal_cost,
        )
        answer = solve(
            ensemble(scaled, {"k": [0.5, 2.0]}, risk=risk, level=0.4), [0.0],
            search=None, seed=0,
        )  # fmt: skip
        assert answer.status.is_confirmed
        controls.append(answer.controls)
    np.testing.assert_allclose(controls[0], controls[1], rtol=1e-6)
    np.testing.assert_allclose(controls[2], controls[1], rtol=1e-6)


def test_worst_of_maximised_costs_is_the_least() -> None:
    base = one()
    gains = replace(
        base, stage_cost=-base.stage_cost, terminal_cost=-base.terminal_cost,
        maximize=True,
    )  # fmt: skip
    costs, told = (
        solve(ensemble(p, {"k": GAINS}, risk="worst"), [0.0], search=None, seed=0)
        for p in (base, gains)
    )
    assert told.cost == pytest.approx(-costs.cost, rel=1e-9)
    np.testing.assert_allclose(told.member_costs, -costs.member_costs, rtol=1e-6)


def test_soft_constraints_are_refused() -> None:
    base = one()
    soft = PathConstraint(expression=base.model.states, upper=1.0, weight=2.0)
    with pytest.raises(InvalidProblemError, match="without soft constraints"):
        ensemble(replace(base, constraints=[soft]), {"k": GAINS})
