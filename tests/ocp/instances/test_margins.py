"""Finer checks and margins for all instances."""

import numpy as np
import pytest

from swarmstart.ocp import Bounds, IpoptOptions, PathConstraint, Planner
from swarmstart.ocp.instances.instance_data import posed_instances, read_data
from swarmstart.ocp.instances.margins import at_other_nodes, with_margins
from swarmstart.ocp.instances.verification import fine_paths_of
from swarmstart.ocp.lanes.interior import Instances
from swarmstart.ocp.rollout.shooting import shooting_of
from swarmstart.tests.ocp.instances.fakes import N, X, double_integrator, parametric


def test_signals_are_linear_between_the_nodes() -> None:
    core = shooting_of(parametric()).problem
    finer = core.__class__(
        core.model,
        horizon=1.0,
        intervals=N,
        checks=4,
        stage_cost=core.stage_cost,
        bounds=core.bounds,
    )
    rows = np.stack([2 * core.times + 1, -core.times], axis=-1)
    given = Instances(np.zeros((2, 2)), np.ones((1, 2)), rows)
    found = at_other_nodes(core, finer, given).signals
    expected = np.stack([2 * finer.times + 1, -finer.times], axis=-1)
    np.testing.assert_allclose(found, expected, atol=1e-15)
    assert at_other_nodes(core, core, given) is given


def test_margins_are_those_of_the_worst_instance_and_add_up() -> None:
    """From 0 at 0.6 and 0.5 m/s with -2.4 m/s^2: up to 0.075 and 0.052 m."""
    limits = [
        PathConstraint(expression=X[0], lower=-9.0, upper=0.05, scale=1.0),
        PathConstraint(expression=X[1], upper=5.0, scale=1.0),  # Never met.
    ]
    problem = double_integrator(
        intervals=2, constraints=limits, bounds=Bounds(controls=(-5, 5))
    )
    planner = Planner(problem, search=None, polish=IpoptOptions())
    data = read_data(problem, [[0.0, 0.0], [0.6, 0.5]], None, None)
    posed = posed_instances(planner, data)
    paths = fine_paths_of(planner, threads=1)
    assert paths is not None
    controls = np.repeat(np.array([[-2.4, -0.8]])[:, :, None], 2, axis=2)
    first, amounts = with_margins(paths, posed.core, controls, {})
    assert first.checks == 4 and [*amounts] == [(0, 0)]
    assert amounts[0, 0] == pytest.approx(0.025 / 16, rel=0.01)
    height, speed = first.stated
    assert isinstance(height, PathConstraint) and isinstance(speed, PathConstraint)
    roof = 0.05 - 1.05 * 0.025 / 16 - 5e-5
    assert np.ravel(height.upper) == pytest.approx(roof, rel=1e-3)
    assert np.ravel(height.lower) > -9.0 and np.ravel(speed.upper) == 5.0
    _, again = with_margins(paths, posed.core, controls, amounts)
    assert again[0, 0] == pytest.approx(amounts[0, 0] + 0.025, rel=0.01)
