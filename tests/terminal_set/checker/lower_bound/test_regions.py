"""Tubes, bounds of the states and prunings in exact fractions."""

from __future__ import annotations

import dataclasses
import itertools
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp.lower_bound.certificate import certificate_content
from swarmstart.terminal_set.checker.lower_bound.certificate_file import (
    Certificate,
    Step,
    certificate_of,
)
from swarmstart.terminal_set.checker.lower_bound.controls import split
from swarmstart.terminal_set.checker.lower_bound.polynomials import exact_value
from swarmstart.terminal_set.checker.lower_bound.regions import (
    Region,
    Tube,
    is_cut_off,
    pruned_by,
    stated_tube,
)
from swarmstart.terminal_set.checker.search import Boxes
from swarmstart.tests.ocp.lower_bound import evidence_by_hand as by_hand
from swarmstart.tests.terminal_set.checker.lower_bound.test_tasks import (
    RATES,
    random_evidence,
)
from swarmstart.tests.terminal_set.checker.lower_bound.test_tube import random_tube

NEAR = Fraction(1, 10**12)


def exact(value: float) -> Fraction:
    return Fraction(float(value))


def exact_level(tube: Tube, face: int, t: Fraction) -> Fraction:
    """The level of a face, linear between the times."""
    times, levels = map(exact, tube.times), map(exact, tube.levels[:, face])
    corners = list(zip(times, levels, strict=True))
    for (a, low), (b, high) in itertools.pairwise(corners):
        if a <= t <= b:
            return low + (high - low) * (t - a) / (b - a)
    raise ValueError(f"expected a time of the tube, found {t}")


def far_tube(rng: np.random.Generator, shift: float) -> Tube:
    """A tube about a point far from 0, where rounding is large."""
    tube = random_tube(rng)
    levels = tube.levels + tube.directions @ np.array([shift, -shift])
    return Tube(tube.directions, tube.times, levels)


@pytest.mark.parametrize("shift", [0.0, 1e6])
def test_levels_are_those_of_exact_arithmetic(shift: float) -> None:
    rng = np.random.default_rng(0)
    tube = far_tube(rng, shift)
    t = rng.uniform(0, tube.times[-1], 60)
    t[:14] = tube.times
    stop = np.minimum(t + rng.choice([0.0, 1e-3, 1.0, 4.0], 60), tube.times[-1])
    level, rounding = tube.level_at(t)
    most = tube.highest(t, stop)
    for k in range(len(tube.directions)):
        for i in range(60):
            value = exact_level(tube, k, exact(t[i]))
            size = abs(value) + 2
            assert abs(exact(level[k, i]) - value) <= exact(rounding[k, i])
            assert exact(rounding[k, i]) <= NEAR * size
            corners = [s for s in tube.times if t[i] < s < stop[i]]
            levels = [exact_level(tube, k, exact(s)) for s in [t[i], *corners, stop[i]]]
            assert max(levels) <= exact(most[k, i]) <= max(levels) + NEAR * size


@pytest.mark.parametrize("shift", [0.0, 1e6])
def test_a_cut_leaves_what_each_face_allows_by_itself(shift: float) -> None:
    """x_i <= l_i + (s - the least of d x) / d_i, and likewise from below."""
    rng = np.random.default_rng(1)
    tube = far_tube(rng, shift)
    count = 200
    start = rng.uniform(0, tube.times[-1], count)
    stop = np.minimum(start + rng.choice([0.0, 0.5], count), tube.times[-1])
    low = np.array([[shift], [-shift]]) + rng.uniform(-2, 2, (2, count))
    high = low + rng.choice([0.0, 0.1, 2.0], (2, count))
    boxes = Boxes(np.vstack([start, low]), np.vstack([stop, high]), np.arange(count))
    cut, outside = tube.cut(boxes)
    np.testing.assert_array_equal(cut.slab, boxes.slab)
    np.testing.assert_array_equal(cut.lower[0], start)
    np.testing.assert_array_equal(cut.upper[0], stop)
    changed = 0
    for n in range(count):
        ends = [[exact(low[i, n]), exact(high[i, n])] for i in range(2)]
        kept = [list(pair) for pair in ends]
        room = []
        for k, direction in enumerate(tube.directions):
            d = [exact(entry) for entry in direction]
            corners = [s for s in tube.times if start[n] < s < stop[n]]
            level = max(
                exact_level(tube, k, exact(s)) for s in [start[n], *corners, stop[n]]
            )
            least = sum(d[i] * ends[i][d[i] < 0] for i in range(2))
            room.append(level - least)
            for i in range(2):
                if d[i] > 0:
                    kept[i][1] = min(kept[i][1], ends[i][0] + room[-1] / d[i])
                if d[i] < 0:
                    kept[i][0] = max(kept[i][0], ends[i][1] + room[-1] / d[i])
        assert bool(outside[n]) == (min(room) < 0)
        if outside[n]:
            continue
        for i in range(2):
            near = 100 * NEAR * (abs(exact(shift)) + 4)
            bounds = exact(cut.lower[1 + i, n]), exact(cut.upper[1 + i, n])
            assert kept[i][0] - near <= bounds[0] <= kept[i][0]
            assert kept[i][1] <= bounds[1] <= kept[i][1] + near
            changed += kept[i] != ends[i]
    assert changed > 50
    assert 20 < outside.sum() < 180


@pytest.mark.parametrize("shift", [0.0, 1e6])
def test_points_are_held_up_to_rounding(shift: float) -> None:
    rng = np.random.default_rng(2)
    tube = far_tube(rng, shift)
    t = rng.uniform(0, tube.times[-1], 300)
    face = rng.integers(4, len(tube.directions), 300)
    x = np.array([[shift], [-shift]]) + rng.uniform(-0.3, 0.3, (2, 300))
    for n in range(0, 300, 2):  # On a face but for rounding.
        d = tube.directions[face[n]]
        gap = float(np.interp(t[n], tube.times, tube.levels[:, face[n]]) - d @ x[:, n])
        x[:, n] += d * gap / (d @ d)
    at = np.vstack([t, x])
    points = Boxes(at, at, np.zeros(300, dtype=np.int64))
    held = tube.holds(points)
    but = tube.holds(points, but=4)
    sure = 0
    for n in range(300):
        rooms = [
            exact_level(tube, k, exact(t[n]))
            - sum(exact(d[i]) * exact(x[i, n]) for i in range(2))
            for k, d in enumerate(tube.directions)
        ]
        others = [room for k, room in enumerate(rooms) if k != 4]
        near = 10 * NEAR * (abs(exact(shift)) + 4)
        for found, room in ((held[n], min(rooms)), (but[n], min(others))):
            assert room >= 0 if found else room < near
            sure += bool(found)
    assert 50 < sure < 500


def test_the_initial_state_may_lie_on_a_face() -> None:
    tube = Tube(
        directions=np.array([[0.5, 0.0], [-1.0, 0.0], [1.0, 1.0]]),
        times=np.array([0.0, 1.0]),
        levels=np.array([[0.25, 1.0, 0.75], [9.0, 9.0, 9.0]]),
    )
    assert tube.holds_exactly((0.5, 0.25)) is None
    assert tube.holds_exactly((-1.0, 0.0)) is None
    assert tube.holds_exactly((0.5 + 2**-52, 0.0)) == 0
    assert tube.holds_exactly((-1.0 - 2**-52, 0.0)) == 1
    assert tube.holds_exactly((0.5, 0.25 + 2**-54)) == 2


def with_problem(certificate: Certificate, **changes: object) -> Certificate:
    problem = dataclasses.replace(certificate.problem, **changes)  # type: ignore[arg-type]
    return dataclasses.replace(certificate, problem=problem)


def random_region() -> Region:
    certificate = certificate_of(certificate_content(random_evidence(RATES["affine"])))
    tube = stated_tube(certificate)
    return Region(certificate, split(certificate.problem), tube, tube)


@pytest.mark.parametrize(
    ("direction", "most"),
    [
        ((0.5, 0.25), 0.5 * 2 + 0.25 * 4),
        ((-0.5, 0.25), 0.5 * 3 + 0.25 * 4),
        ((0.5, -0.25), 0.5 * 2 + 0.25 * 1),
        ((0.0, 2.0), 8.0),
        ((-3.0, 0.0), 9.0),
    ],
)
def test_a_face_is_cut_off_from_the_largest_value_within_the_bounds_on(
    direction: tuple[float, float], most: float
) -> None:
    """-3 <= x_0 <= 2, -1 <= x_1 <= 4."""
    certificate = with_problem(
        random_region().certificate, state_box=((-3.0, -1.0), (2.0, 4.0))
    )
    d, below = np.array(direction), float(np.nextafter(most, 0))
    assert is_cut_off(d, (most, most), certificate)
    assert is_cut_off(d, (most, 99.0), certificate)
    assert not is_cut_off(d, (below, most), certificate)
    assert not is_cut_off(d, (most, below), certificate)
    # A bound that is missing counts if the direction needs it.
    for i in range(2):
        for side in range(2):
            box = [[-3.0, -1.0], [2.0, 4.0]]
            box[side][i] = None  # type: ignore[call-overload]
            open_one = with_problem(certificate, state_box=box)
            needed = direction[i] != 0 and (direction[i] > 0) == (side == 1)
            assert is_cut_off(d, (most, most), open_one) is not needed


def test_the_roots_are_the_narrower_of_tube_and_bounds() -> None:
    """Of the axes' largest levels, the bounds of states and those of boxed controls."""
    region = random_region()
    boxed = dataclasses.replace(region.split, boxed=(1, 0))
    for box, low, high in (
        (((None, None), (None, None)), (-2.0, -2.0), (2.0, 2.0)),
        (((-1.0, None), (None, 0.5)), (-1.0, -2.0), (2.0, 0.5)),
        (((-3.0, 0.25), (1.5, 7.0)), (-2.0, 0.25), (1.5, 2.0)),
    ):
        certificate = with_problem(region.certificate, state_box=box)
        found = Region(certificate, region.split, region.tube, region.tube).roots()
        np.testing.assert_array_equal(found.lower[:, 0], [0.0, *low])
        np.testing.assert_array_equal(found.upper[:, 0], [1.0, *high])
        assert found.slab.tolist() == [0]
        found = Region(certificate, boxed, region.tube, region.tube).roots(0.75)
        np.testing.assert_array_equal(found.lower[:, 0], [0.75, *low, -0.5, -1.0])
        np.testing.assert_array_equal(found.upper[:, 0], [1.0, *high, 2.0, 0.5])


def test_a_pruning_is_the_cost_through_a_point_less_the_known() -> None:
    """C(0, x0) - C + G - slack_C t - slack_G (latest - t) - end slack - known."""
    region = random_region()
    ((come, go),) = region.certificate.prunings
    assert (come.slack, go.slack, go.end_slack) == (0.3, 0.1, 0.01)
    certificate = with_problem(region.certificate, horizon=(0.5, 0.75))
    rng = np.random.default_rng(3)
    x0 = certificate.problem.x0
    for slack in (0.01, None):
        pruned = pruned_by(certificate, come, dataclasses.replace(go, end_slack=slack))
        lower = np.vstack([rng.uniform(0, 0.75, 20), rng.uniform(-1, 1, (2, 20))])
        points = Boxes(lower, lower, np.zeros(20, dtype=np.int64))
        wide = Boxes(lower - 0.01, lower + 0.01, points.slab)
        for boxes in (points, wide):
            model = pruned.excess(boxes.variables(), boxes)
            for n in range(20):
                y = tuple(map(float, lower[:, n]))
                cost = exact_value(come, (0.0, *x0)) - exact_value(come, y)
                cost += exact_value(go, y) - Fraction(0.3) * Fraction(y[0])
                cost -= Fraction(0.1) * (Fraction(0.75) - Fraction(y[0]))
                cost -= Fraction(slack or 0.0) + Fraction(0.5)
                assert exact(model.lower[n]) <= cost <= exact(model.upper[n])
                if boxes is points:
                    assert exact(model.upper[n]) - exact(model.lower[n]) < 1e-10


def square(sign: float, known: float) -> tuple[Step, Step]:
    """C = 0 and G = sign x_0^2 - known's own constant: T_2 = 2 x^2 - 1."""
    make = dict(middle=(0.0,) * 3, half=(1.0,) * 3, slack=0.0)
    come = Step(exponents=((0, 0, 0),), coefficients=(0.0,), end_slack=None, **make)  # type: ignore[arg-type]
    go = Step(
        exponents=((0, 2, 0), (0, 0, 0)),
        coefficients=(sign / 2, sign / 2 + known),
        end_slack=0.0,
        **make,  # type: ignore[arg-type]
    )
    return come, go


def constrained_region() -> Region:
    """x_0 - 1 <= 0 along the path, x_1 - 0.5 <= 0 at the end, |u| in [-1, 2]."""
    t, x, u = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("u", 2)
    evidence = random_evidence(RATES["affine"])
    statement = dataclasses.replace(
        evidence.statement,
        time=t, states=x, controls=u, rate=u, stage=u[0] ** 2, end=x[0],
        path=(x[0] - 1.0,), ends=(x[1] - 0.5,),
    )  # fmt: skip
    evidence = dataclasses.replace(evidence, statement=statement)
    certificate = certificate_of(certificate_content(evidence))
    tube = stated_tube(certificate)
    return Region(certificate, split(certificate.problem), tube, tube)


def test_constraints_and_prunings_are_cut_and_held_together() -> None:
    """x_0 <= 1, x_1 <= .5 at the end, and x_0^2 >= .25 is pruned, or x_0^2 <= .04."""
    region = constrained_region()
    ends = region.split.ends
    assert len(region.split.path) == len(ends) == 1
    boxes = Boxes(
        np.array([[0.5, 0.5], [0.75, 0.0], [0.0, 0.5]]),
        np.array([[0.5, 0.5], [1.5, 0.125], [1.0, 0.75]]),
        np.array([3, 4]),
    )
    cut, outside = region.cut_more(boxes)
    np.testing.assert_allclose(cut.upper, [[0.5, 0.5], [1.0, 0.125], [1.0, 0.75]])
    assert not outside.any()
    np.testing.assert_array_equal(cut.slab, boxes.slab)
    cut, outside = region.cut_more(boxes, constraints=ends)
    np.testing.assert_allclose(cut.upper[1:], [[1.0, 0.125], [0.5, 0.5]], atol=1e-12)
    assert not outside.any()
    # x_1 >= .6 is beyond the end's constraint.
    beyond = Boxes(boxes.lower + 0.15 * np.eye(3)[:, 2:], boxes.upper, boxes.slab)
    assert region.cut_more(beyond, constraints=ends)[1].tolist() == [False, True]
    steps = [square(1.0, 0.5 - 0.25), square(-1.0, 0.5 + 0.04)]
    assert region.certificate.known == 0.5
    inner, outer = (pruned_by(region.certificate, *pair) for pair in steps)
    for prunings, expected in (
        ((inner,), [True, False]),
        ((outer,), [False, True]),
        ((inner, outer), [True, True]),
    ):
        smaller = dataclasses.replace(region, prunings=prunings)
        assert smaller.cut_more(boxes)[1].tolist() == expected
    at = np.array([[0.5] * 5, [0.3, 0.45, 0.55, 0.1, 1.1], [0.0] * 5])
    points = Boxes(at, at, np.zeros(5, dtype=np.int64))
    assert region.holds(points).tolist() == [True, True, True, True, False]
    for prunings, held in (
        ((inner,), [True, True, False, True, False]),
        ((outer,), [True, True, True, False, False]),
        ((inner, outer), [True, True, False, False, False]),
    ):
        smaller = dataclasses.replace(region, prunings=prunings)
        assert smaller.holds(points).tolist() == held
    high = Boxes(points.lower + 0.55 * np.eye(3)[:, 2:], points.upper, points.slab)
    high = Boxes(high.lower, high.lower, high.slab)
    assert region.holds(high).tolist() == [True, True, True, True, False]
    assert not region.holds(high, constraints=ends).any()


def test_without_constraints_nothing_is_cut_but_what_is_empty_is_outside() -> None:
    region = random_region()
    boxes = Boxes(np.zeros((3, 2)), np.ones((3, 2)), np.arange(2))
    cut, outside = region.cut_more(boxes)
    assert cut is boxes and not outside.any() and outside.shape == (2,)
    none = Boxes(np.zeros((3, 0)), np.ones((3, 0)), np.arange(0))
    assert constrained_region().cut_more(none)[0].count == 0


def test_the_stated_tube_is_that_of_the_file() -> None:
    certificate = certificate_of(certificate_content(by_hand.quadratic()))
    tube = stated_tube(certificate)
    np.testing.assert_array_equal(tube.directions, [[1.0], [-1.0]])
    np.testing.assert_array_equal(tube.times, [0.0, 1.0])
    np.testing.assert_allclose(tube.levels, [[1.001, -0.999], [3.002, 1.002]])
    assert tube.n == 1
