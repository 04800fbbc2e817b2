"""Costs with constraints kept along the path, against a closed form."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from swarmstart.benchmarks.kept_values import Kept, kept_value, read, written
from swarmstart.cases.format.kind import PlanningProblem
from swarmstart.ocp import Bounds, Known, Model, OptimalControlProblem

LIMIT = 0.1


def thrown(limit: float) -> PlanningProblem:
    """A point at the speed 1, braked in one interval: x = t + u t²/2 has a top.

    The check is at the end only, where x is below it.
    """
    x, v, u = (ca.SX.sym(name) for name in ("x", "v", "u"))
    problem = OptimalControlProblem(
        Model(states=ca.vertcat(x, v), controls=u, ode=ca.vertcat(v, u)),
        horizon=1.0,
        intervals=1,
        stage_cost=u**2,
        bounds=Bounds(controls=(-9, 9)),
        constraints=[x <= limit],
    )
    return PlanningProblem(problem=problem, x0=np.array([0.0, 1.0]), known=Known())


def test_a_limit_is_kept_where_no_check_is() -> None:
    """At the end 1 + u/2 <= 0.1; on the way -1/(2u) <= 0.1."""
    found = kept_value(thrown(LIMIT), seeds=(0,))
    assert found.at_checks == pytest.approx((2 * (1 - LIMIT)) ** 2, rel=1e-6)
    assert found.broken > 1e-2
    exact = 1 / (2 * LIMIT) ** 2
    assert found.without_margin <= exact <= found.along_path
    assert found.along_path == pytest.approx(exact, rel=2e-3)  # One interval.
    assert found.checks > 1


def test_a_limit_that_nothing_breaks_costs_nothing() -> None:
    found = kept_value(thrown(5.0), seeds=(0,))
    assert found.broken == 0.0
    assert found.along_path == found.at_checks == found.without_margin
    assert found.checks == 1


def test_values_are_read_as_they_were_written(tmp_path: Path) -> None:
    kept = {"a": Kept(1.0, 0.1, 2.0, 1.9, 8), "b": Kept(3.0, 0.0, 3.0, 3.0, 1)}
    file = tmp_path / "values.json"
    file.write_text(written(kept))
    assert read(file) == kept
