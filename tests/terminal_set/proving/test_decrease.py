"""The change of e'Pe: what its motion must be, and that of systems."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from swarmstart.terminal_set import (
    Change,
    InvalidShapeError,
    MovingCentreError,
    Reference,
    TerminalSet,
    continuous_change,
    continuous_terminal_set,
    held_change,
    prove_level,
)
from swarmstart.terminal_set.proving.decrease import held_map


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


@pytest.mark.parametrize("moved", [0, 1])
def test_one_entry_that_moves_is_enough_to_be_refused(moved: int) -> None:
    e = ca.SX.sym("e", 2)
    motion = -e + ca.DM([1e-6 * (moved == k) for k in range(2)])
    with pytest.raises(MovingCentreError):
        Change(
            motion=ca.Function("motion", [e], [motion]), P=np.eye(2),
            Q_m=np.zeros((2, 2)), is_held=True,
        )  # fmt: skip


def test_a_motion_of_another_size_is_refused() -> None:
    e, wide = ca.SX.sym("e", 2), ca.SX.sym("e", 3)
    for motion in (
        ca.Function("motion", [e], [e[0]]),
        ca.Function("motion", [wide], [wide[:2]]),
        ca.Function("motion", [e], [ca.horzcat(e, e)]),
    ):
        with pytest.raises(InvalidShapeError, match="the motion must have shape"):
            Change(motion=motion, P=np.eye(2), Q_m=np.zeros((2, 2)), is_held=False)


@pytest.mark.parametrize("is_held", [False, True])
def test_the_change_is_what_the_definition_says(is_held: bool) -> None:
    """Of x' = x + u^3 - 1 about (1, 0), or of a step by that: with a margin."""
    rng = np.random.default_rng(0)
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [ca.vertcat(x[1] * x[0], x[0] + u**3 - 1)])
    P, Q_m = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([[1.0, -0.25], [-0.25, 3.0]])
    x_ref, u_ref, K = np.array([1.0, -0.5]), np.array([0.25]), np.array([[0.7, -0.3]])
    own = TerminalSet(
        K=K, P=P, alpha=1.0, x_ref=x_ref, u_ref=u_ref, dt=None, design="own"
    )
    make = held_change if is_held else continuous_change
    for margin in (None, Q_m):
        change = make(f, own, Q_m=margin)
        assert change.is_held is is_held
        for e in rng.normal(size=(5, 2)):
            moved = np.array(f(x_ref + e, u_ref - K @ e) - f(x_ref, u_ref)).ravel()
            expected = moved @ P @ moved - e @ P @ e if is_held else 2 * e @ P @ moved
            expected += 0 if margin is None else e @ margin @ e
            assert float(change.function(e)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("substeps", [1, 3])
def test_map_of_a_hold_is_the_classical_one_step_after_step(substeps: int) -> None:
    """Two states and one input: k1 to k4 written out."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [ca.vertcat(x[1] * x[0] + u, ca.sin(x[0]) - u * x[1])])

    def rate(x: np.ndarray) -> np.ndarray:
        return np.array([x[1] * x[0] + 0.3, np.sin(x[0]) - 0.3 * x[1]])

    after, h = np.array([0.7, -0.4]), 0.6 / substeps
    for _ in range(substeps):
        k1 = rate(after)
        k2 = rate(after + h / 2 * k1)
        k3 = rate(after + h / 2 * k2)
        k4 = rate(after + h * k3)
        after = after + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    found = np.array(held_map(f, 0.6, substeps)([0.7, -0.4], 0.3)).ravel()
    np.testing.assert_allclose(found, after, rtol=1e-14)
