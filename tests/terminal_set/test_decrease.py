"""The change of e'Pe: what its motion must be, and that of systems."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from swarmstart.terminal_set import (
    Change,
    MovingCentreError,
    Reference,
    continuous_change,
    continuous_terminal_set,
    prove_level,
)


def change_of(moved: ca.SX, e: ca.SX) -> Change:
    return Change(
        motion=ca.Function("motion", [e], [moved]),
        P=np.eye(1),
        Q_m=np.zeros((1, 1)),
        is_held=False,
    )


@pytest.mark.parametrize(
    ("offset", "found"), [(1e-3, "0.001"), (5e-324, "4.94066e-324"), (np.nan, "nan")]
)
def test_a_motion_that_leaves_the_centre_is_refused(offset: float, found: str) -> None:
    """The proof looks at derivatives only: -e + 1e-3 was proven up to level 1."""
    e = ca.SX.sym("e")
    with pytest.raises(
        MovingCentreError, match=rf"must be 0 at e = 0, got \({found}\)"
    ):
        change_of(-e + offset, e)
    assert prove_level(change_of(-e, e), 1.0).proven


def test_at_a_rounded_equilibrium_the_relative_motion_is_exactly_zero() -> None:
    """sin(pi) is 1.2e-16 in floats: what is left is of the reference."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    pendulum = ca.Function("p", [x, u], [ca.vertcat(x[1], -9.81 * ca.sin(x[0]) + u)])
    upright = Reference(
        x_ref=np.array([np.pi, 0.0]),
        u_ref=np.zeros(1),
        u_lower=-np.ones(1),
        u_upper=np.ones(1),
    )
    assert float(pendulum(upright.x_ref, upright.u_ref)[1]) != 0
    found = continuous_terminal_set(pendulum, upright, Q=np.eye(2), R=np.eye(1))
    change = continuous_change(pendulum, found)
    assert np.all(np.array(change.motion(0)) == 0)
    # About upright sin(pi + a) = -sin(a), to the rounding of pi + a.
    a = 0.3
    u_a = -found.K[0, 0] * a
    expected = np.array([0.0, 9.81 * np.sin(a) + u_a])
    moved = np.array(change.motion([a, 0.0])).ravel()
    np.testing.assert_allclose(moved, expected, rtol=1e-14)
