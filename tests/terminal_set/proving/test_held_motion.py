"""The motion of a held input: the Runge-Kutta map, and its curve between samples."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from swarmstart.terminal_set import TerminalSet
from swarmstart.terminal_set.proving.hold_margins import HeldMotion
from swarmstart.tests.terminal_set.proving.held_pendulum import pendulum

DT = 0.1


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


def test_motion_is_relative_to_a_reference_that_moves_and_exactly_zero_at_zero() -> (
    None
):
    """x' = x^2 + 1 + u from 0.5, by Runge-Kutta steps written out."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    law = TerminalSet(
        K=np.array([[0.3]]), P=np.eye(1), alpha=1.0, x_ref=np.array([0.5]),
        u_ref=np.array([0.1]), dt=None, design="own",
    )  # fmt: skip
    motion = HeldMotion(
        ca.Function("f", [x, u], [x**2 + 1 + u]), law, dt=0.4, substeps=2
    )

    def later(x: float, held: float, t: float) -> float:
        k1 = x**2 + 1 + held
        k2 = (x + t / 2 * k1) ** 2 + 1 + held
        k3 = (x + t / 2 * k2) ** 2 + 1 + held
        k4 = (x + t * k3) ** 2 + 1 + held
        return x + t / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    for e in (0.0, 0.2, -0.7):
        at, own = 0.5 + e, 0.5
        for one in motion.holds:
            for t in (0.0, 0.13, 0.2):
                found = float(one.motion(e, t))
                exact = later(at, 0.1 - 0.3 * e, t) - later(own, 0.1, t)
                assert found == pytest.approx(exact, rel=1e-12, abs=1e-14)
                assert found != 0 or e == 0
            at, own = later(at, 0.1 - 0.3 * e, 0.2), later(own, 0.1, 0.2)
        assert all(float(one.motion(0, 0.13)) == 0 for one in motion.holds)


def test_motion_that_keeps_its_distance_does_not_fall() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    law = TerminalSet(
        K=np.zeros((1, 1)), P=np.eye(1), alpha=1.0, x_ref=np.zeros(1),
        u_ref=np.zeros(1), dt=None, design="own",
    )  # fmt: skip
    rest = HeldMotion(ca.Function("f", [x, u], [0 * x + u]), law, dt=DT, substeps=1)
    assert rest.measured(1.0, np.random.default_rng(0)) == (1.0, False)
