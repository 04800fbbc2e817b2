"""The planning problem of one UAV where a control interval is not one second long."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from swarmstart.cases.kinds.formation_flight.problem import (
    dynamics_of,
    reference_of,
    terminal_cost_of,
)
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.planar import unicycle


@pytest.mark.parametrize("dt", [0.5, 2.0])
def test_the_terminal_cost_goes_on_with_the_sum_over_the_steps(
    dt: float, make: Callable[..., FormationScenario]
) -> None:
    """The stage cost of a step is dt (e'Qe + u'Ru), so its Riccati equation has dt."""
    scenario = make(
        "formation_v", f"prediction.horizon_s={8 * dt}", "dual_mode.enabled=false",
        "weights={Q: [1, 2, 3, 4], R: [5, 6]}",
    )  # fmt: skip
    A = np.eye(4)
    A[2, 0], A[3, 1] = dt, 15.0 * dt  # x' = v, y' = 15 psi
    B = np.array([[dt, 0.0], [0.0, dt], [dt**2 / 2, 0.0], [0.0, 7.5 * dt**2]])
    Q, R = np.diag([1.0, 2, 3, 4]), np.diag([5.0, 6])
    P = terminal_cost_of(scenario, dynamics_of(unicycle()), reference_of(scenario))
    np.testing.assert_allclose(P, solve_discrete_are(A, B, Q * dt, R * dt), rtol=1e-8)
