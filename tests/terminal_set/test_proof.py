"""Levels proven: up to just below what is refuted, never from there on."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from swarmstart.terminal_set import (
    Change,
    NotPositiveError,
    Reference,
    TerminalSet,
    continuous_change,
    continuous_terminal_set,
    held_change,
    refuted_level,
    sampled_terminal_set,
)
from swarmstart.terminal_set.proof import prove_level

Array = NDArray[np.float64]
Posed = tuple[Change, TerminalSet]
"""c and the set."""


def loop(xdot: ca.SX, x: ca.SX, u: ca.SX) -> ca.Function:
    return ca.Function("loop", [x, u], [xdot])


def bounded(x_ref: Array, u_max: Array) -> Reference:
    return Reference(
        x_ref=x_ref, u_ref=np.zeros(u_max.size), u_lower=-u_max, u_upper=u_max
    )


def chen() -> Posed:
    """Chen and Allgoewer (1998), with the paper's margin Q*."""
    x, u, mu = ca.SX.sym("x", 2), ca.SX.sym("u"), 0.5
    xdot = ca.vertcat(
        x[1] + u * (mu + (1 - mu) * x[0]), x[0] + u * (mu - 4 * (1 - mu) * x[1])
    )
    dynamics, Q, R = loop(xdot, x, u), 0.5 * np.eye(2), np.eye(1)
    found = continuous_terminal_set(
        dynamics, bounded(np.zeros(2), np.array([2.0])), Q=Q, R=R, kappa=0.95
    )
    return continuous_change(dynamics, found, Q_m=Q + found.K.T @ R @ found.K), found


def pendulum() -> Posed:
    """Upright; the angle from there."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    dynamics = loop(ca.vertcat(x[1], 9.81 * ca.sin(x[0]) + u), x, u)
    found = continuous_terminal_set(
        dynamics, bounded(np.zeros(2), np.array([50.0])), Q=np.eye(2), R=np.eye(1)
    )
    return continuous_change(dynamics, found), found


def van_der_pol() -> Posed:
    """Reversed in time, without input."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    dynamics = loop(ca.vertcat(-x[1], x[0] - (1 - x[0] ** 2) * x[1]) + 0 * u, x, u)
    found = given(np.array([[1.5, -0.5], [-0.5, 1.0]]), np.zeros((1, 2)), np.zeros(2))
    return continuous_change(dynamics, found), found


def given(P: Array, K: Array, x_ref: Array) -> TerminalSet:
    return TerminalSet(
        K=K, P=P, alpha=1.0, x_ref=x_ref, u_ref=np.zeros(len(K)), dt=None,
        design="given",
    )  # fmt: skip


SYSTEMS = {"chen": chen, "pendulum": pendulum, "van der Pol": van_der_pol}


@pytest.mark.parametrize("name", SYSTEMS)
def test_proven_and_refuted_meet(name: str) -> None:
    """99 percent of what is refuted is proven; from there on nothing ever is."""
    change, _ = SYSTEMS[name]()
    refutation = refuted_level(change, alpha_max=100.0, rng=np.random.default_rng(0))
    assert refutation is not None
    below = prove_level(change, 0.99 * refutation.alpha)
    assert below.proven and below.counterexample is None
    for share in (1.000001, 1.02, 1.2):
        above = prove_level(change, share * refutation.alpha, max_boxes=50_000)
        assert not above.proven


def rk4(dynamics: ca.Function) -> ca.Function:
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
    rate = [dynamics(x, u)]
    for part in (0.5, 0.5, 1.0):
        rate.append(dynamics(x + part * rate[-1], u))
    after = x + (rate[0] + 2 * rate[1] + 2 * rate[2] + rate[3]) / 6
    return ca.Function("rk4", [x, u], [after])


@pytest.mark.parametrize(
    ("weight", "alpha"), [(1.0, 0.10670), (100.0, 4.3219), (1000.0, 51.03)]
)
def test_the_formation_held_for_a_second_is_proven_up_to_its_input_bound(
    formation: ca.Function,
    leader: Reference,
    turned_leader: Reference,
    weight: float,
    alpha: float,
) -> None:
    """Behind either leader: the second experiment's flies 45 degrees to the left."""
    for reference in (leader, turned_leader):
        found = sampled_terminal_set(
            formation, reference, dt=1.0, Q=np.eye(4), R=np.diag([1.0, weight])
        )
        assert found.alpha == pytest.approx(alpha, rel=1e-3)
        proof = prove_level(held_change(rk4(formation), found), found.alpha)
        assert proof.proven
        assert proof.alpha == found.alpha and proof.boxes < 200_000


def test_states_of_a_proven_set_decrease_under_an_independent_integrator(
    formation: ca.Function, leader: Reference
) -> None:
    found = sampled_terminal_set(
        formation, leader, dt=1.0, Q=np.eye(4), R=np.diag([1.0, 100.0])
    )
    assert prove_level(held_change(rk4(formation), found), found.alpha).proven
    rng, count = np.random.default_rng(0), 2000
    z: Array = rng.normal(size=(4, count))
    z *= (rng.random(count) ** 0.25 / np.linalg.norm(z, axis=0))[None]
    e = np.sqrt(found.alpha) * np.linalg.solve(np.linalg.cholesky(found.P).T, z)
    du = found.feedback(e)
    assert np.all(np.abs(du) <= leader.u_max[:, None] * (1 + 1e-12))

    def rates(time: float, flat: Array) -> Array:
        del time
        v, psi, *_position = flat.reshape(4, count)
        moved = np.stack([du[0], du[1], v * np.cos(psi), v * np.sin(psi)])
        return moved.ravel()

    x0 = leader.x_ref[:, None] + e
    end = solve_ivp(
        rates, (0.0, 1.0), x0.ravel(), method="DOP853", rtol=1e-10, atol=1e-10
    ).y[:, -1]
    later = np.array([15.0, 0.0, 15.0, 0.0])  # The leader flies on.
    after = end.reshape(4, count) - later[:, None]
    assert np.all(found.value(after) < found.value(e))


def test_a_matrix_whose_linear_part_does_not_contract_is_never_proven(
    formation: ca.Function, leader: Reference, printed_p: Array
) -> None:
    """The printed P, and a Lyapunov solution of the transposed equation (5.12)."""
    gain = continuous_terminal_set(formation, leader, Q=np.eye(4), R=np.eye(2)).K
    for P in (printed_p, np.diag([1.0, 49.22, 1.0, 1e-3])):
        change = continuous_change(formation, given(P, gain, leader.x_ref))
        for alpha in (1e-12, 1e-6, 1.0):
            proof = prove_level(change, alpha, max_boxes=20_000)
            assert not proof.proven


def test_a_linear_loop_is_proven_at_any_level() -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    dynamics = loop(ca.vertcat(x[1], u), x, u)
    found = continuous_terminal_set(
        dynamics, bounded(np.zeros(2), np.ones(1)), Q=np.eye(2), R=np.eye(1)
    )
    for alpha in (1e-6, 1.0, 1e6):
        proof = prove_level(continuous_change(dynamics, found), alpha)
        assert proof.proven and proof.boxes < 1000


def test_a_counterexample_that_is_met_is_one() -> None:
    change, _ = chen()
    proof = prove_level(change, 2.0)
    assert not proof.proven and proof.counterexample is not None
    assert float(change.function(proof.counterexample)) >= 0


def test_it_is_given_up_where_it_takes_too_long() -> None:
    change, _ = chen()
    proof = prove_level(change, 0.73, max_boxes=10)
    assert not proof.proven and proof.counterexample is None
    assert prove_level(change, 0.73).proven


@pytest.mark.parametrize("alpha", [0.0, -1.0, np.inf, np.nan])
def test_refuses_a_level_that_is_none(alpha: float) -> None:
    change, _ = chen()
    with pytest.raises(NotPositiveError, match="alpha must be a positive number"):
        prove_level(change, alpha)
