"""Faces of a tube: their states, how far other faces cut them, and their slopes."""

from __future__ import annotations

import dataclasses
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from swarmstart.terminal_set.checker.lower_bound.regions import Region
from swarmstart.terminal_set.checker.lower_bound.regions import Tube as CheckedTube
from swarmstart.terminal_set.checker.lower_bound.tasks import FaceTask
from swarmstart.terminal_set.checker.search import Boxes
from swarmstart.tests.terminal_set.checker.lower_bound.test_tasks import (
    FACES,
    RATES,
    U,
    X,
    at_points,
    points,
    random_evidence,
    region_of,
    single,
)
from swarmstart.tests.terminal_set.checker.test_boxes import held


def test_roots_of_a_face_are_the_slabs_up_to_the_last_end() -> None:
    region = region_of(random_evidence(RATES["affine"]))
    problem = dataclasses.replace(region.certificate.problem, horizon=(0.5, 0.75))
    certificate = dataclasses.replace(region.certificate, problem=problem)
    region = dataclasses.replace(region, certificate=certificate)
    for face, place in ((0, 1), (3, 2), (4, 2), (5, 2)):
        roots = FaceTask(face, region).roots([1, 0])
        whole = region.roots()
        assert roots.slab.tolist() == [1, 0]
        np.testing.assert_array_equal(roots.lower[0], [0.4, 0.0])
        np.testing.assert_array_equal(roots.upper[0], [0.75, 0.4])
        other = 3 - place
        np.testing.assert_array_equal(roots.lower[place], [0.0, 0.0])
        np.testing.assert_array_equal(roots.upper[place], [0.0, 0.0])
        np.testing.assert_array_equal(roots.lower[other], whole.lower[other].repeat(2))
        np.testing.assert_array_equal(roots.upper[other], whole.upper[other].repeat(2))


@pytest.mark.parametrize("face", range(len(FACES)))
def test_states_of_a_face_lie_on_it(face: int) -> None:
    region, rng = region_of(random_evidence(RATES["affine"])), np.random.default_rng(8)
    task = FaceTask(face, region)
    p = 1 + int(np.abs(FACES[face]).argmax())
    for slab in range(2):
        root = task.roots([slab])
        count = 50
        share = np.sort(rng.uniform(size=(2, 3, count)), axis=0)
        ends = root.lower + share * (root.upper - root.lower)
        boxes = Boxes(ends[0], ends[1], np.full(count, slab))
        models = task._variables(boxes, region.tube)
        placed = task._placed(boxes, models)
        for _ in range(20):
            y = points(rng, boxes)
            level = np.interp(y[0], region.tube.times, region.tube.levels[:, face])
            others = FACES[face] @ y[1:] - FACES[face][p - 1] * y[p]
            on_face = (level - others) / FACES[face][p - 1]
            assert (placed.lower[p] <= on_face).all()
            assert (on_face <= placed.upper[p]).all()
        # It is linear, so at the corners it is reached.
        slope = region.tube.levels[slab + 1, face] - region.tube.levels[slab, face]
        slope /= region.tube.times[slab + 1] - region.tube.times[slab]
        width = boxes.upper - boxes.lower
        whole = np.abs(slope) * width[0] + np.abs(FACES[face]) @ width[1:]
        found = (placed.upper - placed.lower)[p] * np.abs(FACES[face][p - 1])
        np.testing.assert_allclose(found, whole, atol=1e-11)
        np.testing.assert_array_equal(task._taken_back(placed).upper, boxes.upper)
        np.testing.assert_array_equal(task._taken_back(placed).lower, boxes.lower)


def face_boxes(face: int) -> tuple[FaceTask, Boxes, np.random.Generator]:
    """Boxes of a face in a tube, with bounds -1.2 <= x_0 and x_1 <= 1.25."""
    evidence, rng = random_evidence(RATES["affine"]), np.random.default_rng(9)
    region = region_of(evidence)
    box = ((-1.2, None), (None, 1.25))
    problem = dataclasses.replace(region.certificate.problem, state_box=box)
    certificate = dataclasses.replace(region.certificate, problem=problem)
    region = dataclasses.replace(region, certificate=certificate)
    task, count = FaceTask(face, region), 400
    slab = rng.integers(0, 2, count)
    root = task.roots(slab.tolist())
    size = rng.choice([1e-3, 0.1, 0.5], size=root.lower.shape)
    lower = root.lower + rng.uniform(size=size.shape) * (1 - size) * (
        root.upper - root.lower
    )
    boxes = Boxes(lower, lower + size * (root.upper - root.lower), slab)
    return task, boxes, rng


@pytest.mark.parametrize("face", range(len(FACES)))
def test_no_state_of_a_face_within_the_others_is_cut_off(face: int) -> None:
    """States beyond another face, or beyond their bounds, are dropped."""
    task, boxes, rng = face_boxes(face)
    tube, p = task.region.tube, 1 + task._pivot
    cut, outside = task.cut(boxes)
    seen = np.zeros(boxes.count, dtype=bool)
    for _ in range(150):
        y = points(rng, boxes)
        levels = np.array([np.interp(y[0], tube.times, s) for s in tube.levels.T])
        others = FACES[face] @ y[1:] - FACES[face][p - 1] * y[p]
        x = y.copy()
        x[p] = (levels[face] - others) / FACES[face][p - 1]
        rooms = np.delete(levels - FACES @ x[1:], face, axis=0)
        inside = (rooms.min(axis=0) >= 1e-9) & (x[1] >= -1.2) & (x[2] <= 1.25)
        kept = held(cut, y)
        assert kept[inside].all() and not outside[inside].any()
        seen |= inside
    # Of boxes without any such state most are dropped, and others shrink.
    assert outside.any() and seen.any()
    assert (outside | seen).mean() > 0.8


@pytest.mark.parametrize("face", range(len(FACES)))
def test_a_box_of_a_face_is_cut_as_far_as_each_other_face_allows(face: int) -> None:
    """Its room is linear in all coordinates that are left."""
    task, boxes, _ = face_boxes(face)
    cut, outside = task.cut(boxes)
    slab, p = boxes.slab, 1 + task._pivot
    middle, half = boxes.middle, (boxes.upper - boxes.lower) / 2
    tube, direction = task.region.tube, FACES[face]

    def beyond(y: np.ndarray, k: int) -> np.ndarray:
        since = (y[0] - tube.times[slab]) / (tube.times[slab + 1] - tube.times[slab])
        levels = tube.levels[slab].T * (1 - since) + tube.levels[slab + 1].T * since
        x = y.copy()
        x[p] = (levels[face] - direction[2 - p] * y[3 - p]) / direction[p - 1]
        return np.asarray(FACES[k] @ x[1:] - levels[k])

    for k in (k for k in range(len(FACES)) if k != face):
        centre = beyond(middle, k)
        slopes = np.array(
            [beyond(middle + half * unit[:, None], k) - centre for unit in np.eye(3)]
        )
        whole = np.abs(slopes).sum(axis=0)
        for a in (0, 3 - p):
            steep = np.abs(slopes[a]) > 1e-3
            steep &= ~outside
            reach = (whole - centre)[steep] / np.abs(slopes[a])[steep] - 1
            at = np.minimum(reach, 1) * half[a][steep] + 1e-8
            rising = slopes[a][steep] > 0
            low, high = cut.lower[a][steep], cut.upper[a][steep]
            assert (high <= middle[a][steep] + at)[rising].all()
            assert (low >= middle[a][steep] - at)[~rising].all()


def falling(rate: float, axis: int = 0) -> Region:
    """x_a' = rate + u_0, |u_0| <= .5, the other rests; x_a <= s(t), s = 1 - t to .5 s.

    The path constraint is that the other is at most .5.
    """
    rates = [ca.SX(0), ca.SX(0)]
    rates[axis] = rate + U[0]
    evidence = random_evidence(RATES["affine"])
    statement = dataclasses.replace(
        evidence.statement,
        rate=ca.vertcat(*rates),
        control_box=(np.array([-0.5, 0.0]), np.array([0.5, 0.0])),
        path=(X[1 - axis] - 0.5,),
    )
    region = region_of(dataclasses.replace(evidence, statement=statement))
    levels = np.full((2, 4), 9.0)
    levels[:, 2 * axis] = 1.0, 0.5
    tube = CheckedTube(FACES[:4], np.array([0.0, 0.5]), levels)
    return dataclasses.replace(region, tube=tube, stated=tube)


@pytest.mark.parametrize(
    ("rate", "holds"), [(-1.51, True), (-1.5, False), (-1.49, False)]
)
def test_a_face_must_fall_more_slowly_than_the_fastest_state(
    rate: float, holds: bool
) -> None:
    """s' = -1 > rate + .5; at equality it is open, beyond it refuted."""
    region = falling(rate)
    task = FaceTask(0, region)
    box = single([0.0, 0.0, -1.0], [0.5, 0.0, 0.25])
    judged = task.judge(box)
    assert judged.proven[0] == holds
    assert judged.suspect[0] == (rate == -1.49)
    points = at_points((0.25, 0.0, 0.0), (0.25, 0.0, 0.75), (0.25, 0.0, 10.0))
    # Beyond the path constraint, or outside of another face, it does not matter.
    assert task.refuted(points).tolist() == [rate == -1.49, False, False]
    assert not task.refuted(points.only(slice(1, None))).any()
    assert task.shown(points) == (0.25, 0.75, 0.0)
    cut, outside = task.cut_more(single([0.0, 0.0, 0.25], [0.5, 0.0, 1.0]))
    assert cut.upper[2, 0] == pytest.approx(0.5, abs=1e-11)
    assert not outside.any()
    assert task.cut_more(single([0.0, 0.0, 0.75], [0.5, 0.0, 1.0]))[1].all()


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("lower", "upper"), [(None, 0.7), (0.8, None), (0.5, 1.0)])
def test_a_state_of_a_face_beyond_the_bounds_is_no_counterexample(
    lower: float | None, upper: float | None, axis: int
) -> None:
    """At .25 s the face is at .75; the other state is at -3, within [-4, -2]."""
    region = falling(-1.0, axis)
    low: list[float | None] = [-4.0, -4.0]
    high: list[float | None] = [-2.0, -2.0]
    low[axis], high[axis] = lower, upper
    problem = dataclasses.replace(
        region.certificate.problem, state_box=(tuple(low), tuple(high))
    )
    certificate = dataclasses.replace(region.certificate, problem=problem)
    region = dataclasses.replace(region, certificate=certificate)
    at = [0.25, -3.0, -3.0]
    at[1 + axis] = 0.0
    task, point = FaceTask(2 * axis, region), single(at, at)
    within = upper == 1.0
    assert task.refuted(point)[0] == within
    assert task.cut(point)[1][0] != within
    at[1 + axis] = 0.75
    assert task.shown(point) == tuple(at)


@pytest.mark.parametrize("size", [1e-7, 1.0, 1e7])
def test_the_slope_of_a_face_is_known_up_to_rounding(size: float) -> None:
    """With a rate of 0 it is all there is to be compared."""
    rng = np.random.default_rng(10)
    evidence = random_evidence(RATES["affine"])
    statement = dataclasses.replace(evidence.statement, rate=ca.SX(2, 1))
    region = region_of(dataclasses.replace(evidence, statement=statement))
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 1.0, 60))])
    tube = CheckedTube(FACES, times, size * rng.normal(size=(61, len(FACES))))
    region = dataclasses.replace(region, tube=tube, stated=tube)
    slabs = np.arange(60)
    y = np.vstack([times[:-1], np.zeros((2, 60))])
    for face in range(len(FACES)):
        least = FaceTask(face, region)._least(Boxes(y, y, slabs), tube)
        for k in slabs.tolist():
            rise = Fraction(float(tube.levels[k + 1, face])) - Fraction(
                float(tube.levels[k, face])
            )
            slope = rise / (Fraction(float(times[k + 1])) - Fraction(float(times[k])))
            for model in (least.below, least.at):
                low, high = float(model.lower[k]), float(model.upper[k])
                assert Fraction(low) <= slope <= Fraction(high)
                assert high - low <= 1e-11 * size
