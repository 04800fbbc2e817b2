"""Levels proven: up to just below what is refuted, never from there on."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
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
from swarmstart.terminal_set.proving import proof
from swarmstart.terminal_set.proving.enclosure import Undecided
from swarmstart.terminal_set.proving.proof import (
    COVER,
    Limits,
    prove_level,
    radius_of,
    search_ball,
)

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


def of_terms(terms: Callable[[ca.SX, ca.SX, ca.SX], ca.SX]) -> Change:
    """x0' = x1, x1' = the terms, with the LQR of their derivatives at 0."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    dynamics = loop(ca.vertcat(x[1], terms(x[0], x[1], u)), x, u)
    found = continuous_terminal_set(
        dynamics, bounded(np.zeros(2), np.array([50.0])), Q=np.eye(2), R=np.eye(1)
    )
    return continuous_change(dynamics, found)


@pytest.mark.parametrize(
    "terms",
    [
        lambda x, v, u: 9.81 * ca.sin(x) + ca.fmin(ca.fmax(u, -4), 4),
        lambda x, v, u: 9.81 * ca.sin(x) + u - v * ca.fabs(v),
        lambda x, v, u: u + ca.erf(3 * x) + ca.sinh(v) - ca.cosh(x) + 1,
        lambda x, v, u: u + ca.asinh(2 * x + v) + ca.hypot(1, x + v) - 1 + x**3,
        lambda x, v, u: u + (9 + x) ** 1.5 - 27 + x**3 + ca.atan2(x, 4 + v**2),
    ],
    ids=["saturated", "drag", "erf sinh", "asinh hypot", "pow atan2"],
)
def test_proven_and_refuted_meet_for_other_operations_and_kinks(
    terms: Callable[[ca.SX, ca.SX, ca.SX], ca.SX],
) -> None:
    """A saturation inside the set, a drag v |v| with its kink at the reference."""
    change = of_terms(terms)
    refutation = refuted_level(change, alpha_max=400.0, rng=np.random.default_rng(0))
    assert refutation is not None
    assert prove_level(change, 0.98 * refutation.alpha).proven
    for share in (1.000001, 1.02):
        above = prove_level(change, share * refutation.alpha, max_boxes=5_000)
        assert not above.proven


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
    """It holds for both leaders; the second experiment's heads 45 degrees left."""
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
    later = np.array([15.0, 0.0, 15.0, 0.0])  # The leader moves on.
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


@pytest.mark.parametrize("nx", [1, 2, 3])
def test_boxes_cover_the_ball_and_all_of_it_is_looked_at(nx: int) -> None:
    """Cut again and again: every direction and radius lies in a box of some face."""
    seen: list[tuple[Array, Array]] = []

    def decided(lower: Array, upper: Array) -> Undecided:
        seen.append((lower, upper))
        again = upper[0] - lower[0] > 0.3
        w_long = (upper - lower)[1:].max(axis=0) > 0.6
        left = again | w_long
        spread = (upper - lower)[:, left]
        return Undecided(lower[:, left], upper[:, left], spread)

    limits = Limits(max_boxes=10**6, until=np.inf)
    search = search_ball(decided, nx, 1.25, limits=limits)
    assert search.finished and search.counterexample is None
    assert search.boxes == sum(lower.shape[1] for lower, _ in seen)
    lower, upper = (np.hstack(side) for side in zip(*seen, strict=True))
    np.testing.assert_array_equal(lower[0].min(), 0.0)
    np.testing.assert_array_equal(upper[0].max(), 1.25)
    small = ((upper - lower)[0] <= 0.3) & ((upper - lower)[1:].max(axis=0) <= 0.6)
    lower, upper = lower[:, small], upper[:, small]
    rng = np.random.default_rng(0)
    w = rng.normal(size=(nx, 200))
    w /= np.abs(w).max(axis=0)
    points = np.vstack([1.25 * rng.random(200), w])
    inside = (lower[..., None] <= points[:, None]) & (
        points[:, None] <= upper[..., None]
    )
    assert (inside.all(axis=0).sum(axis=0) >= 1).all()
    # No more than that: what is cut in two is as large as before.
    volume = (upper - lower)[0] * np.prod(
        np.where(upper == lower, 1.0, upper - lower)[1:], axis=0
    )
    assert volume.sum() == pytest.approx(2 * nx * 1.25 * 2 ** (nx - 1), rel=1e-12)


def test_boxes_are_looked_at_in_chunks_and_none_is_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(proof, "CHUNK", 3)
    sizes: list[int] = []

    def decided(lower: Array, upper: Array) -> Undecided:
        sizes.append(lower.shape[1])
        left = upper[0] > 0.3
        return Undecided(
            lower[:, left], upper[:, left], np.eye(3)[:, [0] * int(left.sum())]
        )

    limits = Limits(max_boxes=1000, until=np.inf)
    search = search_ball(decided, 2, 1.0, limits=limits)
    # Of 4 faces, cut twice in their radius: to 1/2, and to 1/4 and 3/4; and so on.
    assert max(sizes) == 3 and search.boxes == sum(sizes)
    assert not search.finished  # The outermost box never gets below 0.3.


def test_search_is_given_up_at_its_limits_only() -> None:
    def never(lower: Array, upper: Array) -> Undecided:
        return Undecided(lower, upper, upper - lower)

    def found(left: Undecided) -> Array:
        return left.upper[:, 0]

    late, early = (Limits(max_boxes=12, until=until) for until in (np.inf, 0.0))
    one = search_ball(never, 2, 1.0, limits=late)
    # 4 faces, then 8, then 16 of them halved: more than 12 in all at the second look.
    assert (one.finished, one.boxes) == (False, 4 + 8 + 16)
    exact = search_ball(never, 2, 1.0, limits=Limits(max_boxes=28, until=np.inf))
    assert exact.boxes == 28 + 32
    assert search_ball(never, 2, 1.0, limits=early).boxes == 4
    met = search_ball(never, 2, 1.0, limits=late, broken=found)
    assert met.boxes == 4 and not met.finished
    np.testing.assert_array_equal(met.counterexample, [1, -1, 1])


def test_box_that_cannot_be_cut_ends_the_search() -> None:
    def flat(lower: Array, upper: Array) -> Undecided:
        spread = upper - lower
        spread[:, -1] = 0.0
        return Undecided(lower, upper, spread)

    limits = Limits(max_boxes=10**6, until=np.inf)
    search = search_ball(flat, 2, 1.0, limits=limits)
    assert (search.finished, search.boxes) == (False, 4)


def test_ball_is_larger_than_the_ellipsoid_by_what_its_coordinates_are_off() -> None:
    """e'Pe >= (1 - d) |z|^2, so that sqrt(alpha / (1 - d)) is enough."""
    for defect in (0.0, 1e-6, 0.1, 0.49):
        assert radius_of(4.0, defect) >= 2 / np.sqrt(1 - defect)
        assert radius_of(4.0, defect) == 2 * (1 + COVER + defect)
    for defect in (0.5, 1.0, np.inf, np.nan):
        assert radius_of(4.0, defect) == np.inf


def test_coordinates_that_are_of_no_use_prove_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    change, _ = chen()
    monkeypatch.setattr(proof, "radius_of", lambda alpha, defect: np.inf)
    found = prove_level(change, 0.1)
    assert (found.proven, found.boxes, found.counterexample) == (False, 0, None)
    assert (found.alpha, found.seconds < 60) == (0.1, True)


def test_time_that_a_proof_took_is_its_own() -> None:
    change, _ = chen()
    began = perf_counter()
    found = prove_level(change, 0.5)
    assert 0 < found.seconds <= perf_counter() - began


def test_counterexample_is_the_nearest_of_the_boxes_outer_middles() -> None:
    """c = |e|^2 - 1 in coordinates turned by T = 2 I: 0 at the third, at once."""
    e = ca.SX.sym("e", 2)
    c = ca.Function("c", [e], [ca.sumsqr(e) - 1])
    lower = np.array([[0.0, 0.1, 0.2], [0.0, -1.5, 1.0], [1.0, 1.0, -0.5]])
    upper = np.array([[0.25, 0.75, 0.5], [0.0, -0.5, 1.0], [1.0, 1.0, 0.5]])
    boxes = Undecided(lower, upper, upper - lower)
    found = proof._counterexample(c, 2 * np.eye(2), boxes)
    assert found is not None
    np.testing.assert_allclose(found, [1, 0])
    farther = Undecided(lower[:, :2], upper[:, :2], upper[:, :2])
    found = proof._counterexample(c, 2 * np.eye(2), farther)
    assert found is not None
    np.testing.assert_allclose(found, 1.5 * np.array([-1, 1]) / np.sqrt(2))
    inner = Undecided(lower[:, :1], upper[:, :1], upper[:, :1])
    assert proof._counterexample(c, 2 * np.eye(2), inner) is None
    edge = ca.Function("c", [e], [ca.sumsqr(e) - 0.25])
    assert proof._counterexample(edge, 2 * np.eye(2), inner) is not None
    lost = ca.Function("c", [e], [ca.log(0.3 - e[0]) - 9])
    worst = proof._counterexample(lost, 2 * np.eye(2), boxes)
    assert worst is not None and worst[0] > 0.3
