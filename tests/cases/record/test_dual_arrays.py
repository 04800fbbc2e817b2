"""Multipliers of the last plans: kept for the last step and for that of the mark."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.cases.record.multiplier_arrays import dual_arrays, with_duals
from swarmstart.cases.record.trajectory_arrays import steps_of, trajectory_arrays
from swarmstart.ocp import (
    Bounds,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    Planner,
    Plant,
    RecedingHorizon,
    Trajectory,
    simulate,
)
from swarmstart.ocp.nlp.multipliers import duals_of


@pytest.fixture(scope="module")
def flight() -> Trajectory:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    model = Model(states=x, controls=u, ode=ca.vertcat(x[1], u))
    problem = OptimalControlProblem(
        model, horizon=2.0, intervals=4, stage_cost=ca.sumsqr(x) + u**2,
        bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    loop = RecedingHorizon(planner=Planner(problem, search=None, polish=IpoptOptions()))
    return simulate(Plant(model, dt=0.5, substeps=4), loop, [2.0, 0.0], steps=4, seed=0)


def test_a_run_goes_on_from_its_last_step_or_from_that_of_the_mark(
    flight: Trajectory,
) -> None:
    """The arrays are written before the mark: a crash may come in between."""
    arrays = trajectory_arrays(flight) | dual_arrays(flight, finished=2)
    for count in (2, 4):
        steps = with_duals(steps_of(arrays, 4)[:count], arrays)
        kept = steps[-1].decision.plans[0].duals
        point = flight.decisions[count - 1].plans[0].point
        assert kept is not None and point is not None
        assert kept.flat().tobytes() == duals_of(point).flat().tobytes()
        assert steps[0].decision.plans[0].duals is None
    assert (
        with_duals(steps_of(arrays, 4)[:3], arrays)[-1].decision.plans[0].duals is None
    )


def test_records_without_them_are_read_as_before(flight: Trajectory) -> None:
    arrays = trajectory_arrays(flight)
    steps = steps_of(arrays, 4)
    assert with_duals(steps, arrays) is steps
    assert with_duals([], {"dual_steps": np.array([0])}) == []
