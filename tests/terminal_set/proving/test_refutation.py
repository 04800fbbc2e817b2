"""Levels refuted: published and measured limits, and points that break them."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.terminal_set import (
    NotPositiveError,
    Reference,
    TerminalSet,
    continuous_terminal_set,
    sampled_terminal_set,
)
from swarmstart.terminal_set.certificates.certificate import Refutation
from swarmstart.terminal_set.proving import proof
from swarmstart.terminal_set.proving.decrease import (
    Change,
    continuous_change,
    held_change,
)
from swarmstart.terminal_set.proving.proof import _checked, refuted_level


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def chen() -> tuple[ca.Function, TerminalSet, Array]:
    """Chen and Allgoewer (1998), kappa 0.95: dynamics, set, and Q* = Q + K'RK."""
    x, u, mu = ca.SX.sym("x", 2), ca.SX.sym("u"), 0.5
    xdot = ca.vertcat(
        x[1] + u * (mu + (1 - mu) * x[0]), x[0] + u * (mu - 4 * (1 - mu) * x[1])
    )
    dynamics = ca.Function("chen", [x, u], [xdot])
    reference = Reference(
        x_ref=np.zeros(2),
        u_ref=np.zeros(1),
        u_lower=np.array([-2.0]),
        u_upper=np.array([2.0]),
    )
    Q, R = 0.5 * np.eye(2), np.eye(1)
    found = continuous_terminal_set(dynamics, reference, Q=Q, R=R, kappa=0.95)
    return dynamics, found, Q + found.K.T @ R @ found.K


def refuted(change: Change, alpha_max: float, seed: int = 0) -> Refutation:
    found = refuted_level(change, alpha_max=alpha_max, rng=rng(seed))
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("share", "level"), [(1.0, 0.7320), (0.5, 0.83843), (0.0, 0.95108)]
)
def test_the_example_of_chen_and_allgoewer(
    chen: tuple[ca.Function, TerminalSet, Array], share: float, level: float
) -> None:
    """The paper says 0.7 of the first: dV <= -e'Q*e."""
    dynamics, found, Q_star = chen
    assert found.alpha == pytest.approx(12.5656, abs=1e-3)
    change = continuous_change(dynamics, found, Q_m=share * Q_star)
    one = refuted(change, found.alpha)
    assert one.alpha == pytest.approx(level, abs=1e-4)


def test_the_reversed_van_der_pol_oscillator() -> None:
    """A region of attraction inside the unstable cycle; published: 2.25 to 2.3."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    xdot = ca.vertcat(-x[1], x[0] - (1 - x[0] ** 2) * x[1]) + 0 * u
    dynamics = ca.Function("reversed", [x, u], [xdot])
    P = np.array([[1.5, -0.5], [-0.5, 1.0]])  # A'P + PA = -I
    own = TerminalSet(
        K=np.zeros((1, 2)), P=P, alpha=1.0, x_ref=np.zeros(2), u_ref=np.zeros(1),
        dt=None, design="given",
    )  # fmt: skip
    one = refuted(continuous_change(dynamics, own), 100.0)
    assert one.alpha == pytest.approx(2.304, abs=0.002)


def test_the_formation_held_for_a_second_decreases_far_beyond_its_input_bound(
    formation: ca.Function, leader: Reference
) -> None:
    found = sampled_terminal_set(formation, leader, dt=1.0, Q=np.eye(4), R=np.eye(2))
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
    rate = [formation(x, u)]
    for part in (0.5, 0.5, 1.0):
        rate.append(formation(x + part * rate[-1], u))
    after = x + (rate[0] + 2 * rate[1] + 2 * rate[2] + rate[3]) / 6
    change = held_change(ca.Function("rk4", [x, u], [after]), found)
    assert refuted_level(change, alpha_max=found.alpha, rng=rng()) is None
    assert refuted(change, 100.0).alpha == pytest.approx(3.4346, abs=1e-3)


def test_the_printed_matrix_does_not_even_contract_near_the_centre(
    formation: ca.Function, leader: Reference, printed_p: Array
) -> None:
    """So the nearest counterexample lies as near as one looks."""
    gain = continuous_terminal_set(formation, leader, Q=np.eye(4), R=np.eye(2)).K
    printed = TerminalSet(
        K=gain, P=printed_p, alpha=0.017, x_ref=leader.x_ref, u_ref=leader.u_ref,
        dt=None, design="literal",
    )  # fmt: skip
    one = refuted(continuous_change(formation, printed), 0.017)
    assert one.alpha < 0.017 / 100


@pytest.mark.parametrize("alpha_max", [3.0, 300.0, 3e4])
def test_where_one_begins_to_look_makes_no_difference(
    chen: tuple[ca.Function, TerminalSet, Array], alpha_max: float
) -> None:
    dynamics, found, Q_star = chen
    change = continuous_change(dynamics, found, Q_m=Q_star)
    levels = [refuted(change, alpha_max, seed).alpha for seed in range(3)]
    np.testing.assert_allclose(levels, 0.7320, atol=1e-4)


def test_the_counterexample_is_one_and_nothing_nearer_is(
    chen: tuple[ca.Function, TerminalSet, Array],
) -> None:
    dynamics, found, Q_star = chen
    change = continuous_change(dynamics, found, Q_m=Q_star)
    one = refuted(change, found.alpha)
    assert float(change.function(one.e)) == one.change >= 0
    assert one.e @ found.P @ one.e == one.alpha
    assert not one.e.flags.writeable
    # A fine grid of directions, just inside.
    angles = np.linspace(0, 2 * np.pi, 20_001)
    L = np.linalg.cholesky(found.P)
    circle = np.linalg.solve(L.T, np.array([np.cos(angles), np.sin(angles)]))
    for share in (0.999, 0.9, 0.5, 0.01):
        e = np.sqrt(share * one.alpha) * circle
        assert np.array(change.function.map(angles.size)(e)).max() < 0


def test_a_linear_loop_is_never_refuted() -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    dynamics = ca.Function("integrators", [x, u], [ca.vertcat(x[1], u)])
    reference = Reference(
        x_ref=np.zeros(2), u_ref=np.zeros(1),
        u_lower=np.array([-1.0]), u_upper=np.array([1.0]),
    )  # fmt: skip
    found = continuous_terminal_set(dynamics, reference, Q=np.eye(2), R=np.eye(1))
    change = continuous_change(dynamics, found)
    assert refuted_level(change, alpha_max=1e6, rng=rng()) is None


@pytest.mark.parametrize("alpha_max", [0.0, -1.0, np.inf, np.nan])
def test_refuses_a_level_that_is_none(
    chen: tuple[ca.Function, TerminalSet, Array], alpha_max: float
) -> None:
    dynamics, found, _ = chen
    with pytest.raises(NotPositiveError, match="alpha_max must be a positive number"):
        refuted_level(
            continuous_change(dynamics, found), alpha_max=alpha_max, rng=rng()
        )


@pytest.mark.parametrize(("change", "is_refuted"), [(0.0, True), (-1e-300, False)])
def test_a_change_of_zero_is_no_decrease(change: float, is_refuted: bool) -> None:
    e = ca.SX.sym("e", 2)
    found = _checked(ca.Function("c", [e], [change]), np.eye(2), np.array([3.0, 4.0]))
    assert (found is not None) == is_refuted
    if found is not None:
        assert (found.alpha, found.change) == (25.0, 0.0)
    lost = np.array([np.nan, 1.0])
    assert _checked(ca.Function("c", [e], [change]), np.eye(2), lost) is None


def test_rays_are_followed_to_the_first_radius_without_a_decrease() -> None:
    """c is small, 0 on the line e_0 = 1, with e_0 = 2 z_0; the nearest come first."""
    e = ca.SX.sym("e", 2)
    c, T = ca.Function("c", [e], [1e-9 * (e[0] - 1)]), np.diag([2.0, 3.0])
    grid = np.geomspace(proof.SMALLEST * 10, 10, proof.RADII)
    found = proof._on_rays(c, T, 10.0, rng())
    assert len(found) == proof.STARTS
    radii = [rho for rho, _ in found]
    # Along the axis the line is met at 1/2.
    assert radii == sorted(radii) and radii[0] == grid[grid >= 0.5][0]
    for rho, u in found:
        assert np.linalg.norm(u) == pytest.approx(1)
        (place,) = np.flatnonzero(grid == rho)
        assert grid[place] * 2 * u[0] >= 1 > grid[place - 1] * 2 * u[0]
    assert proof._on_rays(c, T, 0.49, rng()) == []


@pytest.mark.parametrize(
    ("answers", "level"),
    [
        ([None, 0.7, 0.3, None], 0.3),
        ([1.0, None], 1.0),
        ([1.0 + 1e-9, None, 2.0], None),  # Pushed beyond the level that is asked for.
        ([None, None], None),
    ],
)
def test_nearest_counterexample_within_the_level_is_taken(
    answers: list[float | None], level: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = iter(answers)

    def checked(*_: object) -> Refutation | None:
        alpha = next(left)
        return (
            None if alpha is None else Refutation(alpha=alpha, e=np.ones(1), change=0.0)
        )

    monkeypatch.setattr(proof, "_checked", checked)
    start = (0.9, np.ones(1))
    monkeypatch.setattr(proof, "_on_rays", lambda *_: [start])
    monkeypatch.setattr(proof, "_nearest", lambda *_: [np.ones(1)] * (len(answers) - 1))
    motion = ca.Function("motion", [e := ca.SX.sym("e")], [-e])
    change = Change(motion=motion, P=np.eye(1), Q_m=np.zeros((1, 1)), is_held=False)
    found = refuted_level(change, alpha_max=1.0, rng=rng())
    assert (None if found is None else found.alpha) == level


@pytest.mark.parametrize(
    ("inside", "pushed"), [(0.0, 0.0), (5e-10, 1e-9), (5e-9, 1e-6), (2e-6, None)]
)
def test_point_just_inside_is_pushed_outwards_by_little_or_given_up(
    inside: float, pushed: float | None
) -> None:
    """c = |e| - 1, and a point that lies a part within the sphere of its zeros."""
    e = ca.SX.sym("e", 2)
    c = ca.Function("c", [e], [ca.norm_2(e) - 1])
    for direction in ([1.0, 0.0], [0.0, -1.0]):
        point = (1 - inside) * np.array(direction)
        found = _checked(c, np.diag([2.0, 3.0]), point)
        assert (found is None) == (pushed is None)
        if found is not None and pushed is not None:
            np.testing.assert_allclose(found.e, (1 + pushed) * point, rtol=1e-15)
            assert found.alpha == pytest.approx(found.e @ np.diag([2, 3]) @ found.e)


def test_nearest_point_of_a_plane_is_found_from_any_ray() -> None:
    """c = a'e - 1: z is T'a / |T'a|^2, of all points with c >= 0."""
    e, T = ca.SX.sym("e", 2), np.array([[2.0, 0.5], [0.0, 1.0]])
    for a in ([1.0, 0.0], [-1.0, 0.2], [0.3, -1.0], [-0.5, -0.5], [0.0, 1.0]):
        c = ca.Function("c", [e], [ca.dot(ca.DM(a), e) - 1])
        pulled = T.T @ np.array(a)
        exact = pulled / (pulled @ pulled)
        radius = 3 * float(np.linalg.norm(exact))
        side = np.array([-exact[1], exact[0]])
        away = exact + 0.8 * side
        begin = float(np.linalg.norm(away))
        (found,) = proof._nearest(c, T, [(begin, away / begin)], radius)
        np.testing.assert_allclose(found, exact, atol=1e-6 * radius)


def test_motion_without_any_change_is_refuted_at_the_first_radius() -> None:
    """c is 0 everywhere, which is no decrease."""
    e = ca.SX.sym("e", 2)
    found = proof._on_rays(ca.Function("c", [e], [0 * e[0]]), np.eye(2), 5.0, rng())
    assert [rho for rho, _ in found] == [5.0 * proof.SMALLEST] * proof.STARTS


def test_rays_refute_by_themselves_if_nothing_nearer_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    e, u = ca.SX.sym("e", 2), np.array([0.6, 0.8])
    change = Change(
        motion=ca.Function("motion", [e], [e]), P=np.diag([4.0, 9.0]),
        Q_m=np.zeros((2, 2)), is_held=False,
    )  # fmt: skip
    monkeypatch.setattr(proof, "_on_rays", lambda *_: [(0.9, u)])
    monkeypatch.setattr(proof, "_nearest", lambda *_: [])
    found = refuted(change, 1.0)
    np.testing.assert_allclose(found.e, 0.9 * u / [2, 3], rtol=1e-15)
    assert found.alpha == pytest.approx(0.81, rel=1e-12)
