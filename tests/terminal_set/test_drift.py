"""References that move: what a set can bear of it, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.terminal_set import (
    NotAnEquilibriumError,
    ProofOptions,
    Reference,
    TerminalSet,
    Weights,
    certified_terminal_set,
    certify,
)
from swarmstart.terminal_set.drift import MOST_CORE, ReferenceMotion

Array = NDArray[np.float64]


def decaying(offset: float, *, rate: float = 1.0) -> ca.Function:
    """x' = -rate x + offset + u."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    return ca.Function("decaying", [x, u], [-rate * x + offset + u])


def at(x_ref: list[float], room: float = 1.0, **bounds: Array) -> Reference:
    return Reference(
        x_ref=np.array(x_ref),
        u_ref=np.zeros(1),
        u_lower=-np.ones(1),
        u_upper=np.ones(1),
        **(bounds or {"x_upper": np.array(x_ref) + room}),
    )


def unit(x_ref: float = 0.0) -> TerminalSet:
    """P = 1 and no feedback."""
    return TerminalSet(
        K=np.zeros((1, 1)), P=np.eye(1), alpha=1.0, x_ref=np.array([x_ref]),
        u_ref=np.zeros(1), dt=None, design="given",
    )  # fmt: skip


def certified(
    offset: float, *, dt: float | None = None, room: float = 1.0
) -> TerminalSet:
    options = ProofOptions(growth=False)
    rng = np.random.default_rng(0)
    return certify(
        decaying(offset), at([0.0], room), unit(), dt=dt, options=options, rng=rng
    )


@pytest.mark.parametrize("dt", [None, 0.5])
@pytest.mark.parametrize("offset", [1e-9, -1e-9])
def test_a_rounded_reference_has_a_core_that_holds_the_equilibrium(
    offset: float, dt: float | None
) -> None:
    """x' = -x + r rests at r: that is within the core, and the core within the set."""
    found = certified(offset, dt=dt)
    certificate = found.certificate
    assert certificate is not None
    assert offset**2 < certificate.core <= MOST_CORE * found.alpha
    # |e+| <= |map| + (c + drift) |e| at the core's edge: it is not left.
    moved = abs(offset) * (1 if dt is None else 1 - np.exp(-dt))
    assert moved < certificate.drift * certificate.core**0.5
    assert certificate.drift <= 1e-3  # 5e-4 of the decrease, 2 V a second


@pytest.mark.parametrize("dt", [None, 0.5])
@pytest.mark.parametrize("offset", [1e-5, -1e-5])
def test_a_drift_that_its_core_could_not_bear_is_refused(
    offset: float, dt: float | None
) -> None:
    with pytest.raises(NotAnEquilibriumError, match=r"xdot\[0\] = -?1e-05 there"):
        certified(offset, dt=dt)


def test_what_a_set_can_bear_is_a_matter_of_its_size() -> None:
    """The same drift, and a room of 1 and of 1e6: nothing is absolute."""
    assert certified(1e-5, room=1e6).alpha == pytest.approx(1e12, rel=1e-6)
    with pytest.raises(NotAnEquilibriumError, match="of a set V <= 1e-06"):
        certified(1e-9, room=1e-3)


@pytest.mark.parametrize(("x_ref", "offset"), [(1e13, 5.0), (1e6, 9e-7)])
def test_a_drift_is_not_small_because_the_reference_is_large(
    x_ref: float, offset: float
) -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    dynamics = ca.Function("f", [x, u], [-(x - x_ref) + offset + u])
    reference = at([x_ref], 1.0 if offset > 1 else 1e-7)
    with pytest.raises(NotAnEquilibriumError, match=rf"xdot\[0\] = {offset:.6g} there"):
        certify(
            dynamics,
            reference,
            unit(x_ref),
            dt=None,
            rng=np.random.default_rng(0),
        )


@pytest.mark.parametrize("heading", [0.0, np.pi])
@pytest.mark.parametrize("side", ["x_lower", "x_upper"])
def test_a_state_with_a_bound_may_not_move_along(
    formation: ca.Function, leader: Reference, heading: float, side: str
) -> None:
    """A leader at 15 m/s: 0 <= x <= 60 was certified."""
    free = np.full(4, np.inf)
    x_ref = np.array([15.0, heading, 30.0, 0.0])
    weights = Weights(Q=np.eye(4), R=np.diag([1.0, 100.0]))
    unbounded = replace(leader, x_ref=x_ref)
    limit = {"x_lower": -free, "x_upper": free}[side].copy()
    limit[2] = 0.0 if side == "x_lower" else 60.0
    speed = "15" if heading == 0 else "-15"
    with pytest.raises(NotAnEquilibriumError, match=rf"xdot\[2\] = {speed} there"):
        certified_terminal_set(
            formation,
            replace(unbounded, **{side: limit}),
            weights,
            dt=1.0,
            rng=np.random.default_rng(0),
        )


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("substeps", [1, 4])
def test_a_hold_moves_the_reference_no_further_than_its_bound(
    sign: int, substeps: int
) -> None:
    """x' = x + r moves r (exp(dt) - 1), more than r dt."""
    r = 1e-6
    motion = ReferenceMotion(decaying(sign * r, rate=-1.0), at([0.0]))
    assert motion.bound == pytest.approx([r], rel=1e-12)
    for dt in (0.01, 0.3):
        moved = motion.over_hold(dt, substeps)[0]
        assert r * np.expm1(dt) < moved < 1.7 * r * np.expm1(dt)


def test_without_an_enclosure_of_the_hold_there_is_no_bound() -> None:
    motion = ReferenceMotion(decaying(1e-6, rate=10.0), at([0.0]))
    assert motion.over_hold(1.0, 1)[0] == np.inf
    assert np.isfinite(motion.over_hold(1.0, 40)[0])


def test_states_that_may_move_along_are_left_out(
    formation: ca.Function, leader: Reference
) -> None:
    motion = ReferenceMotion(formation, leader)
    assert motion.entries == () and not motion.bound.any()
    assert not motion.over_hold(1.0, 2).any()
