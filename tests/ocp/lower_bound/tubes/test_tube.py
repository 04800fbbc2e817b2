"""Tubes: every trajectory stays inside, they are tight, and they say when they fail."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from scipy.spatial import ConvexHull, HalfspaceIntersection

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.stated.answer import Tube
from swarmstart.ocp.lower_bound.stated.statement import Statement
from swarmstart.ocp.lower_bound.tubes.tube import NoTubeError, tube_of
from swarmstart.ocp.lower_bound.tubes.tube_set import inside
from swarmstart.tests.ocp.lower_bound.statements import (
    double_integrator,
    pendulum,
    pushed,
    rates,
    reactor,
    stated,
    trajectories,
    unicycle,
    van_der_pol,
)

tube_of_problem = cache(lambda problem: tube_of(problem()))
"""The tube with the settings it has by itself, found once."""

PROBLEMS = (double_integrator, van_der_pol, reactor, unicycle, pendulum, pushed)


def greatest_excess(tube: Tube, times: Array, states: Array) -> float:
    """By how much trajectories (N, n, count) are outside at most."""
    levels = np.array([np.interp(times, tube.times, row) for row in tube.levels.T])
    values = np.einsum("ki,tin->ktn", tube.directions, states)
    return float((values - levels[:, :, None]).max())


def least_margin(
    statement: Statement, tube: Tube, rng: np.random.Generator, count: int = 40_000
) -> float:
    """The least slope - d_k f over random points of all faces, by plain floats."""
    f = rates(statement)
    n, (low, high) = statement.n, statement.control_box
    slab = rng.integers(len(tube.times) - 1, size=count)
    face = rng.integers(len(tube.directions), size=count)
    part = rng.random(count) * (rng.random(count) < 0.8)
    begin, end = tube.times[slab], tube.times[slab + 1]
    start, stop = tube.levels[slab], tube.levels[slab + 1]
    levels = start + (stop - start) * part[:, None]
    box = levels[:, : 2 * n].T
    x = -box[1::2] + (box[0::2] + box[1::2]) * rng.random((n, count))
    # Onto the face: a convex combination with the other side, if it crosses.
    d = tube.directions[face].T
    on = levels[np.arange(count), face]
    x = x + d * (on - (d * x).sum(axis=0))
    is_in = (tube.directions @ x <= levels.T + 1e-12).all(axis=0)
    assert is_in.sum() > 100
    t, x, d = (begin + part * (end - begin))[is_in], x[:, is_in], d[:, is_in]
    share = rng.random((statement.m, is_in.sum()))
    share = np.where(rng.random(share.shape) < 0.7, np.round(share), share)
    u = low[:, None] + (high - low)[:, None] * share
    speed = (d * np.asarray(f.map(t.size)(t[None, :], x, u))).sum(axis=0)
    rows = np.arange(count)
    slope = (stop - start)[rows, face] / (end - begin)
    return float((slope[is_in] - speed).min())


@pytest.mark.parametrize("problem", PROBLEMS)
def test_random_and_bang_bang_trajectories_stay_inside(
    problem: Callable[[], Statement],
) -> None:
    statement = problem()
    times, states = trajectories(statement, np.random.default_rng(0), 400)
    # The integrator's tolerance is 1e-6.
    assert greatest_excess(tube_of_problem(problem), times, states) < 1e-4


@pytest.mark.parametrize("problem", PROBLEMS)
def test_no_point_of_a_face_moves_faster_than_the_face(
    problem: Callable[[], Statement],
) -> None:
    tube, rng = tube_of_problem(problem), np.random.default_rng(1)
    assert least_margin(problem(), tube, rng) > 0.0


def test_a_tube_that_grows_one_percent_slower_fails_both_tests() -> None:
    # The levels of x2 are what trajectories under u = 1 and u = -1 reach, t.
    statement, tube = double_integrator(), tube_of_problem(double_integrator)
    slow = replace(tube, levels=tube.levels[0] + 0.99 * (tube.levels - tube.levels[0]))
    rng = np.random.default_rng(2)
    assert least_margin(statement, slow, rng) < -0.005
    up = stated(lambda _, x, u: [x[1], u[0]], [1, 0], [(1, 1)], 2.1)
    assert greatest_excess(slow, *trajectories(up, rng, 1)) > 0.01
    assert greatest_excess(tube, *trajectories(up, rng, 1)) < 1e-9


def reached(directions: Array, time: float) -> Array:
    """max d'x(t) of x1' = x2, x2' = u, |u| <= 1 from (1, 0).

    d'x(t) = d_1 + integral of (d_1 (t - s) + d_2) u(s) ds, so the integral of its size.
    """
    s = (np.arange(20_000) + 0.5) / 20_000 * time
    weight = directions[:, :1] * (time - s) + directions[:, 1:]
    return np.asarray(directions[:, 0] + np.abs(weight).mean(axis=1) * time)


def test_the_double_integrator_s_reachable_set_is_held_closely() -> None:
    tube = tube_of_problem(double_integrator)
    for knot in (20, 50, -1):
        exact = reached(tube.directions, tube.times[knot])
        assert (tube.levels[knot] - exact).min() > -1e-6  # A sum, not the integral.
        # Levels are linear, x1 is t^2 / 2 on a slab: by half of (t dt) too much.
        assert (tube.levels[knot] - exact)[:2].max() < 0.7 * tube.times[knot] * 0.021
        assert (tube.levels[knot] - exact)[2:4].max() < 1e-6


def area(directions: Array, levels: Array) -> float:
    rows = np.column_stack([directions, -levels])
    return float(
        ConvexHull(
            HalfspaceIntersection(rows, np.array([1.0, 0.0])).intersections
        ).volume
    )


@pytest.mark.parametrize(("faces", "most"), [(32, 1.42), (64, 1.28)])
def test_the_tube_s_area_comes_near_that_of_the_reachable_set(
    faces: int, most: float
) -> None:
    # A face rises as fast as its fastest point: that costs its length, so 1 / faces.
    tube = tube_of(double_integrator(), faces=faces, slabs=50)
    angles = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    exact = area(circle, reached(circle, 2.1))
    assert exact == pytest.approx(2.1**3 * 2 / 3, rel=1e-3)
    assert exact < area(tube.directions, tube.levels[-1]) < most * exact


def test_sizes_of_the_states_that_are_far_off_cost_little() -> None:
    # The same set with x2 and u in units a hundred times larger.
    slow = stated(lambda _, x, u: [100 * x[1], u[0]], [1, 0], [(-0.01, 0.01)], 2.1)
    tube = tube_of(slow, slabs=50)
    assert len(tube.times) < 60
    both = np.array([1.0, 0.01])
    found = area(tube.directions * both, tube.levels[-1])
    assert 2.1**3 * 2 / 3 < found < 1.52 * 2.1**3 * 2 / 3


def test_more_slabs_and_faces_make_a_tube_tighter() -> None:
    coarse, fine = (
        tube_of(van_der_pol(), slabs=slabs, faces=faces)
        for slabs, faces in ((30, 16), (60, 40))
    )
    assert fine.levels[-1, 0] < 0.8 * coarse.levels[-1, 0]


def test_the_van_der_pol_tube_is_as_tight_as_the_published_prototype() -> None:
    tube = tube_of_problem(van_der_pol)
    assert 3.8 < tube.levels[-1, 0] < 6.0  # 3.81 is reached.
    assert 2.42 < tube.levels[-1, 2] < 3.39


def test_the_reactor_stays_near_its_invariant_set() -> None:
    # Its terms r cancel in x1 + x2, without which the tube blows up.
    tube = tube_of_problem(reactor)
    diagonal = np.argmax(tube.directions @ [1.0, 1.0])
    assert (tube.levels[:, diagonal] * np.sqrt(2)).max() < 0.27
    assert tube.levels[:, 1].max() < 0.26
    assert tube.levels[:, 3].max() < 0.53


def test_an_unstable_state_that_no_control_moves_follows_its_one_trajectory() -> None:
    tube = tube_of(stated(lambda t, x, _: [x[0] + ca.sin(t)], [1], [], 3.0), slabs=300)
    exact = 1.5 * np.exp(tube.times) - 0.5 * (np.sin(tube.times) + np.cos(tube.times))
    assert (tube.levels[:, 0] > exact - 1e-12).all()
    assert (-tube.levels[:, 1] < exact + 1e-12).all()
    assert (tube.levels.sum(axis=1) < 0.05 * exact).all()


def test_a_stiff_state_comes_to_rest() -> None:
    tube = tube_of(stated(lambda _, x, u: [-200 * (x[0] - u[0])], [5], [(-1, 1)], 1.0))
    assert tube.levels[-1] == pytest.approx([1, 1], abs=0.1)


def test_a_control_within_its_bounds_counts_where_it_is_extreme_there() -> None:
    # sin(u) is greatest inside [0, 3].
    tube = tube_of(stated(lambda _, x, u: [ca.sin(u[0])], [0], [(0, 3)], 2.0))
    assert 2.0 <= tube.levels[-1, 0] < 2.01
    assert 0.0 <= tube.levels[-1, 1] < 0.01


def test_the_product_of_two_controls_is_extreme_at_their_ends() -> None:
    product = stated(lambda _, x, u: [u[0] * u[1]], [0], [(-1, 2), (-3, 1)], 1.0)
    tube = tube_of(product)
    assert tube.levels[-1] == pytest.approx([3, 6], rel=1e-4)
    assert (tube.levels[-1] >= [3, 6]).all()


@pytest.mark.parametrize("problem", [double_integrator, unicycle])
def test_bounds_of_the_states_clip_the_tube(problem: Callable[[], Statement]) -> None:
    free = problem()
    n = free.n
    low, high = np.full(n, -np.inf), np.full(n, np.inf)
    low[n - 1], high[n - 1] = -0.5, 0.75
    bound = replace(free, state_box=(low, high))
    wide, tube = tube_of_problem(problem), tube_of(bound)
    # It may rise beyond by what a slab takes, 2.1 / 100 at most, and comes back.
    assert tube.levels[:, 2 * n - 2].max() < 0.75 + 0.04
    assert tube.levels[:, 2 * n - 1].max() < 0.5 + 0.04
    assert tube.levels[-1, 2 * n - 2] == pytest.approx(0.75, abs=1e-6)
    assert tube.levels[-1, 0] < wide.levels[-1, 0] + 1e-6
    # Trajectories that keep the bounds are inside.
    times, states = trajectories(bound, np.random.default_rng(3), 200, pieces=10)
    keeps = (states[:, -1] <= 0.75) & (states[:, -1] >= -0.5)
    for k in np.flatnonzero(keeps[:20].all(axis=0)):
        until = int(np.argmin(keeps[:, k])) or len(times)
        kept = states[:until, :, k : k + 1]
        assert greatest_excess(tube, times[:until], kept) < 1e-6


def test_bounds_keep_what_would_blow_up() -> None:
    rate = stated(
        lambda _, x, u: [x[0] ** 2 + u[0]], [1], [(-1, 1)], 2.0, state_box=([-4], [3])
    )
    tube = tube_of(rate)
    assert tube.levels[-1, 0] == pytest.approx(3.0, abs=1e-6)


def test_a_blow_up_says_which_state_and_when() -> None:
    # x1 = 1 / (1 - t).
    rate = stated(lambda _, x, u: [x[0] ** 2, u[0]], [1, 0], [(-1, 1)], 2.0)
    with pytest.raises(NoTubeError, match=r"beyond t = (0\.\d+|1) s: the state x_0"):
        tube_of(rate, slabs=20)


def test_dynamics_that_jump_are_refused() -> None:
    rate = stated(lambda _, x, u: [ca.sign(x[0]) + u[0]], [1], [(-1, 1)], 2.0)
    with pytest.raises(NoTubeError, match="sign, which jumps"):
        tube_of(rate)


def test_dynamics_that_leave_their_domain_are_refused() -> None:
    rate = stated(lambda _, x, u: [-1 / x[0] + u[0]], [1], [(-1, 1)], 2.0)
    with pytest.raises(NoTubeError, match="cannot be bounded"):
        tube_of(rate)


def test_a_jump_at_the_cut_of_atan2_is_not_overlooked() -> None:
    # The derivative of f is 0 all over, f jumps where x2 passes 0, x1 < 0.
    angle = stated(
        lambda _, x, u: [0 * u[0], -1, ca.sin(0.5 * ca.atan2(x[1], x[0]))],
        [-1, 0.5, 0],
        [(0, 0)],
        1.0,
    )
    tube = tube_of(angle, slabs=20)
    times = np.linspace(0, 1, 201)
    speed = np.sin(0.5 * np.arctan2(0.5 - times, -1.0))
    way = np.concatenate([[0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) / 200)])
    states = np.stack([-np.ones(201), 0.5 - times, way], axis=1)[:, :, None]
    assert greatest_excess(tube, times, states) < 0.006  # The sum's error at the jump.


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"x0": np.array([np.nan, 0.0])}, "initial state to be finite"),
        ({"control_box": (np.array([-1.0]), np.array([np.inf]))}, "controls to be fin"),
        ({"horizon": (0.0, np.inf)}, "latest end to be finite"),
        ({"horizon": (0.0, 0.0)}, "must be above 0"),
    ],
)
def test_what_is_no_number_is_refused(change: dict[str, object], found: str) -> None:
    with pytest.raises(NoTubeError, match=found):
        tube_of(replace(double_integrator(), **change))  # type: ignore[arg-type]


def test_four_states_are_refused() -> None:
    rate = stated(lambda _, x, u: [u[0]] * 4, [0] * 4, [(-1, 1)], 1.0)
    with pytest.raises(NoTubeError, match="there are 4"):
        tube_of(rate)


@pytest.mark.parametrize(
    ("slabs", "cells", "faces"), [(0, 8, 32), (9, 0, 32), (9, 8, 20), (9, 8, 0)]
)
def test_numbers_that_make_no_tube_are_refused(
    slabs: int, cells: int, faces: int
) -> None:
    with pytest.raises(NoTubeError, match="at least 1 of slabs"):
        tube_of(double_integrator(), slabs=slabs, cells=cells, faces=faces)


def test_the_error_survives_a_process_border() -> None:
    error = NoTubeError("A reason.")
    assert str(pickle.loads(pickle.dumps(error))) == "A reason."


@pytest.mark.parametrize("problem", PROBLEMS)
def test_a_tube_begins_with_x0_and_ends_at_the_latest_end(
    problem: Callable[[], Statement],
) -> None:
    statement, tube = problem(), tube_of_problem(problem)
    n = statement.n
    assert tube.times[0] == 0.0
    assert tube.times[-1] == statement.horizon[1]
    assert (np.diff(tube.times) > 0).all()
    assert np.array_equal(tube.directions[: 2 * n : 2], np.eye(n))
    assert np.array_equal(tube.directions[1 : 2 * n : 2], -np.eye(n))
    assert inside(tube, np.append(0.0, statement.x0)[:, None]).all()
    assert tube.levels[0, : 2 * n] == pytest.approx(
        np.column_stack([statement.x0, -statement.x0]).ravel(), abs=1e-12
    )
