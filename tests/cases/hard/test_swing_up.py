"""Swing-up: a motor too weak to lift the pendulum, and several optima."""

import numpy as np
import pytest

import swarmstart as ss
from swarmstart.cases.hard.best_known import best_known
from swarmstart.tests.cases.hard.problems import rates, shipped_problem


@pytest.mark.parametrize("percent", [30, 20, 10])
def test_energy_changes_by_the_power_of_the_torque(percent: int) -> None:
    """E = speed^2 / 2 - cos(angle), so E' = torque * speed."""
    posed = shipped_problem(f"swing_up_{percent}")
    states = np.random.default_rng(0).uniform(-3, 3, (2, 40))
    torques = np.linspace(-0.3, 0.3, 40)
    angle_rate, acceleration = rates(posed, states, torques[None])
    power = states[1] * acceleration + np.sin(states[0]) * angle_rate
    assert np.allclose(power, torques * states[1], atol=1e-12)


@pytest.mark.parametrize("percent", [30, 20, 10])
def test_no_constant_torque_lifts_the_pendulum(percent: int) -> None:
    """From rest below, work against gravity is 1 - cos(angle), that of the motor less.

    From the start E is at most 0.3^2 / 2 - cos(0.3), and the top of
    -cos(angle) - torque * angle is at sin(angle) = torque beyond a right angle.
    """
    posed = shipped_problem(f"swing_up_{percent}")
    upper = float(posed.problem.control_limits[1][0])
    assert upper == percent / 100
    top = np.pi - np.arcsin(upper)
    energy = 0.3**2 / 2 - np.cos(0.3) + 0.3 * upper
    assert -np.cos(top) - upper * top > energy


def test_ipopt_alone_stops_at_a_dearer_optimum() -> None:
    posed = shipped_problem("swing_up_30")
    best = best_known()["hard/swing_up_30"].cost
    alone = ss.solve(posed.problem, posed.x0, search=None, lanes=0, seed=0)
    assert best is not None and alone.status.is_confirmed and alone.cost > 1.5 * best
