"""The motion of a held input: the Runge-Kutta map, and its curve between samples."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from swarmstart.terminal_set import TerminalSet
from swarmstart.terminal_set.proving.hold_margins import HeldMotion

DT = 0.1


def pendulum() -> tuple[ca.Function, TerminalSet]:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    f = ca.Function("pendulum", [x, u], [ca.vertcat(x[1], 9.81 * ca.sin(x[0]) + u)])
    return f, TerminalSet(
        K=np.array([[12.0, 4.0]]), P=np.array([[9.0, 2.0], [2.0, 1.0]]), alpha=1.0,
        x_ref=np.zeros(2), u_ref=np.zeros(1), dt=None, design="own",
    )  # fmt: skip


def test_the_curve_of_a_hold_goes_on_where_its_steps_end() -> None:
    f, law = pendulum()
    motion = HeldMotion(f, law, dt=DT, substeps=3)
    x = np.array([0.7, -0.4])
    u, e = -law.K @ x, x
    for number, one in enumerate(motion.holds):
        assert one.dt == pytest.approx(DT / 3)
        np.testing.assert_allclose(np.array(one.motion(x, 0.0)).ravel(), e, rtol=1e-14)
        e = np.array(ca.simpleRK(f, 1, 4)(e, u, DT / 3)).ravel()
        np.testing.assert_allclose(
            np.array(one.motion(x, one.dt)).ravel(), e, rtol=1e-12, err_msg=str(number)
        )
    np.testing.assert_allclose(np.array(motion.step(x, u)).ravel(), e, rtol=1e-12)


def test_the_measured_growth_is_that_of_the_slowest_return() -> None:
    """x' = -k x, held: V falls all the while, or rises without an end."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [x + u])
    for gain, falls in ((3.0, True), (30.0, False)):
        law = TerminalSet(
            K=np.array([[gain]]), P=np.eye(1), alpha=1.0, x_ref=np.zeros(1),
            u_ref=np.zeros(1), dt=None, design="own",
        )  # fmt: skip
        motion = HeldMotion(f, law, dt=DT, substeps=2)
        factor = np.exp(DT) - gain * np.expm1(DT)
        growth, found = motion.measured(1.0, np.random.default_rng(0))
        assert found is falls
        assert growth == pytest.approx(max(factor**2, 1.0), rel=1e-4)
