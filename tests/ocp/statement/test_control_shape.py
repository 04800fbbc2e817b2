"""Controls that are linear between knots, against closed forms, Opti and SciPy."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.cases.record.results import load
from swarmstart.ocp import (
    Agent,
    Bounds,
    Fitness,
    Free,
    InvalidProblemError,
    IpoptOptions,
    Known,
    Model,
    OpenLoop,
    OptimalControlProblem,
    PathConstraint,
    Planner,
    Plant,
    RecedingHorizon,
    SolutionStatus,
    Start,
    Team,
    ensemble,
    phases,
    simulate,
    solve,
)

T, DISTANCE, N = 2.0, 1.5, 5


def cart(**more: object) -> OptimalControlProblem:
    """A double integrator from rest to rest with the least energy."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    stated: dict[str, object] = {
        "horizon": T,
        "intervals": N,
        "stage_cost": u**2,
        "control_shape": "linear",
        "bounds": Bounds(controls=(-9, 9)),
        "terminal": [x - ca.vertcat(DISTANCE, 0)],
    }
    model = Model(states=x, controls=u, ode=ca.vertcat(x[1], u))
    return OptimalControlProblem(model, **(stated | more))  # type: ignore[arg-type]


BEST = 12 * DISTANCE**2 / T**3
"""Of any control: u = 6 d / T^2 (1 - 2 t / T)."""


@pytest.mark.parametrize("search", [None, "default"])
def test_linear_knots_reach_the_least_energy_that_held_controls_miss(
    search: str | None, tmp_path: Path
) -> None:
    answer = solve(cart(), [0, 0], search=search, budget=4000, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    assert answer.cost == pytest.approx(BEST, rel=1e-9)
    best = 6 * DISTANCE / T**2 * (1 - 2 * np.linspace(0, 1, N + 1))
    np.testing.assert_allclose(answer.controls, best[None, :], atol=1e-6)
    assert answer.states.shape == (2, N + 1)
    assert answer.verified_cost == pytest.approx(BEST, rel=1e-9)
    record = load(answer.save(tmp_path / "answer"))
    np.testing.assert_array_equal(record.arrays["controls"], answer.controls)
    held = solve(cart(control_shape="constant"), [0, 0], search=None, seed=0)
    assert held.controls.shape == (1, N)
    assert held.cost == pytest.approx(BEST * N**2 / (N**2 - 1), rel=1e-9)


class Pendulum:
    """A pendulum with a torque, symbolic and numeric, with its constraints."""

    def __init__(self) -> None:
        self.x, self.u = ca.SX.sym("x", 2), ca.SX.sym("u")
        self.wind, self.before = ca.SX.sym("wind"), ca.SX.sym("before")
        self.ode = ca.vertcat(self.x[1], self.u - 5 * ca.sin(self.x[0]) + self.wind)
        self.stage = ca.sumsqr(self.x - ca.vertcat(1, 0)) + 0.1 * self.u**2
        self.signals = np.linspace(0.3, -0.4, 8 * 2 + 1)[None, :]

    def problem(self, **more: object) -> OptimalControlProblem:
        stated: dict[str, object] = {
            "horizon": 1.5,
            "intervals": 8,
            "checks": 2,
            "substeps": 2,
            "stage_cost": self.stage,
            "control_shape": "linear",
            "terminal_cost": ca.sumsqr(self.x),
            "bounds": Bounds(controls=(-3, 3)),
        }
        model = Model(states=self.x, controls=self.u, ode=self.ode, signals=self.wind)
        return OptimalControlProblem(model, **(stated | more))  # type: ignore[arg-type]


P = Pendulum()
MIXED = P.u + P.x[1]
CASES: dict[str, dict[str, Any]] = {
    "plain": {},
    "mixed limit": {"constraints": [MIXED <= 1.2]},
    "soft": {"constraints": [PathConstraint(expression=MIXED, upper=0.8, weight=0.7)]},
    "moving bound": {"bounds": Bounds(controls=(-3, 1.5 + P.wind), search=(-3, 3))},
    "free end time": {"horizon": Free(0.8, 2.5), "stage_cost": P.stage + 0.4},
    "blocks": {"blocks": [1, 1, 2, 4]},
    "left sums": {"quadrature": "left"},
    "right sums": {"quadrature": "right"},
    "moves": {"step_cost": 0.3 * (P.u - P.before) ** 2, "previous": P.before},
    "rate limit": {"constraints": [P.before - P.u <= 0.1], "previous": P.before},
    "continuous": {"control_shape": "continuous"},
}
LIMITS: dict[str, tuple[ca.SX, float]] = {
    "mixed limit": (MIXED, 1.2),
    "soft": (MIXED, 0.8),
    "moving bound": (P.u - P.wind, 1.5),
}
X0, BEFORE = np.array([0.2, 0.0]), 0.4


class ByOpti:
    """A case in CasADi's Opti, with knots as its variables."""

    def __init__(self, name: str) -> None:
        self.name, self.problem = name, P.problem(**CASES[name])
        self.opti, self.cost, K = ca.Opti(), ca.MX(0), self.problem.intervals
        self.knots, self.x = self.opti.variable(1, K + 1), self.opti.variable(2, K + 1)
        self.length: Any = self.problem.horizon
        if isinstance(self.length, Free):
            self.length = self.opti.variable()
            self.opti.set_initial(self.length, 1.5)
            self.opti.subject_to(self.opti.bounded(0.8, self.length, 2.5))
        known = [P.x, P.u, P.wind]
        limit, self.most = LIMITS.get(name, (ca.SX(-1), 0.0))
        self.f = ca.Function("f", known, [P.ode])
        self.stage = ca.Function("stage", known, [self.problem.stage_cost])
        self.watched = ca.Function("watched", known, [limit])

    def solved(self) -> tuple[float, Array]:
        """Return cost and knots."""
        opti, K = self.opti, self.problem.intervals
        opti.subject_to(opti.bounded(-3, self.knots, 3))
        opti.subject_to(self.x[:, 0] == X0)
        if self.name == "continuous":
            opti.subject_to(self.knots[0] == BEFORE)
        for k in range(K):
            self._tie(k)
            self._hold(self._lead(k))
        opti.minimize(self.cost + ca.sumsqr(self.x[:, K]))
        quiet: dict[str, Any] = {"print_time": False, "ipopt.print_level": 0}
        opti.solver("ipopt", {**quiet, "ipopt.sb": "yes", "ipopt.tol": 1e-10})
        answer = opti.solve()
        return float(answer.value(opti.f)), np.array(answer.value(self.knots)).ravel()

    def _tie(self, k: int) -> None:
        """Add the constraints on the knots of an interval alone."""
        begin, end = self.knots[k], self.knots[k + 1]
        if self.name == "blocks" and k in (3, 5, 6, 7):
            self.opti.subject_to(end == begin)
        if self.name == "rate limit":
            self.opti.subject_to(begin - end <= 0.1)
        if self.name == "moves":
            self.cost += 0.3 * (end - begin) ** 2

    def _lead(self, k: int) -> list[ca.MX]:
        """Integrate an interval; return the limited expression at its checks."""
        checks, begin, end = self.problem.checks, self.knots[k], self.knots[k + 1]
        dt, at, spent = self.length / self.problem.intervals, self.x[:, k], ca.MX(0)
        winds = P.signals[0, k * checks : (k + 1) * checks + 1]
        found = [self.watched(at, begin, winds[0])]
        first = dt * self.stage(at, begin, winds[0])
        for c in range(checks):

            def rate(part: float, y: Any, c: int = c) -> tuple[Any, Any]:
                u = begin + (c + part) / checks * (end - begin)
                wind = winds[c] + part * (winds[c + 1] - winds[c])
                return self.f(y, u, wind), self.stage(y, u, wind)

            at, more = rk4_twice(rate, at, dt / checks)
            spent += more
            u = begin + (c + 1) / checks * (end - begin)
            found.append(self.watched(at, u, winds[c + 1]))
        self.opti.subject_to(self.x[:, k + 1] == at)
        last = dt * self.stage(at, end, winds[-1])
        sums = {"left": first, "right": last, "integral": spent}
        self.cost += sums[self.problem.quadrature]
        return found

    def _hold(self, values: list[ca.MX]) -> None:
        """Limit an expression over an interval, at a cost if the limit is soft."""
        excess: Any = 0
        if self.name == "soft":
            excess = self.opti.variable()
            self.opti.subject_to(excess >= 0)
            self.cost += self.length / self.problem.intervals * 0.7 * excess
        if self.name in LIMITS:
            self.opti.subject_to([value - self.most <= excess for value in values])


def rk4_twice(
    rate: Callable[[float, Any], tuple[Any, Any]], x: Any, duration: Any
) -> tuple[Any, Any]:
    """Return state and integrated cost after two Runge-Kutta steps."""
    h, spent = duration / 2, 0
    for part in (0.0, 0.5):
        k1, c1 = rate(part, x)
        k2, c2 = rate(part + 0.25, x + h / 2 * k1)
        k3, c3 = rate(part + 0.25, x + h / 2 * k2)
        k4, c4 = rate(part + 0.5, x + h * k3)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        spent = spent + h / 6 * (c1 + 2 * c2 + 2 * c3 + c4)
    return x, spent


@pytest.mark.parametrize("name", CASES)
def test_answers_are_those_of_opti_with_knots(name: str) -> None:
    known = Known(signals=P.signals, previous=[BEFORE])
    problem = P.problem(**CASES[name])
    answer = solve(problem, X0, known=known, search=None, seed=0)
    cost, knots = ByOpti(name).solved()
    assert answer.status.is_confirmed
    assert answer.cost == pytest.approx(cost, rel=1e-6)
    np.testing.assert_allclose(answer.controls[0], knots, atol=2e-3)


def followed(knots: Array, length: float, x0: Array = X0) -> Array:
    """Return the states that knots lead to, by DOP853."""
    f = ca.Function("f", [P.x, P.u, P.wind], [P.ode])
    at, nodes = np.linspace(0, length, knots.size), np.linspace(0, length, 17)

    def rate(t: float, y: Array) -> Array:
        u, wind = np.interp(t, at, knots), np.interp(t, nodes, P.signals[0])
        return np.array(f(y, u, wind)).ravel()

    found = solve_ivp(
        rate, (0, length), x0, method="DOP853", rtol=1e-10, atol=1e-12, max_step=0.05
    )
    return np.asarray(found.y[:, -1])


def test_knots_lead_where_the_answer_says(tmp_path: Path) -> None:
    known = Known(signals=P.signals)
    answer = solve(P.problem(), X0, known=known, search=None, seed=0)
    end = followed(answer.controls[0], 1.5)
    np.testing.assert_allclose(answer.states[:, -1], end, atol=1e-7)
    table = answer.to_dataframe()
    np.testing.assert_allclose(table["u"].to_numpy()[::2], answer.controls[0])
    middles = (answer.controls[0, 1:] + answer.controls[0, :-1]) / 2
    np.testing.assert_allclose(table["u"].to_numpy()[1::2], middles)


@pytest.mark.parametrize(
    ("shape", "integrator"),
    [("linear", "rk4"), ("continuous", "euler"), ("linear", "stiff")],
)
def test_machine_code_gives_what_casadi_gives(shape: str, integrator: str) -> None:
    problem = P.problem(
        control_shape=shape,
        integrator=integrator,
        intervals=2,
        checks=1,
        **CASES["mixed limit"],
        step_cost=CASES["moves"]["step_cost"],
        previous=P.before,
    )
    planner = Planner(problem, search=None)
    rng = np.random.default_rng(0)
    given = Known(signals=P.signals[:, :3], previous=[0.7])
    start, known, _ = planner.posed(X0, given)
    controls = rng.uniform(-3, 3, (1, 2))
    values = [
        Fitness(problem, backend=backend).value(controls, start, known)
        for backend in ("llvm", "casadi")
    ]
    np.testing.assert_allclose(values[0], values[1], rtol=1e-11)


def test_search_bounds_are_those_of_the_first_knot_too() -> None:
    problem = cart(bounds=Bounds(search=(-6, 6)))
    answer = solve(problem, [0, 0], budget=3000, seed=0)
    assert answer.cost == pytest.approx(BEST, rel=1e-9)
    with pytest.raises(InvalidProblemError, match="finite bounds on every control"):
        solve(cart(bounds=Bounds()), [0, 0], seed=0)


def test_bounds_of_knots_have_their_multipliers() -> None:
    """With |u| <= 2.1 the first and last knots are at their bounds."""
    answer, other = (
        solve(cart(bounds=Bounds(controls=(-most, most))), [0, 0], search=None, seed=0)
        for most in (2.1, 2.1 + 1e-4)
    )
    worth = answer.multipliers
    assert worth is not None
    found = np.abs(worth.controls).sum() + abs(worth.decided["knot of u"])
    assert found == pytest.approx((answer.cost - other.cost) / 1e-4, rel=1e-2)


@pytest.mark.parametrize("knots", [N + 1, N])
def test_guess_is_of_knots_or_of_held_controls(knots: int) -> None:
    planner = Planner(cart(), search=None)
    guess = np.linspace(1, 2, knots)[None, :]
    start, known, first = planner.posed([0, 0], Known(), guess)
    plan = planner.plan(start, known=known, guess=first, rng=np.random.default_rng(0))
    found = planner.lowered.knots(plan.controls, plan.x0)
    np.testing.assert_allclose(found[:, -knots:], guess)
    assert found[0, 0] == 1
    states = np.zeros((2, N + 1))
    _, _, both = planner.posed([0, 0], Known(), Start(guess, states))
    assert isinstance(both, Start) and both.states is not None
    np.testing.assert_allclose(both.states[2], found[0])  # The present u at the nodes.


@pytest.mark.parametrize("given", [np.zeros((1, 3)), np.full((1, N + 1), np.nan)])
def test_other_guesses_are_refused(given: Array) -> None:
    with pytest.raises(InvalidProblemError, match="a guess"):
        solve(cart(), [0, 0], guess=given, search=None, seed=0)


def test_continuous_controls_begin_within_their_bounds() -> None:
    problem = cart(control_shape="continuous")
    for previous in ([9.1], [-10.0]):
        known = Known(previous=previous)
        with pytest.raises(InvalidProblemError, match="must be within the bounds"):
            solve(problem, [0, 0], known=known, search=None, seed=0)
    answer = solve(
        problem, [0, 0], known=Known(previous=[9 + 1e-12]), search=None, seed=0
    )
    assert answer.controls[0, 0] == 9
    assert "linear between knots" in repr(problem)


def flown(loop: RecedingHorizon | OpenLoop, dt: float, steps: int) -> Any:
    model = loop.planner.stated.model if isinstance(loop, RecedingHorizon) else None
    model = model or loop.loop.planner.stated.model  # type: ignore[union-attr]
    return simulate(Plant(model, dt=dt, substeps=4), loop, [0, 0], steps=steps, seed=0)


def test_open_loop_flies_the_lines_to_the_end(tmp_path: Path) -> None:
    planner = Planner(cart(), search=None, polish=IpoptOptions())
    flight = flown(OpenLoop(loop=RecedingHorizon(planner=planner)), T / N, N)
    np.testing.assert_allclose(flight.states[:, -1], [DISTANCE, 0], atol=1e-8)
    again = load(flight.save(tmp_path / "flight")).trajectory
    assert again is not None
    for kept, made in zip(again.decisions, flight.decisions, strict=True):
        assert kept.profile is not None
        np.testing.assert_array_equal(kept.profile.start, made.profile.start)
        np.testing.assert_array_equal(kept.profile.controls, made.profile.controls)


@pytest.mark.parametrize("shape", ["linear", "continuous"])
def test_receding_horizon_flies_the_first_line_of_each_plan(shape: str) -> None:
    problem = cart(control_shape=shape, terminal=[], terminal_cost=ca.SX(0))
    x = problem.model.states
    problem = replace(problem, stage_cost=ca.sumsqr(x - ca.vertcat(1, 0)))
    planner = Planner(problem, search=None, polish=IpoptOptions())
    loop = RecedingHorizon(planner=planner, previous=np.array([0.5]))
    flight = flown(loop, T / N, 6)
    for k, decision in enumerate(flight.decisions):
        (plan,) = decision.plans
        np.testing.assert_allclose(
            flight.states[:, k + 1], plan.states[:2, 1], atol=1e-9
        )
    begins = flight.controls[0]
    ends = np.array([d.profile.controls[0, 0] for d in flight.decisions])
    jumps = np.abs(begins - np.append(0.5, ends[:-1]))
    assert (jumps.max() < 1e-12) == (shape == "continuous")


def test_free_end_time_is_flown_along_lines_to_its_end() -> None:
    problem = cart(horizon=Free(0.01, 4.0), stage_cost=ca.SX(1), intervals=6)
    problem = replace(problem, stage_cost=1 + 0.2 * problem.model.controls**2)
    best = solve(problem, [0, 0], search=None, seed=0)
    planner = Planner(problem, search=None, polish=IpoptOptions())
    loop = RecedingHorizon(planner=planner, period=0.25)
    model = problem.model
    flight = simulate(
        Plant(model, dt=0.25, substeps=60), loop, [0, 0], steps=40, seed=0
    )
    assert flight.decisions[-1].is_last
    np.testing.assert_allclose(flight.states[:, -1], [DISTANCE, 0], atol=1e-3)
    assert flight.times[-1] == pytest.approx(best.decided["end time"], rel=1e-2)


def test_plant_follows_a_line_exactly_and_an_object_holds_its_mean() -> None:
    planner = Planner(cart(), search=None, polish=IpoptOptions())
    loop, seen = RecedingHorizon(planner=planner), []

    class Sampled:
        def step(self, x: Array, u: Array, dt: float) -> Array:
            seen.append(u.copy())
            return x + dt * np.array([x[1] + dt / 2 * u[0], u[0]])

    flight = simulate(Sampled(), loop, [0, 0], steps=2, seed=0)
    ends = [d.profile.controls[:, 0] for d in flight.decisions if d.profile]
    np.testing.assert_allclose(seen, (flight.controls.T + ends) / 2, atol=1e-12)


def test_members_of_an_ensemble_share_the_first_knots_of_their_robust_horizon() -> None:
    x, u, gain = (ca.SX.sym(n) for n in ("x", "u", "gain"))
    one = OptimalControlProblem(
        Model(states=x, controls=u, ode=gain * u - x, parameters=gain),
        horizon=1.0, intervals=4, stage_cost=(x - 1) ** 2 + 0.1 * u**2,
        bounds=Bounds(controls=(-3, 3)), control_shape="linear",
    )  # fmt: skip
    several = ensemble(one, {"gain": [0.5, 2.0]}, robust_horizon=1)
    answer = solve(several, [0.0], search=None, seed=0)
    assert answer.controls.shape == (2, 5)
    shared = answer.controls[0] == answer.controls[1]
    np.testing.assert_array_equal(shared, [True, True, False, False, False])
    apart = ensemble(one, {"gain": [0.5, 2.0]}, robust_horizon=0)
    each = [
        solve(ensemble(one, {"gain": [k]}), [0.0], search=None, seed=0).cost
        for k in (0.5, 2.0)
    ]
    cost = solve(apart, [0.0], search=None, seed=0).cost
    assert cost == pytest.approx(np.mean(each), rel=1e-7)


@pytest.mark.parametrize("r", [None, 1])
def test_left_sums_of_members_have_the_control_at_the_beginning(r: int | None) -> None:
    x, u, gain = (ca.SX.sym(n) for n in ("x", "u", "gain"))
    one = OptimalControlProblem(
        Model(states=x, controls=u, ode=gain * u - x, parameters=gain),
        horizon=1.0, intervals=3, stage_cost=0.1 * u**2, terminal_cost=(x - 1) ** 2,
        bounds=Bounds(controls=(-3, 3)), control_shape="linear", quadrature="left",
    )  # fmt: skip
    several = ensemble(one, {"gain": [0.5, 2.0]}, risk="worst", robust_horizon=r)
    answer = solve(several, [0.0], search=None, seed=0)
    sums = 0.1 / 3 * (answer.controls[:, :-1] ** 2).sum(axis=1)
    ends = (answer.states[:, -1] - 1) ** 2
    np.testing.assert_allclose(answer.member_costs, sums + ends, rtol=1e-5)
    assert answer.cost == pytest.approx((sums + ends).max(), rel=1e-5)
    assert answer.status is SolutionStatus.CONVERGED
    # The NLP minimises the evaluated cost.
    assert answer.plan.point is not None
    w, q = answer.plan.point.w, answer.plan.point.q
    nlp = answer.plan.point.program.nlp
    f = ca.Function("f", [nlp["x"], nlp["p"]], [nlp["f"]])
    told = float(f(w, q)) * answer.plan.point.cost_size
    assert told == pytest.approx(answer.cost, rel=1e-6)


def test_states_of_lines_are_as_large_as_their_controls() -> None:
    for shape in ("linear", "continuous"):
        shooting = Planner(cart(control_shape=shape), search=None).fitness.shooting
        start = shooting.lowered.start([0, 0])
        sizes = shooting.sizing(start, np.empty(0), np.empty((0, N + 1)))
        np.testing.assert_array_equal(sizes.states[2:], [18, 18])


def test_what_cannot_be_linear_is_refused() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    stepped = Model(states=x, controls=u, next_state=0.9 * x + u)
    grid: dict[str, Any] = {"horizon": 1, "intervals": 2, "control_shape": "linear"}
    with pytest.raises(InvalidProblemError, match="discrete-time model"):
        OptimalControlProblem(stepped, **grid)
    with pytest.raises(InvalidProblemError, match="whole numbers are held"):
        cart(bounds=Bounds(controls=(0, 1), integer=[0]))
    with pytest.raises(InvalidProblemError, match="control_shape must be constant or"):
        cart(control_shape="cubic")
    planner = Planner(cart(), search=None)
    with pytest.raises(InvalidProblemError, match="a team and a dual mode use"):
        Team([Agent(controller=RecedingHorizon(planner=planner))], order=[0])
    with pytest.raises(InvalidProblemError, match="no linear controls"):
        phases([cart(), cart()])
