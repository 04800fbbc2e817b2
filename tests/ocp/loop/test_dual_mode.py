"""Dual mode: the linear law inside, plans outside, the whole team at once."""

from dataclasses import replace
from unittest.mock import Mock

import casadi as ca
import numpy as np
import pytest
from control import ss
from scipy.linalg import expm

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Agent,
    Bounds,
    DualMode,
    InvalidProblemError,
    Mode,
    Model,
    OptimalControlProblem,
    Planner,
    Plant,
    RecedingHorizon,
    Source,
    Team,
    UncertifiedSetError,
    right_hand_side,
    simulate,
    stack_models,
)
from swarmstart.ocp.loop import dual_mode
from swarmstart.terminal_set import (
    ProofOptions,
    Reference,
    TerminalSet,
    Weights,
    certified_terminal_set,
)

DT = 0.5


@pytest.fixture(scope="module")
def terminal_set(double_integrator: Model) -> TerminalSet:
    f = right_hand_side(double_integrator).factory("f", ["x", "u"], ["xdot"])
    reference = Reference(
        x_ref=np.zeros(2),
        u_ref=np.zeros(1),
        u_lower=np.array([-1.0]),
        u_upper=np.array([1.0]),
    )
    weights = Weights(Q=np.eye(2), R=np.eye(1))
    return certified_terminal_set(
        f, reference, weights, dt=DT, rng=np.random.default_rng(0)
    )


@pytest.fixture(scope="module")
def team(double_integrator: Model) -> Team:
    problem = OptimalControlProblem(
        double_integrator,
        horizon=4 * DT,
        intervals=4,
        bounds=Bounds(controls=(-1, 1)),
        substeps=1,
    )
    agents = [
        Agent(controller=RecedingHorizon(planner=Planner(problem, search=None)))
        for _ in range(2)
    ]
    return Team(agents, order=(1, 0))


def moving(time: float) -> Array:
    """A target at 3 m/s, which the double integrator follows without input."""
    return np.array([3 * time, 3.0])


@pytest.fixture(scope="module")
def dual(team: Team, terminal_set: TerminalSet) -> DualMode:
    return DualMode(team, sets=[terminal_set] * 2, targets=[moving, moving])


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.mark.parametrize("seed", range(5))
def test_inside_the_sets_the_linear_law_flies(
    dual: DualMode, terminal_set: TerminalSet, seed: int
) -> None:
    directions = np.random.default_rng(seed).normal(size=(2, 2))
    errors = 0.9 * terminal_set.ellipsoid.boundary(directions)
    state = np.concatenate([moving(2.0) + e for e in errors.T])
    decision = dual.decide(2.0, state, None, rng=rng())
    assert decision.mode is Mode.LINEAR
    assert all(plan.source is Source.LINEAR for plan in decision.plans)
    np.testing.assert_allclose(
        decision.control, (-terminal_set.K @ errors)[0], rtol=1e-12
    )
    # The plan is the closed loop: e+ = (A - B K) e, once an interval.
    A = expm(np.array([[0, DT], [0, 0]]))
    loop = A - np.array([[DT**2 / 2], [DT]]) @ terminal_set.K
    expected = moving(4.0) + np.linalg.matrix_power(loop, 4) @ errors[:, 0]
    np.testing.assert_allclose(decision.plans[0].states[:, -1], expected, atol=1e-12)


def test_one_agent_outside_makes_the_whole_team_plan(
    dual: DualMode, terminal_set: TerminalSet
) -> None:
    outside = 1.01 * terminal_set.ellipsoid.boundary([1.0, 0.0])
    for errors in ((outside, np.zeros(2)), (np.zeros(2), outside)):
        state = np.concatenate([moving(0.0) + e for e in errors])
        decision = dual.decide(0.0, state, None, rng=rng())
        assert decision.mode is Mode.PLANNED
        assert {plan.source for plan in decision.plans} == {Source.COLD}
    inside = np.concatenate([moving(0.0) + 0.98 * outside, moving(0.0)])
    assert dual.inside(0.0, inside)
    assert not dual.inside(1.0, inside)  # the targets have moved on


def test_linear_plan_is_clipped_to_the_bounds(
    team: Team, terminal_set: TerminalSet
) -> None:
    greedy = replace(terminal_set, K=50 * terminal_set.K, alpha=1e6, certificate=None)
    dual = DualMode(team, sets=[greedy] * 2, targets=[moving, moving], uncertified=True)
    state = np.array([5.0, 3, -5, 3])
    decision = dual.decide(0.0, state, None, rng=rng())
    assert decision.mode is Mode.LINEAR
    assert decision.control.tolist() == [-1, 1]
    for plan in decision.plans:
        assert (np.abs(plan.controls) <= 1).all()


def test_lyapunov_function_falls_along_the_flight(
    dual: DualMode, double_integrator: Model, terminal_set: TerminalSet
) -> None:
    """With inputs held for dt the loop is linear: V falls by e'(Q + K'RK)e per step."""
    plant = Plant(stack_models([double_integrator] * 2), dt=DT, substeps=5)
    errors = 0.99 * terminal_set.ellipsoid.boundary(np.array([[1.0, 0], [1, -2]]))
    x0 = np.concatenate([moving(0.0) + e for e in errors.T])
    flown = simulate(plant, dual, x0, steps=8, rng=rng())
    assert {decision.mode for decision in flown.decisions} == {Mode.LINEAR}
    K = terminal_set.K
    for own in (flown.states[:2], flown.states[2:]):
        e = own - np.stack([moving(t) for t in flown.times], axis=1)
        V = terminal_set.value(e)
        stage = np.einsum("in,ij,jn->n", e, np.eye(2) + K.T @ K, e)
        assert (np.diff(V) < 0).all()
        np.testing.assert_allclose(-np.diff(V), stage[:-1], rtol=1e-9, atol=1e-12)


def test_linear_plan_is_the_law_along_its_own_states(pendulum: Model) -> None:
    """A pendulum held at 0.5 rad: u_ref is not zero, and the grid matters."""
    problem = OptimalControlProblem(
        pendulum,
        horizon=2.0,
        intervals=4,
        bounds=Bounds(controls=(-20, 20)),
        substeps=1,
        checks=3,
    )
    x_ref, u_ref = np.array([0.5, 0]), np.array([9.81 * np.sin(0.5)])
    wide = TerminalSet(
        K=np.array([[1.0, 2]]),
        P=np.eye(2),
        alpha=9.0,
        x_ref=x_ref,
        u_ref=u_ref,
        dt=DT,
        design="own",
    )
    controller = RecedingHorizon(planner=Planner(problem, search=None))
    alone = Team([Agent(controller=controller)], order=(0,))
    dual = DualMode(alone, sets=[wide], targets=[lambda _: x_ref], uncertified=True)
    (plan,) = dual.decide(0.0, np.array([1.5, -1]), None, rng=rng()).plans
    errors = plan.states[:, :-1:3] - x_ref[:, None]
    np.testing.assert_allclose(plan.controls, u_ref - wide.K @ errors, rtol=1e-12)


def test_the_law_of_the_first_agent_is_given_unless_another_is_asked_for(
    dual: DualMode, monkeypatch: pytest.MonkeyPatch
) -> None:
    laws = [ss(-1.0, 1, 1, 0), ss(-2.0, 1, 1, 0)]
    sets = [Mock(linear_law=Mock(return_value=law)) for law in laws]
    monkeypatch.setattr(dual, "sets", sets)
    assert dual.linear_law() is dual.linear_law(0) is laws[0]
    assert dual.linear_law(1) is laws[1]


def test_plan_goes_on_from_the_linear_one(
    dual: DualMode, terminal_set: TerminalSet
) -> None:
    error = 0.9 * terminal_set.ellipsoid.boundary([1.0, 1.0])
    linear = dual.decide(0.0, np.tile(moving(0.0) + error, 2), None, rng=rng())
    away = dual.decide(DT, np.tile([100.0, 3.0], 2), linear, rng=rng())
    assert (linear.mode, away.mode) == (Mode.LINEAR, Mode.PLANNED)
    shifted = np.append(linear.plans[0].controls[0, 1:], 0)
    np.testing.assert_array_equal(away.plans[0].controls[0], shifted)


def test_a_controller_alone_is_a_team_of_one_agent(
    team: Team, terminal_set: TerminalSet
) -> None:
    loop = team.agents[0].controller
    dual = DualMode(loop, sets=[terminal_set], targets=[lambda time: np.zeros(2)])
    assert [agent.controller for agent in dual.team.agents] == [loop]
    with pytest.raises(InvalidProblemError, match="or a RecedingHorizon, got Planner"):
        DualMode(loop.planner, sets=[], targets=[])  # type: ignore[arg-type]


def test_refuses_sets_and_targets_that_are_not_one_an_agent(
    team: Team, terminal_set: TerminalSet
) -> None:
    with pytest.raises(InvalidProblemError, match="2 agents, got 1 and 2"):
        DualMode(team, sets=[terminal_set], targets=[moving, moving])
    with pytest.raises(InvalidProblemError, match="2 agents, got 2 and 1"):
        DualMode(team, sets=[terminal_set] * 2, targets=[moving])


def test_refuses_a_set_that_is_not_certified_for_its_hold_and_its_bounds(
    team: Team, terminal_set: TerminalSet
) -> None:
    targets = [moving, moving]
    bare = replace(terminal_set, certificate=None)
    with pytest.raises(UncertifiedSetError, match=r"agent 1 .* 0\.5 s, it has no cert"):
        DualMode(team, sets=[terminal_set, bare], targets=targets)
    assert terminal_set.certificate is not None
    f = terminal_set.certificate.dynamics
    longer = certified_terminal_set(
        f,
        terminal_set.certificate.reference,
        Weights(Q=np.eye(2), R=np.eye(1)),
        dt=2 * DT,
        rng=np.random.default_rng(0),
    )
    with pytest.raises(UncertifiedSetError, match="has a certificate for 1 s"):
        DualMode(team, sets=[longer] * 2, targets=targets)
    wide = replace(
        terminal_set.certificate.reference,
        u_lower=np.array([-1.5]),
        u_upper=np.array([1.5]),
    )
    strong = certified_terminal_set(
        f,
        wide,
        Weights(Q=np.eye(2), R=np.eye(1)),
        dt=DT,
        rng=np.random.default_rng(0),
    )
    with pytest.raises(UncertifiedSetError, match=r"between \[-1\.0\] and \[1\.0\]"):
        DualMode(team, sets=[strong] * 2, targets=targets)
    accepted = DualMode(team, sets=[bare, longer], targets=targets, uncertified=True)
    assert accepted.sets == (bare, longer)


@pytest.mark.parametrize("controls", [(-0.9, 1.0), (-1.0, 0.9)])
def test_refuses_a_law_beyond_either_bound_of_the_controls(
    double_integrator: Model, terminal_set: TerminalSet, controls: tuple[float, float]
) -> None:
    """Its inputs reach from -1 to 1; each bound is checked separately."""
    problem = OptimalControlProblem(
        double_integrator, horizon=2.0, intervals=4, bounds=Bounds(controls=controls)
    )
    controller = RecedingHorizon(planner=Planner(problem, search=None))
    alone = Team([Agent(controller=controller)], order=(0,))
    with pytest.raises(UncertifiedSetError, match="must keep its controls between"):
        DualMode(alone, sets=[terminal_set], targets=[moving])


def test_refuses_a_set_whose_growth_is_measured_only(
    team: Team, terminal_set: TerminalSet
) -> None:
    certificate = terminal_set.certificate
    assert certificate is not None
    measured = certified_terminal_set(
        certificate.dynamics,
        certificate.reference,
        Weights(Q=np.eye(2), R=np.eye(1)),
        dt=DT,
        options=ProofOptions(growth=False),
        rng=np.random.default_rng(0),
    )
    with pytest.raises(UncertifiedSetError, match=r"agent 0 .* growth between samples"):
        DualMode(team, sets=[measured] * 2, targets=[moving, moving])
    taken = DualMode(team, sets=[measured] * 2, targets=[moving] * 2, uncertified=True)
    assert taken.sets == (measured, measured)


def test_refuses_a_certificate_that_was_changed(
    team: Team, terminal_set: TerminalSet
) -> None:
    own = terminal_set.certificate
    assert own is not None and own.held is not None and own.unproven() == []
    larger = replace(own, alpha=2 * own.alpha)
    better = replace(own, held=replace(own.held, growth=1.01))
    unfounded = replace(own, proof=replace(own.proof, proven=False))
    for changed, found in (
        (larger, "e'Pe falls on all of the set; that the inputs stay"),
        (better, "what was changed after it was certified"),
        (unfounded, "that e'Pe falls"),
        (replace(own, seal=""), "what was changed"),
    ):
        forged = replace(terminal_set, alpha=changed.alpha, certificate=changed)
        with pytest.raises(UncertifiedSetError, match=found):
            DualMode(team, sets=[forged] * 2, targets=[moving, moving])


def driven(gain: float) -> ca.Function:
    """x'' = gain u_0 + u_1^2 / 100 - 9.81 sin x, and a state that u_1 alone drives."""
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u", 2)
    push = gain * u[0] + u[1] ** 2 / 100
    xdot = ca.vertcat(x[1], push - 9.81 * ca.sin(x[0]), u[1] - 2)
    return ca.Function("driven", [x, u], [xdot], ["x", "u"], ["xdot"])


@pytest.mark.parametrize("gain", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize(
    ("wanted", "limits"),
    [
        (None, (-np.inf, np.inf)),
        (None, (0.0, np.inf)),  # One bound alone gives no middle.
        (None, (-1.0, 1.0)),  # The input lies on a bound,
        (None, (1.0, 3.0)),  # or on the other one.
        (0.3, (-50.0, 70.0)),
    ],
)
def test_resting_input_is_exact_also_on_a_bound(
    gain: float, wanted: float | None, limits: tuple[float, float]
) -> None:
    """u_1 is 2 and u_0 such that the rest of the torque is zero, or the velocity."""
    angle = float(np.arcsin((gain * (1.0 / gain) + 0.04) / 9.81))
    x_ref = np.array([angle, 0.2, 0.0])
    rate = 0.0 if wanted is None else wanted
    velocity = None if wanted is None else np.array([0.2, wanted, 0.0])
    if wanted is None:
        x_ref[1] = 0.0
    expected = (rate + 9.81 * np.sin(angle) - 0.04) / gain
    lower = np.array([limits[0] / gain, -5.0])
    upper = np.array([limits[1] / gain, 5.0])
    found = dual_mode._resting_input(driven(gain), x_ref, velocity, (lower, upper))
    np.testing.assert_allclose(found, [expected, 2.0], rtol=1e-9)
    assert np.all((lower <= found) & (found <= upper))


def test_input_that_cannot_rest_comes_as_near_as_its_bounds_allow() -> None:
    """The torque would have to be 9.81, of at most 3; the other input is in reach."""
    x_ref = np.array([np.pi / 2, 0.0, 0.0])
    bounds = np.array([-3.0, 1.0]), np.array([3.0, 5.0])
    found = dual_mode._resting_input(driven(1.0), x_ref, None, bounds)
    assert found[0] == pytest.approx(3.0, abs=1e-6)
    # Least squares of 3 + u^2 / 100 - 9.81 and u - 2.
    tried = np.linspace(1, 5, 400_001)
    best = tried[np.argmin((3 + tried**2 / 100 - 9.81) ** 2 + (tried - 2) ** 2)]
    assert found[1] == pytest.approx(best, abs=1e-4)


@pytest.mark.parametrize(
    "values", [[1.0], [1.0, 2.0, 3.0], [[1.0, 2.0]], [1.0, np.nan], [np.inf, 1.0]]
)
def test_vector_of_another_size_or_without_numbers_is_refused(values: object) -> None:
    np.testing.assert_array_equal(dual_mode._vector("at", (1, 2), 2), [1.0, 2.0])
    with pytest.raises(InvalidProblemError, match="at must be 2 finite numbers, got"):
        dual_mode._vector("at", values, 2)  # type: ignore[arg-type]
