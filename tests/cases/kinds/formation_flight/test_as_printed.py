"""The printed formulas of the terminal set: their values and broken bounds."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.cases.kinds.formation_flight.problem import (
    dynamics_of,
    level_as_printed,
    lyapunov_as_printed,
    terminal_set_as_printed,
)
from swarmstart.cases.kinds.planar import unicycle
from swarmstart.terminal_set import (
    InvalidShapeError,
    NotFiniteError,
    Reference,
    UnstableLoopError,
    continuous_lqr,
    input_excess,
    level_from_inputs,
    linearise,
)

I2, I4 = np.eye(2), np.eye(4)
TURN_RATE = np.pi / 18
"""10 deg/s, the bound of section 5.2.4."""


@pytest.fixture(scope="module")
def leader() -> Reference:
    return Reference(
        x_ref=np.array([15.0, 0, 0, 0]),
        u_ref=np.zeros(2),
        u_lower=np.array([-5.0, -TURN_RATE]),
        u_upper=np.array([5.0, TURN_RATE]),
    )


@pytest.fixture(scope="module")
def dynamics() -> ca.Function:
    return dynamics_of(unicycle())


@pytest.fixture(scope="module")
def printed_p() -> Array:
    """P as printed in section 5.2.4."""
    P = np.diag([0.0596, 0.0596, 0.0129, 0.0129])
    P[[0, 1, 2, 3], [2, 3, 0, 1]] = -0.0063
    return P


def test_the_printed_equation_is_that_of_the_transposed_loop(
    dynamics: ca.Function, leader: Reference
) -> None:
    A, B = linearise(dynamics, leader.x_ref, leader.u_ref)
    K = continuous_lqr(A, B, I4, I2).K
    F, Q = A - B @ K, I4 + K.T @ K
    P = lyapunov_as_printed(F, Q)
    assert P[3, 3] == pytest.approx(49.22, abs=0.01)
    assert P[1, 3] == pytest.approx(-0.0667, abs=1e-4)
    np.testing.assert_allclose(F @ P + P @ F.T, -Q, atol=1e-12)
    # So e'Pe grows somewhere along the loop it is meant for.
    assert np.linalg.eigvalsh(F.T @ P + P @ F)[-1] > 1.0


def test_the_printed_level_bounds_no_input() -> None:
    # One state: alpha K^2 P <= u_max^2 as printed, alpha K^2 / P <= u_max^2 as meant.
    K, P, u_max = [[1.0]], [[0.1]], [1.0]
    assert level_as_printed(K, P, u_max) == pytest.approx(10.0)
    assert level_from_inputs(K, P, u_max) == pytest.approx(0.1)
    assert input_excess(K, P, 10.0, u_max)[0] == pytest.approx(10.0)


def test_the_printed_set_keeps_neither_inputs_nor_states(
    dynamics: ca.Function, leader: Reference, printed_p: Array
) -> None:
    design = terminal_set_as_printed(dynamics, leader, Q=I4, R=I2, P=printed_p)
    assert design.alpha == pytest.approx(0.0170, abs=1e-4)
    excess = input_excess(design.K, design.P, design.alpha, leader.u_max)
    assert np.max(excess) == pytest.approx(20, abs=0.5)  # the turn rate, 20-fold
    kept = level_from_inputs(design.K, design.P, leader.u_max)
    assert kept == pytest.approx(4.19e-5, rel=2e-3)
    # Held 1 s, as the chapter flies it, the law throws states out of the set.
    e = design.ellipsoid.boundary(np.random.default_rng(0).normal(size=(4, 1000)))
    x = leader.x_ref[:, None] + e
    held = ca.simpleRK(dynamics, 20, 4).map(1000)
    moved = np.array([[15.0], [0.0], [15.0], [0.0]])  # The leader, 15 m on.
    later = np.array(held(x, design.feedback(e), 1.0)) - moved
    assert np.max(design.value(later)) > 100 * design.alpha


def test_numbers_of_the_wrong_kind_are_refused() -> None:
    with pytest.raises(UnstableLoopError, match="real part is 0,"):
        lyapunov_as_printed(0 * I2, I2)
    with pytest.raises(NotFiniteError, match="F must hold finite real numbers"):
        lyapunov_as_printed(np.nan * I2, I2)
    with pytest.raises(InvalidShapeError, match=r"u_max must have shape \(1,\)"):
        level_as_printed([[1.0, 0.0]], I2, [1.0, 1.0])
