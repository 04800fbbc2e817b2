"""A solution and a flight of a model with names."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    Planner,
    Plant,
    RecedingHorizon,
    Solution,
    Trajectory,
    simulate,
    solve,
)


@pytest.fixture(scope="session")
def named_problem() -> OptimalControlProblem:
    """A double integrator, "place" and "speed" under a "push"; two checks."""
    place, speed, push = (ca.SX.sym(name) for name in ("place", "speed", "push"))
    states = ca.vertcat(place, speed)
    return OptimalControlProblem(
        Model(states=states, controls=push, ode=ca.vertcat(speed, push)),
        horizon=1.0,
        intervals=4,
        stage_cost=ca.sumsqr(states) + push**2,
        checks=2,
        bounds=Bounds(controls=(-2, 2)),
    )


@pytest.fixture(scope="session")
def solution(named_problem: OptimalControlProblem) -> Solution:
    return solve(named_problem, [1, 0], search=None, seed=0)


@pytest.fixture(scope="session")
def named_flight(named_problem: OptimalControlProblem) -> Trajectory:
    planner = Planner(named_problem, search=None, polish=IpoptOptions())
    plant = Plant(named_problem.model, dt=named_problem.dt, substeps=3)
    rng = np.random.default_rng(0)
    return simulate(plant, RecedingHorizon(planner=planner), [1, 0], steps=3, rng=rng)
