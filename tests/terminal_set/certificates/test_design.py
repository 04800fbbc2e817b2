from __future__ import annotations

import dataclasses

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.terminal_set import (
    InvalidReserveError,
    InvalidShapeError,
    NotPositiveError,
    Reference,
    TerminalSet,
    continuous_lqr,
    continuous_terminal_set,
    linearise,
    sampled_terminal_set,
)

I2, I4 = np.eye(2), np.eye(4)


def flown(e: Array, du: Array, heading: float = 0.0, dt: float = 1.0) -> Array:
    """Simulate the formation model relative to its leader with inputs held for dt.

    v and psi are linear in time, so x and y are integrals of smooth functions: 12 Gauss
    points leave nothing of the error at these turn rates.
    """
    nodes, weights = np.polynomial.legendre.leggauss(12)
    t = ((nodes + 1) * dt / 2)[:, None]
    v, psi = 15 + e[0] + t * du[0], heading + e[1] + t * du[1]
    weights = weights * dt / 2
    return np.array(
        [
            e[0] + dt * du[0],
            e[1] + dt * du[1],
            e[2] + weights @ (v * np.cos(psi) - 15 * np.cos(heading)),
            e[3] + weights @ (v * np.sin(psi) - 15 * np.sin(heading)),
        ]
    )


def boundary_of(design: TerminalSet, count: int = 10_000) -> Array:
    directions = np.random.default_rng(11).normal(size=(len(design.P), count))
    return design.ellipsoid.boundary(directions)


@pytest.mark.parametrize(
    ("weight", "alpha", "extent", "contraction"),
    [
        (1.0, 0.10670, [0.238, 0.323], 0.660),
        (100.0, 4.322, [1.51, 1.87], 0.51),
        (1000.0, 51.035, [5.20, 5.62], 0.51),
    ],
)
def test_the_sampled_set_holds_under_the_nonlinear_dynamics(
    formation: ca.Function,
    leader: Reference,
    weight: float,
    alpha: float,
    extent: list[float],
    contraction: float,
) -> None:
    design = sampled_terminal_set(
        formation, leader, dt=1.0, Q=I4, R=np.diag([1.0, weight])
    )
    assert design.alpha == pytest.approx(alpha, rel=1e-4)
    np.testing.assert_allclose(design.ellipsoid.extent()[2:], extent, atol=5e-3)

    e = boundary_of(design)
    du = design.feedback(e)
    assert np.all(np.abs(du) <= leader.u_max[:, None] * (1 + 1e-12))
    # The turn rate binds: 1e4 random points come near its bound, none beyond it.
    assert np.max(np.abs(du[1])) > 0.99 * leader.u_max[1]
    assert np.max(design.value(flown(e, du))) <= contraction * design.alpha


def test_the_closed_form_flight_is_that_of_the_dynamics(
    formation: ca.Function, leader: Reference
) -> None:
    e, du = np.array([2.0, -0.3, 4.0, -1.0]), np.array([-3.0, 0.17])
    moving = formation(leader.x_ref, leader.u_ref).full().ravel()

    def slope(_: float, e: Array) -> Array:
        xdot = formation(leader.x_ref + e, leader.u_ref + du).full().ravel()
        return np.asarray(xdot - moving)

    end = solve_ivp(slope, (0.0, 1.0), e, rtol=1e-11, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(flown(e[:, None], du[:, None])[:, 0], end, atol=1e-9)


def test_a_turned_leader_turns_the_set(
    formation: ca.Function, leader: Reference, turned_leader: Reference
) -> None:
    straight, turned = (
        sampled_terminal_set(formation, reference, dt=1.0, Q=I4, R=I2)
        for reference in (leader, turned_leader)
    )
    assert turned.alpha == pytest.approx(straight.alpha, rel=1e-10)
    np.testing.assert_allclose(
        np.linalg.norm(turned.K, axis=1), np.linalg.norm(straight.K, axis=1), rtol=1e-10
    )
    turn = np.eye(4)
    turn[2:, 2:] = np.array([[1, -1], [1, 1]]) / np.sqrt(2)
    np.testing.assert_allclose(turned.P, turn @ straight.P @ turn.T, atol=1e-10)
    e = boundary_of(turned)
    after = turned.value(flown(e, turned.feedback(e), np.pi / 4))
    assert np.max(after) <= 0.660 * turned.alpha


def test_the_continuous_set_of_the_formation_model(
    formation: ca.Function, leader: Reference
) -> None:
    design = continuous_terminal_set(formation, leader, Q=I4, R=I2)
    assert design.alpha == pytest.approx(0.005471, abs=1e-6)
    np.testing.assert_allclose(design.ellipsoid.extent()[2:], [0.069, 0.169], atol=5e-4)
    A, B = linearise(formation, leader.x_ref, leader.u_ref)
    np.testing.assert_allclose(design.P, continuous_lqr(A, B, I4, I2).P, atol=1e-12)
    assert design.dt is None


def test_the_published_example_of_chen_and_allgoewer(
    chen: tuple[ca.Function, Reference],
) -> None:
    design = continuous_terminal_set(*chen, Q=0.5 * I2, R=[[1.0]], kappa=0.95)
    np.testing.assert_allclose(design.K, [[2.118, 2.118]], atol=1e-3)
    published = [[16.5926, 11.5926], [11.5926, 16.5926]]
    np.testing.assert_allclose(design.P, published, atol=1e-4)
    assert design.alpha == pytest.approx(12.566, abs=1e-3)
    without_reserve = continuous_terminal_set(*chen, Q=0.5 * I2, R=[[1.0]])
    assert without_reserve.alpha == pytest.approx(1.88854, abs=1e-5)


@pytest.mark.parametrize("kappa", [-0.1, 1.0, np.nan])
def test_a_reserve_that_is_not_there_is_refused(
    chen: tuple[ca.Function, Reference], kappa: float
) -> None:
    with pytest.raises(InvalidReserveError, match="at least 0 and less than 1,"):
        continuous_terminal_set(*chen, Q=0.5 * I2, R=[[1.0]], kappa=kappa)


def test_a_state_bound_may_be_the_nearer_one(
    formation: ca.Function, leader: Reference
) -> None:
    narrow = dataclasses.replace(
        leader,
        x_lower=np.array([0.0, -np.inf, -np.inf, -np.inf]),
        x_upper=np.array([15.1, np.inf, np.inf, np.inf]),
    )
    design = sampled_terminal_set(formation, narrow, dt=1.0, Q=I4, R=I2)
    assert design.ellipsoid.extent()[0] == pytest.approx(0.1)


def test_without_any_bound_there_is_no_level(
    formation: ca.Function, leader: Reference
) -> None:
    free = dataclasses.replace(
        leader, u_lower=np.full(2, -np.inf), u_upper=np.full(2, np.inf)
    )
    with pytest.raises(NotPositiveError, match=r"alpha must be .* number, got inf"):
        sampled_terminal_set(formation, free, dt=1.0, Q=I4, R=I2)


def test_a_level_is_lowered_by_a_copy(
    formation: ca.Function, leader: Reference
) -> None:
    design = sampled_terminal_set(formation, leader, dt=1.0, Q=I4, R=I2)
    lowered = dataclasses.replace(design, alpha=design.alpha / 4)
    on = boundary_of(design)
    assert np.all(design.contains(0.51 * on))
    assert not np.any(lowered.contains(0.51 * on))
    assert np.all(lowered.contains(0.49 * on))
    np.testing.assert_allclose(lowered.feedback(on[:, 0]), -design.K @ on[:, 0])


def test_a_set_of_unequal_sizes_is_refused() -> None:
    fitting = TerminalSet(
        K=np.ones((1, 2)),
        P=I2,
        alpha=1.0,
        x_ref=np.zeros(2),
        u_ref=np.zeros(1),
        dt=None,
        design="by hand",
    )
    with pytest.raises(InvalidShapeError, match=r"K must have shape \(1, 2\)"):
        dataclasses.replace(fitting, K=np.ones((2, 1)))
    with pytest.raises(NotPositiveError, match="dt must be a positive number"):
        dataclasses.replace(fitting, dt=0.0)
    with pytest.raises(InvalidShapeError, match=r"e must have shape \(2,\)"):
        fitting.feedback(np.zeros(3))
