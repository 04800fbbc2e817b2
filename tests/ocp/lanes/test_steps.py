"""An interval for each step: the same trajectories, costs and optima."""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.ocp import (
    Bounds,
    Free,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Planner,
)
from swarmstart.ocp.lanes import solver as module
from swarmstart.ocp.lanes.answers import LaneAnswers, reached
from swarmstart.ocp.lanes.posed import NoLanesError
from swarmstart.ocp.lanes.solver import LaneSolver, random_starts
from swarmstart.ocp.lanes.steps import Steps, are_short, is_divisible, stepwise
from swarmstart.ocp.rollout.fitness import Known, replay
from swarmstart.ocp.rollout.shooting import shooting_of

X0 = [0.3, -0.2]


def tracking(checks: int = 2, substeps: int = 3) -> OptimalControlProblem:
    """Return a pendulum with two controls, a parameter, a target that moves, a limit.

    There is wind, which the model has as a signal; the speed at the start is decided.
    """
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 2)
    k, wind, target = (ca.SX.sym(name) for name in ("k", "wind", "target"))
    return OptimalControlProblem(
        Model(
            states=x, controls=u, parameters=k, signals=wind,
            ode=ca.vertcat(x[1], wind - k * ca.sin(x[0]) + u[0] + u[0] * u[1] / 5),
            state_names=("angle", "speed"), control_names=("push", "pull"),
        ),
        horizon=2.0, intervals=4, checks=checks, substeps=substeps,
        stage_cost=(x[0] - target) ** 2 + ca.sumsqr(u) / 10, terminal_cost=x[1] ** 2,
        bounds=Bounds(controls=([-2, -1], [3, 1]), states=([-9, -2], [9, 2])),
        constraints=[PathConstraint(expression=x[0] + u[1], upper=1.5)],
        signals=target, start={"speed": Free(-0.5, 0.5)},
    )  # fmt: skip


def known_of(problem: OptimalControlProblem, rng: np.random.Generator) -> Known:
    """Return a parameter, and the wind and the target at the nodes."""
    return Known([1.7], rng.uniform(-1, 1, (2, problem.nodes)))


def drawn(steps: Steps, seed: int) -> tuple[np.ndarray, np.ndarray, Known]:
    """Return controls, initial state and known data of the whole problem."""
    rng = np.random.default_rng(seed)
    controls, starts = random_starts(steps.whole, 1, rng)
    return controls, np.array([X0[0], starts[0, 0]]), known_of(steps.whole, rng)


@settings(max_examples=20)
@given(checks=st.integers(1, 3), substeps=st.integers(1, 4), seed=st.integers(0, 99))
def test_trajectory_and_cost_are_those_of_the_whole_intervals(
    checks: int, substeps: int, seed: int
) -> None:
    steps = stepwise(tracking(checks, substeps))
    controls, x0, known = drawn(steps, seed)
    states, cost, _ = replay(steps.whole, controls[..., 0], x0, known)
    first = np.append(x0, controls[:, 0, 0])
    own = replay(
        steps.problem, steps.controls(controls)[..., 0], first, steps.known(known)
    )
    np.testing.assert_allclose(own[0][:2, ::substeps], states, atol=1e-12)
    assert own[1] == pytest.approx(cost, rel=1e-12)
    # What is held changes where an interval begins only.
    held = own[0][2:, :-1].reshape(2, 4, steps.each)
    np.testing.assert_array_equal(held, np.repeat(controls, steps.each, axis=2))


def test_limits_are_kept_at_the_checks_at_least() -> None:
    steps = stepwise(tracking())
    rng = np.random.default_rng(5)
    for seed in range(20):
        controls, x0, known = drawn(steps, seed)
        controls *= rng.uniform(0.2, 1.0)
        worst = replay(steps.whole, controls[..., 0], x0, known)[2]
        first = np.append(x0, controls[:, 0, 0])
        own = replay(
            steps.problem, steps.controls(controls)[..., 0], first, steps.known(known)
        )[2]
        assert own >= worst - 1e-12


def test_what_is_held_has_the_size_of_its_control() -> None:
    given = replace(tracking(), scales={"pull": 0.3})
    assert stepwise(given).problem.scales == {
        "pull": 0.3, "push held": 5.0, "pull held": 0.3
    }  # fmt: skip


def test_ways_there_and_back_are_inverse() -> None:
    steps = stepwise(tracking())
    rng = np.random.default_rng(1)
    controls, starts = random_starts(steps.whole, 3, rng)
    states = rng.normal(size=(2, 5, 3))
    answers = LaneAnswers(
        controls=steps.controls(controls),
        starts=steps.starts(controls, starts),
        states=steps.states(controls, states),
        cost=np.zeros(3), violation=np.zeros(3), iterations=np.zeros(3, dtype=np.int64),
        costates=np.arange(12.0).reshape(4, 3),
    )  # fmt: skip
    found = steps.back(answers)
    np.testing.assert_array_equal(found.controls, controls)
    np.testing.assert_array_equal(found.starts, starts)
    np.testing.assert_allclose(found.states, states, rtol=1e-14)
    np.testing.assert_array_equal(found.costates, [[0, 1, 2], [3, 4, 5]])
    # Within an interval the guess is linear, and the control is held.
    np.testing.assert_allclose(answers.states[:2, 3], states[:, :2].mean(axis=1))
    np.testing.assert_array_equal(answers.states[2:, 5], controls[:, 0])
    np.testing.assert_array_equal(answers.states[2:, 6], controls[:, 1])


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("with_states", [False, True])
def test_lanes_with_long_intervals_find_the_optima_of_whole_ones(
    monkeypatch: pytest.MonkeyPatch, *, with_states: bool
) -> None:
    problem = replace(tracking(checks=1, substeps=4), constraints=())
    core = Planner(problem, search=None).problem
    rng = np.random.default_rng(3)
    known = known_of(core, rng)
    controls, starts = random_starts(core, 8, rng)
    states = rng.normal(size=(2, 5, 8)) if with_states else None
    if states is not None:
        states[:, 0] = X0[0]
    whole = LaneSolver(core)
    expected = whole(X0, controls, starts, states, known=known)
    kernels = whole._lanes.kernels()
    most = max(kernel.code.instructions for kernel in kernels)
    monkeypatch.setattr(module, "_LONGEST", most - 1)
    divided = LaneSolver(core)
    assert whole._steps is None
    assert divided._steps is not None
    assert divided.problem is core
    found = divided(X0, controls, starts, states, known=known)
    for answers in (expected, found):
        assert reached(answers).all()
        assert answers.optimal.all()
    np.testing.assert_allclose(found.cost, expected.cost, rtol=1e-6)
    np.testing.assert_allclose(found.controls, expected.controls, atol=1e-4)
    np.testing.assert_allclose(found.starts, expected.starts, atol=1e-4)
    first, own = (
        one.optima(answers, X0, known)[0]
        for one, answers in ((whole, expected), (divided, found))
    )
    np.testing.assert_allclose(own.states, first.states, atol=1e-4)
    if with_states:  # They are what the lanes begin with.
        others = divided(X0, controls, starts, known=known)
        assert (others.iterations != found.iterations).any()
    # An iteration is counted in roll-outs of the same steps.
    ratio = divided.rollouts_per_iteration / whole.rollouts_per_iteration
    assert 0.2 < ratio < 5


@pytest.mark.usefixtures("compiler")
def test_a_step_that_is_too_long_itself_has_no_lanes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "_LONGEST", 500)
    with pytest.raises(NoLanesError, match="too long: expected at most"):
        LaneSolver(Planner(tracking(), search=None).problem)


def test_steps_that_must_be_too_long_are_refused_before_they_are_built() -> None:
    shooting = shooting_of(Planner(tracking(), search=None).problem)
    assert are_short(shooting, 30_000)
    assert not are_short(shooting, 100)
    # A step of six is refused as soon as it alone is, and no interval that is short.
    step = shooting.stage_without_path.n_instructions() / 6
    assert are_short(shooting, int(14 * step))
    assert not are_short(shooting, int(step))
    # The model of 20 states is short, but with its 5 controls the sweep is not.
    x, u = ca.SX.sym("x", 20), ca.SX.sym("u", 5)
    wide = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(u, x[:15])), horizon=1.0,
        intervals=2, checks=2, stage_cost=ca.sumsqr(u),
        bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    assert is_divisible(wide)
    assert not are_short(shooting_of(wide), 30_000)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [({"blocks": (1, 3)}, "blocks"), ({"integrator": "stiff"}, "stiff")],
)
def test_what_lanes_do_not_support_is_not_divided(
    changes: dict[str, Any], reason: str
) -> None:
    problem = Planner(replace(tracking(), **changes), search=None).problem
    assert not is_divisible(problem)
    with pytest.raises(NoLanesError, match=reason):
        LaneSolver(problem)


def test_problems_are_divisible_unless_steps_would_change_their_costs() -> None:
    problem = tracking()
    u = problem.model.controls
    soft = PathConstraint(expression=u[0], upper=1.0, weight=3.0)
    assert is_divisible(problem)
    assert not is_divisible(tracking(1, 1))
    assert not is_divisible(replace(problem, quadrature="left"))
    assert not is_divisible(replace(problem, step_cost=u[0] ** 2))
    assert not is_divisible(replace(problem, constraints=[soft]))
    assert not is_divisible(replace(problem, bounds=Bounds(controls=(-np.inf, 3))))
    assert not is_divisible(Planner(
        replace(problem, control_shape="linear"), search=None
    ).problem)  # fmt: skip
