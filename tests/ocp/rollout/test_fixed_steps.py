"""The fixed steps of an NLP are the fewest that are accurate enough at its start."""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    IpoptOptions,
    Known,
    Model,
    OptimalControlProblem,
)
from swarmstart.ocp.nlp.nlp_solvers import FixedSteps, StepChoice
from swarmstart.ocp.nlp.polish import Polisher
from swarmstart.ocp.rollout.fitness import Fitness, replay
from swarmstart.tests.ocp import catalyst


def chosen(
    problem: OptimalControlProblem, controls: Array, x0: Any
) -> tuple[FixedSteps, StepChoice]:
    """Return the steps of an NLP at controls and their states, and their choice."""
    fitness = Fitness(problem, backend="casadi")
    choice = StepChoice(fitness.shooting)
    states, _, _ = replay(fitness.shooting, controls, x0)
    return choice(controls, states, fitness.arguments(x0, Known())), choice


def robertson(**stated: Any) -> OptimalControlProblem:
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    made, lost, burnt = 0.04 * u * x[0], 1e4 * x[1] * x[2], 3e7 * x[1] ** 2
    return OptimalControlProblem(
        Model(states=x, controls=u,
              ode=ca.vertcat(lost - made, made - lost - burnt, burnt)),
        horizon=40.0, intervals=10, stage_cost=u**2, bounds=Bounds(controls=(0.5, 4)),
        integrator="stiff", **stated,
    )  # fmt: skip


def test_catalyst_takes_equal_steps_that_are_exact_enough() -> None:
    problem = catalyst.problem(integrator="stiff", substeps=4)
    controls = np.random.default_rng(0).uniform(0.6, 0.9, (1, 10))
    steps, _ = chosen(problem, controls, catalyst.X0)
    assert steps == FixedSteps(8, 5)
    equal = steps.shooting(Fitness(problem, backend="casadi").shooting)
    states, _, _ = replay(equal, controls, catalyst.X0)
    exact = catalyst.exact_end(controls)
    np.testing.assert_allclose(states[:, -1], exact, rtol=1e-7)
    fewer = replace(problem, integrator_tolerance=1e-3)
    assert chosen(fewer, controls, catalyst.X0)[0] == FixedSteps(4, 5)
    more = replace(problem, integrator_tolerance=1e-9)
    assert chosen(more, controls, catalyst.X0)[0].steps >= 16


def test_layer_of_robertson_takes_more_parts_not_a_thousand_steps() -> None:
    problem, controls, x0 = robertson(), np.ones((1, 10)), [1.0, 0.0, 0.0]
    steps, _ = chosen(problem, controls, x0)
    assert steps == FixedSteps(8, 8)
    equal = steps.shooting(Fitness(problem, backend="casadi").shooting)
    states = replay(problem, controls, x0)[0]
    off = replay(equal, controls, x0)[0] - states
    reach = np.abs(states).max(axis=1, keepdims=True)
    assert np.abs(off / reach).max() < 1e-6


def test_no_more_steps_than_an_nlp_can_be_built_of() -> None:
    """The slow branch and a jump of van der Pol's, within one interval."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    ode = ca.vertcat(x[1], 100 * (1 - x[0] ** 2) * x[1] - x[0] + u)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ode), horizon=200.0, intervals=2,
        stage_cost=x[0] ** 2, integrator="stiff", bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    steps, choice = chosen(problem, np.zeros((1, 2)), [2.0, 0.0])
    assert steps in choice.candidates
    assert max(sum(c) for c in choice.candidates) <= 32 + 8
    large = ca.SX.sym("x", 20)
    slow = OptimalControlProblem(
        Model(states=large, controls=u, ode=u - large * ca.sum1(large)), horizon=1.0,
        intervals=2, stage_cost=u**2, integrator="stiff", checks=3,
        bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    _, choice = chosen(slow, np.zeros((1, 2)), np.ones(20))
    assert choice.candidates == [FixedSteps(4, 5)]


def test_guess_that_explodes_takes_the_expected_steps() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=x**2 + u), horizon=10.0, intervals=2,
        integrator="stiff", substeps=3, bounds=Bounds(controls=(-2, 2)),
    )  # fmt: skip
    steps, _ = chosen(problem, np.ones((1, 2)), [1.0])
    assert steps == FixedSteps(3, 5)


def test_checks_signals_and_parameters_reach_each_step() -> None:
    """Steps of order four integrate a cubic of time exactly from any start."""
    x, u, w, p = (ca.SX.sym(name) for name in "xuwp")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, parameters=p, signals=w, ode=p * w**3 + u),
        horizon=2.0, intervals=3, checks=2, integrator="stiff", substeps=1,
        bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    known = Known(np.array([0.7]), np.random.default_rng(0).normal(size=(1, 7)))
    fitness = Fitness(problem, backend="casadi")
    choice = StepChoice(fitness.shooting)
    controls = np.array([[0.3, -1.0, 0.8]])
    states = fitness.states(controls, [0.2], known)
    found = choice._reached(controls, states, fitness.arguments([0.2], known))
    np.testing.assert_allclose(found.ends[0], states[0, 1:], rtol=1e-12)
    assert choice._error(FixedSteps(1, 5), found, np.arange(6)) < 1e-12


def test_polish_takes_the_steps_that_its_guess_needs() -> None:
    fitness = Fitness(robertson(), backend="casadi")
    polish = Polisher(fitness, IpoptOptions(max_iterations=3))
    polish(np.ones((1, 10)), [1.0, 0.0, 0.0], near=True)
    assert [*polish.solvers.built] == [FixedSteps(8, 8)]
    with pytest.raises(InvalidProblemError, match="ipopt refuses its options"):
        Polisher(fitness, IpoptOptions(options={"no_such_option": 1}))
