"""Growth between samples: proven above what it is, never below."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

from swarmstart.arrays import Array
from swarmstart.terminal_set import Reference, TerminalSet, sampled_terminal_set
from swarmstart.terminal_set.interval_arithmetic.taylor import TaylorForm
from swarmstart.terminal_set.proving import hold_margins as growth_module
from swarmstart.terminal_set.proving.hold_margins import Hold, prove_growth
from swarmstart.terminal_set.proving.proof import Limits, Search


def hold_of(dynamics: ca.Function, found: TerminalSet, dt: float) -> Hold:
    e, t = ca.SX.sym("e", len(found.P)), ca.SX.sym("t")
    step = ca.simpleRK(dynamics, 1, 4).expand()
    x_ref, u_ref = ca.DM(found.x_ref), ca.DM(found.u_ref)
    moved = step(x_ref + e, u_ref - ca.DM(found.K) @ e, t) - step(x_ref, u_ref, t)
    return Hold(motion=ca.Function("motion", [e, t], [moved]), P=found.P, dt=dt)


def test_of_a_linear_loop_it_is_what_the_eigenvalues_say() -> None:
    """A double integrator: Runge-Kutta is exact, V(t) = e'Phi(t)'P Phi(t)e."""
    x, u, dt = ca.SX.sym("x", 2), ca.SX.sym("u"), 1.5
    dynamics = ca.Function("f", [x, u], [ca.vertcat(x[1], u)])
    bounds = Reference(
        x_ref=np.zeros(2), u_ref=np.zeros(1), u_lower=-np.ones(1), u_upper=np.ones(1)
    )
    found = sampled_terminal_set(
        dynamics, bounds, dt=dt, Q=np.diag([1.0, 0.01]), R=0.01 * np.eye(1)
    )
    A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    T = np.linalg.inv(np.linalg.cholesky(found.P)).T

    def growth(t: float) -> float:
        block = expm(np.block([[A, B], [np.zeros((1, 3))]]) * t)
        turned = (block[:2, :2] - block[:2, 2:] @ found.K) @ T
        return float(np.linalg.eigvalsh(turned.T @ found.P @ turned)[-1])

    largest = max(growth(t) for t in np.linspace(0, dt, 2001))
    assert largest > 1.05
    hold = hold_of(dynamics, found, dt)
    for alpha in (1e-3, 1e3):
        assert prove_growth(hold, alpha, 1.01 * largest).proven
        below = prove_growth(hold, alpha, 0.99 * largest, work=2)
        assert not below.proven


def undecided_about_centre(
    moved: Callable[[ca.SX, ca.SX], ca.SX],
    growth: float,
    times: tuple[float, float],
    radius: float,
) -> bool:
    """Return whether the bounds leave the box of all radii up to one, along +e."""
    v = ca.SX.sym("v", 2)
    after = moved(v[0], v[1])
    c = ca.Function("growth", [v], [after**2 - growth * v[0] ** 2])
    form = TaylorForm(c, np.eye(2))
    bounds = growth_module._GrowthBounds(form, np.eye(1), times)
    lower, upper = np.array([[0.0], [1.0]]), np.array([[radius], [1.0]])
    return bool(bounds(lower, upper).lower.size)


@pytest.mark.parametrize(("growth", "is_left"), [(1.971, False), (1.969, True)])
def test_all_times_of_an_interval_are_bounded_from_its_middle(
    growth: float, is_left: bool
) -> None:
    """(1 + t) e: 1.3^2 and half of 0.2 s times the fastest change, 2 (1 + 0.4)."""
    moved = undecided_about_centre(lambda e, t: (1 + t) * e, growth, (0.2, 0.4), 1.0)
    assert moved is is_left


@pytest.mark.parametrize(("growth", "is_left"), [(2.0401, False), (2.0399, True)])
def test_rounding_of_the_way_from_the_middle_of_an_interval_is_allowed_for(
    growth: float, is_left: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Made visible: a quarter of the 0.28 that are added to 1.3^2 above."""
    monkeypatch.setattr(growth_module, "PADDING", 0.25)
    moved = undecided_about_centre(lambda e, t: (1 + t) * e, growth, (0.2, 0.4), 1.0)
    assert moved is is_left


@pytest.mark.parametrize(("growth", "is_left"), [(1.1101, False), (1.1099, True)])
def test_third_order_is_that_of_the_whole_way_from_the_centre(
    growth: float, is_left: bool
) -> None:
    """e + a e^2 up to r, a = 1/10 and r = 1/2: 1 + 2 a r + 4 a^2 r^2."""
    moved = undecided_about_centre(
        lambda e, t: e + e**2 / 10 + 0 * t, growth, (0.2, 0.4), 0.5
    )
    assert moved is is_left


@pytest.mark.parametrize(("weight", "growth"), [(1.0, 2.2), (100.0, 1.1)])
def test_the_formation_grows_by_no_more_while_it_is_held(
    formation: ca.Function, leader: Reference, weight: float, growth: float
) -> None:
    found = sampled_terminal_set(
        formation, leader, dt=1.0, Q=np.eye(4), R=np.diag([1.0, weight])
    )
    hold = hold_of(formation, found, 1.0)
    proof = prove_growth(hold, found.alpha, growth)
    assert proof.proven and proof.boxes < 200_000


def test_less_than_what_is_measured_is_never_proven(
    formation: ca.Function, leader: Reference
) -> None:
    """With R = I e'Pe rises to 1.998 times its value after 0.44 s."""
    found = sampled_terminal_set(formation, leader, dt=1.0, Q=np.eye(4), R=np.eye(2))
    hold = hold_of(formation, found, 1.0)
    for growth in (1.0, 1.5, 1.95):
        proof = prove_growth(hold, found.alpha, growth, work=1)
        assert not proof.proven


def of_one(make: Callable[[ca.SX, ca.SX], ca.SX]) -> Hold:
    """A motion of one state over a second, P = 1."""
    e, t = ca.SX.sym("e"), ca.SX.sym("t")
    motion = ca.Function("motion", [e, t], [make(e, t)])
    return Hold(motion=motion, P=np.eye(1), dt=1.0)


def test_growth_beyond_a_kink_is_proven_and_no_less() -> None:
    """At e = 2 the state is 2.1 after a second; up to e = 1 it does not move."""
    hold = of_one(lambda e, t: e + 0.1 * t * ca.fmax(e - 1, 0))
    assert prove_growth(hold, 4.0, 1.01 * 1.05**2).proven
    assert not prove_growth(hold, 4.0, 0.99 * 1.05**2, work=1).proven


def test_of_a_kink_at_the_centre_nothing_is_proven_and_nothing_tried() -> None:
    proof = prove_growth(of_one(lambda e, t: e + 0.1 * t * ca.fabs(e)), 4.0, 2.0)
    assert not proof.proven and proof.boxes == 0
    later = of_one(lambda e, t: e + 0.1 * ca.fmax(t - 0.5 + 0 * e, 0.0) * e)
    assert prove_growth(later, 4.0, 2.0).boxes == 0
    e, t = ca.SX.sym("e", 2), ca.SX.sym("t")
    moved = (1 + 0.1 * ca.fmax(t - 0.5, 0.0)) * e
    motion = ca.Function("motion", [e, t], [moved])
    assert prove_growth(Hold(motion=motion, P=np.eye(2), dt=1.0), 4.0, 2.0).boxes == 0


def test_the_growth_over_an_interval_of_times_counts_and_not_that_in_its_middle() -> (
    None
):
    """e'Pe becomes 1.49 times as much, and 1.22 half way: the one piece is cut."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    dynamics = ca.Function("f", [x, u], [0.2 * x + 0 * u])
    found = TerminalSet(
        K=np.zeros((1, 2)), P=np.eye(2), alpha=1.0, x_ref=np.zeros(2),
        u_ref=np.zeros(1), dt=None, design="own",
    )  # fmt: skip
    hold = replace(hold_of(dynamics, found, 1.0), pieces=1)
    largest = np.exp(0.4)
    assert prove_growth(hold, 1.0, 1.01 * largest).proven
    assert not prove_growth(hold, 1.0, 0.9 * largest, work=1).proven


@pytest.mark.parametrize("low", [0.0, 0.3])
def test_growth_of_two_states_is_bounded_from_above_and_hardly_beyond(
    low: float,
) -> None:
    """(A + t B) e and a part of second order, P by chance; directions in a small box.

    Sampled are radii up to 0.32, directions, and times from 0.5 to 0.51.
    """
    rng, times = np.random.default_rng(8), (0.5, 0.51)
    root, A, B, D = rng.normal(size=(4, 2, 2))
    P = root @ root.T + np.eye(2)
    v = ca.SX.sym("v", 3)
    e, t = v[:2], v[2]
    bent = t * ca.bilin(ca.DM(D), e, e) / 50
    after = (ca.DM(A) + t * ca.DM(B)) @ e + bent
    moved = ca.Function("moved", [v], [ca.bilin(ca.DM(P), after, after)])
    own = ca.Function("own", [v], [ca.bilin(ca.DM(P), e, e)])

    def bounds_of(growth: float) -> growth_module._GrowthBounds:
        change = ca.Function("c", [v], [moved(v) - growth * own(v)])
        return growth_module._GrowthBounds(TaylorForm(change, np.eye(3)), P, times)

    T = bounds_of(1.0)._form._T[:2, :2]
    np.testing.assert_allclose(T.T @ P @ T, np.eye(2), atol=1e-12)
    for axis in (0, 1):
        for end in (-1.0, 1.0):
            lower, upper = np.array([low, end, end]), np.array([0.32, end, end])
            lower[1 + axis], upper[1 + axis] = 0.2, 0.2002
            w = rng.uniform(lower[1:], upper[1:], size=(4000, 2)).T
            rho = rng.uniform(max(low, 1e-3), 0.32, 4000)
            z = rho * w / np.linalg.norm(w, axis=0)
            points = np.vstack([T @ z, rng.choice(times, 4000)])
            most = float((np.array(moved(points)) / np.array(own(points))).max())
            for share, is_left in ((0.999, True), (1.06, False)):
                left = bounds_of(share * most)(lower[:, None], upper[:, None])
                assert bool(left.lower.size) is is_left, (axis, end, share)


@pytest.mark.parametrize(
    ("width", "late_after", "asked", "is_proven"),
    [
        # Never: the last of it is halved down to a part in 1024, looked at longer.
        (0.0, 99, 11, False),
        # All of it in quarters: two intervals and one are cut.
        (0.5, 99, 7, True),
        (2.0, 99, 1, True),
        (0.5, 2, 2, False),
    ],
)
def test_intervals_of_time_are_halved_until_each_is_proven(
    width: float,
    late_after: int,
    asked: int,
    is_proven: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A search that succeeds on intervals up to a width only, of two seconds."""
    tried: list[tuple[float, float]] = []
    most: list[int] = []

    class Bounds:
        defect = 0.0

        def __init__(self, form: object, P: Array, times: tuple[float, float]) -> None:
            self.times = times

    def searched(bounds: Bounds, nx: int, radius: float, *, limits: Limits) -> Search:
        tried.append(bounds.times)
        most.append(limits.max_boxes)
        assert len(tried) < 50 and nx == 1 and radius == pytest.approx(3.0)
        low, high = bounds.times
        return Search(finished=high - low <= width, boxes=10)

    monkeypatch.setattr(growth_module, "_GrowthBounds", Bounds)
    monkeypatch.setattr(growth_module, "search_ball", searched)
    monkeypatch.setattr(
        growth_module, "now", lambda: 0.0 if len(tried) < late_after else 100.0
    )
    hold = replace(of_one(lambda e, t: e + 0 * t), dt=2.0, pieces=1)
    proof = prove_growth(hold, 9.0, 1.5, work=50.0)
    assert (proof.proven, proof.boxes, len(tried)) == (is_proven, 10 * asked, asked)
    assert proof.alpha == 9.0 and tried[0] == (0.0, 2.0)
    assert 0 <= proof.seconds < 60
    if is_proven:  # Without a gap.
        done = sorted(one for one in tried if one[1] - one[0] <= width)
        assert (done[0][0], done[-1][1]) == (0.0, 2.0)
        assert all(a[1] == b[0] for a, b in pairwise(done))
    if width == 0:
        assert tried[-1][1] - tried[-1][0] == 2 / 1024
        assert {*most[:-1]} == {4000} and most[-1] == 400_000
