"""Receding horizon: warm start, fallback, and the gain known from theory."""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.heuristics import Budget, ParticleSwarm, RandomSearch
from swarmstart.ocp import (
    Bounds,
    Decision,
    InvalidProblemError,
    IpoptOptions,
    Known,
    Mode,
    Model,
    OptimalControlProblem,
    Planner,
    Plant,
    RecedingHorizon,
    SearchSettings,
    Source,
    simulate,
)

Posed = tuple[OptimalControlProblem, Array, Known]


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_plan_starts_at_the_last_one_shifted_with_zero_controls_appended(
    double_integrator: Model,
) -> None:
    """Without search and polish the plan is the guess."""
    problem = OptimalControlProblem(double_integrator, horizon=2.0, intervals=4)
    controller = RecedingHorizon(planner=Planner(problem, search=None))
    first = controller.decide(0.0, np.zeros(2), None, rng=rng())
    np.testing.assert_array_equal(first.plans[0].controls, np.zeros((1, 4)))
    plan = controller.planner.evaluated(
        np.array([[1.0, 2, 3, 4]]), np.zeros(2), source=Source.SEARCH
    )
    decision: Decision | None = Decision(control=plan.controls[:, 0], plans=(plan,))
    for expected in ([2, 3, 4, 0], [3, 4, 0, 0], [4, 0, 0, 0]):
        decision = controller.decide(0.5, np.zeros(2), decision, rng=rng())
        np.testing.assert_array_equal(decision.plans[0].controls, [expected])
        np.testing.assert_array_equal(decision.control, expected[:1])
        assert decision.mode is Mode.PLANNED
    np.testing.assert_array_equal(plan.controls, [[1, 2, 3, 4]])


def test_plan_may_start_at_the_last_one_as_it_is(double_integrator: Model) -> None:
    """Without search and polish nothing ever changes, as in the chapter."""
    problem = OptimalControlProblem(double_integrator, horizon=2.0, intervals=4)
    given = np.array([[1.0, 2, 3, 4]])
    controller = RecedingHorizon(
        planner=Planner(problem, search=None), first=given, shift=False
    )
    decision: Decision | None = None
    for _ in range(3):
        decision = controller.decide(0.0, np.zeros(2), decision, rng=rng())
        np.testing.assert_array_equal(decision.plans[0].controls, given)


def test_what_is_flown_without_a_feasible_plan_is_shifted_all_the_same(
    hopeless: RecedingHorizon,
) -> None:
    last = hopeless.planner.evaluated(
        np.array([[-1.0, 1, 0, 0]]), np.array([0.25, 0.0]), source=Source.SEARCH
    )
    unshifted = replace(hopeless, shift=False)
    plan = unshifted.plan(0.5, np.array([0.125, -0.5]), last, rng=rng())
    assert plan.source is Source.SHIFTED
    np.testing.assert_array_equal(plan.controls, [[1, 0, 0, 0]])


def test_the_plan_at_the_start_begins_from_the_first_controls(
    double_integrator: Model,
) -> None:
    """Without search and polish the first plan is these controls."""
    problem = OptimalControlProblem(double_integrator, horizon=2.0, intervals=4)
    given = np.array([[1.0, 2, 3, 4]])
    controller = RecedingHorizon(planner=Planner(problem, search=None), first=given)
    start = controller.decide(0.0, np.zeros(2), None, rng=rng())
    np.testing.assert_array_equal(start.plans[0].controls, given)
    assert start.plans[0].source is Source.GUESS
    after = controller.decide(0.5, np.zeros(2), start, rng=rng())
    np.testing.assert_array_equal(after.plans[0].controls, [[2, 3, 4, 0]])


def test_unconstrained_receding_horizon_is_the_linear_quadratic_law(
    lq: OptimalControlProblem, riccati: tuple[Array, Array]
) -> None:
    planner = Planner(lq, search=None, polish=IpoptOptions())
    controller, decision = RecedingHorizon(planner=planner), None
    for state in np.random.default_rng(1).normal(size=(5, 2)):
        decision = controller.decide(0.0, state, decision, rng=rng())
        np.testing.assert_allclose(decision.control, -riccati[0] @ state, atol=1e-6)


def test_reference_and_parameters_are_those_of_the_planning_time(
    double_integrator: Model,
) -> None:
    x, u = double_integrator.states, double_integrator.controls
    p, s = ca.SX.sym("p"), ca.SX.sym("s", 3)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, parameters=p, ode=double_integrator.ode),
        horizon=2.0,
        intervals=2,
        terminal_cost=p * s[0] + s[2],
        signals=s,
    )
    controller = RecedingHorizon(
        planner=Planner(problem, search=None),
        reference=lambda times: np.stack([times, -times]),
        parameters=lambda time: np.array([10 * time]),
    )
    seen = np.array([[7.0, 8, 9]])
    known = controller.known(5.0, (seen,))
    np.testing.assert_array_equal(known.signals, [[5, 6, 7], [-5, -6, -7], [7, 8, 9]])
    plan = controller.plan(5.0, np.zeros(2), None, seen=(seen,), rng=rng())
    assert plan.cost == 50 * 7 + 9


@pytest.fixture(scope="module")
def hopeless(double_integrator: Model) -> RecedingHorizon:
    """One random plan per instant never satisfies the terminal constraint of rest."""
    problem = OptimalControlProblem(
        double_integrator,
        horizon=2.0,
        intervals=4,
        bounds=Bounds(controls=(-1, 1)),
        terminal=[double_integrator.states],
    )
    search = SearchSettings(
        algorithm=RandomSearch(size=1),
        budget=Budget(evaluations=1),
        warm_start="none",
    )
    return RecedingHorizon(planner=Planner(problem, search=search))


def test_without_a_feasible_plan_the_shifted_last_one_is_flown(
    hopeless: RecedingHorizon,
) -> None:
    # From rest at 0.25 m: full brake, full throttle, each for half a second.
    start, controls = np.array([0.25, 0.0]), np.array([[-1.0, 1, 0, 0]])
    last = hopeless.planner.evaluated(controls, start, source=Source.SEARCH)
    assert last.feasible
    state = np.array([0.125, -0.5])
    plan = hopeless.plan(0.5, state, last, rng=rng())
    assert plan.source is Source.SHIFTED
    np.testing.assert_array_equal(plan.controls, [[1, 0, 0, 0]])
    assert plan.feasible
    searched = hopeless.planner.plan(state, rng=rng())
    assert (plan.search.cost, plan.search.violation, plan.evaluations) == (
        searched.cost,
        searched.violation,
        1,
    )


def test_first_plan_is_flown_even_if_infeasible_and_says_so(
    hopeless: RecedingHorizon,
) -> None:
    plan = hopeless.plan(0.0, np.array([0.25, 0.0]), None, rng=rng())
    assert plan.source is Source.SEARCH
    assert not plan.feasible


def test_first_controls_that_are_infeasible_are_not_called_shifted(
    hopeless: RecedingHorizon,
) -> None:
    planner = Planner(hopeless.planner.problem, search=None)
    given = np.zeros((planner.problem.model.nu, planner.problem.intervals))
    controller = RecedingHorizon(planner=planner, first=given)
    plan = controller.plan(0.0, np.array([0.25, 0.0]), None, rng=rng())
    assert not plan.feasible and plan.source is Source.GUESS


def test_control_interval_is_the_problems(hopeless: RecedingHorizon) -> None:
    assert hopeless.dt == 0.5


def test_infeasible_start_does_not_stall(double_integrator: Model) -> None:
    """Rest at 0 within 2 s is impossible from 3 m, but becomes possible later."""
    problem = OptimalControlProblem(
        double_integrator,
        horizon=2.0,
        intervals=4,
        stage_cost=ca.sumsqr(double_integrator.controls),
        bounds=Bounds(controls=(-1.0, 1.0)),
        terminal=[double_integrator.states],
    )
    search = SearchSettings(
        algorithm=ParticleSwarm(size=10), budget=Budget(evaluations=600)
    )
    planner = Planner(problem, search=search, polish=IpoptOptions())
    plant = Plant(double_integrator, dt=problem.dt, substeps=5)
    flown = simulate(
        plant, RecedingHorizon(planner=planner), [3.0, 0.0], steps=20, rng=rng()
    )
    plans = [decision.plans[0] for decision in flown.decisions]
    assert not plans[0].feasible
    assert plans[-1].feasible
    assert np.abs(flown.states[:, -1]).max() < 0.1


def test_a_set_point_is_a_parameter_of_the_plans_alone() -> None:
    """A number does for one parameter; the plant's model need not have it."""
    x, u, goal = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("goal")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u, parameters=goal), horizon=1.0, intervals=5,
        stage_cost=(x - goal) ** 2 + 0.01 * u**2, bounds=Bounds(controls=(-5, 5)),
    )  # fmt: skip
    planner = Planner(problem, search=None, polish=IpoptOptions())
    loop = RecedingHorizon(planner=planner, parameters=lambda time: 2.0 - (time < 1.9))
    plant = Plant(Model(states=x, controls=u, ode=u), dt=loop.dt, substeps=2)
    path = simulate(plant, loop, [0.0], steps=20, seed=0)
    assert path.states[0, [10, 20]] == pytest.approx([1.0, 2.0], abs=0.01)
    with pytest.raises(InvalidProblemError, match="need not be in the plant's model"):
        Plant(problem.model, dt=loop.dt, substeps=2)


@pytest.mark.parametrize("returned", [0.5, [0.5], np.zeros((1, 3))])
def test_a_reference_of_another_shape_is_refused_with_the_one_expected(
    returned: Any,
) -> None:
    x, u, goal = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("goal")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u, signals=goal), horizon=1.0, intervals=5,
        stage_cost=(x - goal) ** 2, bounds=Bounds(controls=(-5, 5)),
    )  # fmt: skip
    planner = Planner(problem, search=None, polish=IpoptOptions())
    loop = RecedingHorizon(planner=planner, reference=lambda times: returned)
    words = r"reference must return, for 6 times, an array of shape \(signals, 6\)"
    with pytest.raises(InvalidProblemError, match=words):
        loop.decide(0.0, np.zeros(1), None, rng=np.random.default_rng(0))
