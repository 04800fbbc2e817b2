"""The bounds over boxes hold of what CasADi evaluates at points."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp.lower_bound.certificate import certificate_content
from swarmstart.ocp.lower_bound.stated.answer import (
    Evidence,
    Polynomial,
    Pruning,
    Step,
    Tube,
)
from swarmstart.terminal_set.checker.lower_bound.certificate_file import (
    Step as CheckedStep,
)
from swarmstart.terminal_set.checker.lower_bound.certificate_file import certificate_of
from swarmstart.terminal_set.checker.lower_bound.controls import split
from swarmstart.terminal_set.checker.lower_bound.regions import (
    Region,
    pruned_by,
    stated_tube,
)
from swarmstart.terminal_set.checker.lower_bound.tasks import (
    EndTask,
    FaceTask,
    StepTask,
)
from swarmstart.terminal_set.checker.search import Boxes, lowest, pulls
from swarmstart.tests.ocp.lower_bound import evidence_by_hand as by_hand

T, X, U = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("u", 2)
FACES = np.array([[1.0, 0], [-1, 0], [0, 1], [0, -1], [0.6, -0.8], [1, 2]])
RATES = {
    "affine": ca.vertcat(-X[0] + ca.exp(X[1]) * U[0], ca.sin(X[0]) - U[1] * X[1] * T),
    "not affine": ca.vertcat(X[1] * ca.tanh(U[0]), -X[0] + ca.fmax(U[1], X[0])),
}


def random_polynomial(rng: np.random.Generator) -> Polynomial:
    exponents = rng.integers(0, 4, size=(60, 3))
    exponents = np.unique(exponents[exponents.sum(axis=1) <= 5], axis=0)
    return Polynomial(
        middle=rng.normal(size=3) * 0.2,
        half=rng.uniform(0.8, 2.0, size=3),
        exponents=exponents,
        coefficients=rng.normal(size=len(exponents)),
    )


def expression(polynomial: Polynomial) -> ca.SX:
    y, total = ca.vertcat(T, X), ca.SX(0)
    for exponents, c in zip(polynomial.exponents, polynomial.coefficients, strict=True):
        term = ca.SX(float(c))
        for a, e in enumerate(exponents):
            z = (y[a] - polynomial.middle[a]) / polynomial.half[a]
            row = [ca.SX(1), z]
            for _ in range(int(e)):
                row.append(2 * z * row[-1] - row[-2])
            term *= row[int(e)]
        total += term
    return total


def random_evidence(rate: ca.SX) -> Evidence:
    rng = np.random.default_rng(5)
    steps = [
        Step(polynomial=random_polynomial(rng), slack=slack, end_slack=0.01)
        for slack in (0.3, 0.1, 0.2)
    ]
    statement = by_hand.scalar(
        time=T,
        states=X,
        controls=U,
        rate=rate,
        stage=X[0] ** 2 + U[0] ** 2 / 4 + 0.3 * U[1] + ca.cos(X[1] * T),
        end=X[0] * X[1] + T,
        x0=np.array([0.1, -0.2]),
        sizes=np.ones(2),
        control_box=(np.array([-1.0, -0.5]), np.array([0.5, 2.0])),
        state_box=(np.full(2, -np.inf), np.full(2, np.inf)),
    )
    levels = np.array([[1.0] * 6, [1.5, 1.25, 1.0, 0.5, 1.5, 2.0], [2.0] * 6])
    return Evidence(
        statement=statement,
        tube=Tube(directions=FACES, times=np.array([0.0, 0.4, 1.0]), levels=levels),
        prunings=(Pruning(come=steps[0], go=steps[1]),),
        final=steps[2],
        known=0.5,
        bound=0.0,
    )


def region_of(evidence: Evidence) -> Region:
    certificate = certificate_of(certificate_content(evidence))
    tube = stated_tube(certificate)
    return Region(certificate, split(certificate.problem), tube, tube)


def random_boxes(rng: np.random.Generator, region: Region, count: int) -> Boxes:
    root = region.roots()
    width = root.upper - root.lower
    size = rng.choice([0.0, 1e-4, 0.02, 0.2], size=(len(width), count))
    lower = root.lower + rng.uniform(size=size.shape) * (1 - size) * width
    return Boxes(lower, lower + size * width, np.zeros(count, dtype=np.int64))


def points(rng: np.random.Generator, boxes: Boxes) -> np.ndarray:
    share = rng.uniform(size=boxes.lower.shape)
    share = np.where(rng.random(share.shape) < 0.4, np.round(share), share)
    inside = boxes.lower + share * (boxes.upper - boxes.lower)
    return np.asarray(np.clip(inside, boxes.lower, boxes.upper))


def controls(rng: np.random.Generator, region: Region, y: np.ndarray) -> np.ndarray:
    """Random controls, but for those that are coordinates."""
    lower, upper = (np.array(b) for b in region.certificate.problem.control_box)
    u = rng.uniform(size=(2, y.shape[1]))
    u = np.where(rng.random(u.shape) < 0.5, np.round(u), u)
    u = lower[:, None] + u * (upper - lower)[:, None]
    for place, k in enumerate(region.split.boxed):
        u[k] = y[3 + place]
    return np.asarray(u, dtype=np.float64)


@pytest.mark.parametrize("rate", RATES.values(), ids=RATES)
def test_no_point_of_a_box_is_below_the_bound_of_a_step(rate: ca.SX) -> None:
    evidence, rng = random_evidence(rate), np.random.default_rng(0)
    region, statement = region_of(evidence), evidence.statement
    V = expression(evidence.final.polynomial)
    h = ca.gradient(V, T) + statement.stage + ca.gradient(V, X).T @ rate
    exact = ca.Function("h", [T, X, U], [h])
    task = StepTask(region.certificate.final, region)
    boxes = random_boxes(rng, region, 300)
    with np.errstate(all="ignore"):
        lower = lowest(task._least(boxes).below)
    assert np.isfinite(lower).mean() > 0.95
    closest = np.full(300, np.inf)
    for _ in range(150):
        y = points(rng, boxes)
        u = controls(rng, region, y)
        closest = np.minimum(closest, np.array(exact(y[:1], y[1:3], u)).ravel())
    assert not (closest < lower - 1e-11).any()
    # Of points, and of small boxes nearly, it is the least itself.
    thin = (boxes.upper - boxes.lower).max(axis=0) < 1e-3
    assert (closest - lower)[thin].min() < 1e-2


@pytest.mark.parametrize("rate", RATES.values(), ids=RATES)
def test_no_point_of_a_face_is_below_its_bound(rate: ca.SX) -> None:
    evidence, rng = random_evidence(rate), np.random.default_rng(1)
    region = region_of(evidence)
    exact = ca.Function("f", [T, X, U], [rate])
    for face, slab in [(0, 0), (3, 0), (3, 1), (4, 1), (5, 0)]:
        task, count = FaceTask(face, region), 100
        boxes = random_boxes(rng, region, count)
        root = task.roots([slab])
        share = rng.uniform(size=(2, count))
        ends = root.lower[0] + np.sort(share, axis=0) * (root.upper - root.lower)[0]
        boxes.lower[0], boxes.upper[0] = ends
        boxes = task._taken_back(dataclasses.replace(boxes, slab=np.full(count, slab)))
        with np.errstate(all="ignore"):
            lower = lowest(task._least(boxes, region.tube).below)
        slope = np.diff(region.tube.levels[:, face]) / np.diff(region.tube.times)
        direction, p = FACES[face], int(np.abs(FACES[face]).argmax())
        for _ in range(40):
            y = points(rng, boxes)
            u = controls(rng, region, y)
            level = np.interp(y[0], region.tube.times, region.tube.levels[:, face])
            y[1 + p] = (level - direction[1 - p] * y[2 - p]) / direction[p]
            rates = np.array(exact(y[:1], y[1:3], u))
            assert not (slope[slab] - direction @ rates < lower - 1e-9).any()


def test_no_end_is_below_its_bound() -> None:
    evidence, rng = random_evidence(RATES["affine"]), np.random.default_rng(2)
    region = region_of(evidence)
    V = expression(evidence.final.polynomial)
    exact = ca.Function("e", [T, X], [evidence.statement.end - V])
    boxes = random_boxes(rng, region, 300)
    lower = lowest(EndTask(region.certificate.final, region)._excess(boxes))
    for _ in range(50):
        y = points(rng, boxes)
        value = np.array(exact(y[:1], y[1:3])).ravel()
        assert not (value < lower - 1e-11).any()


def test_a_pruning_drops_only_what_costs_more() -> None:
    evidence, rng = random_evidence(RATES["affine"]), np.random.default_rng(3)
    region = region_of(evidence)
    (pair,) = region.certificate.prunings
    pruned = pruned_by(region.certificate, *pair)
    (pruning,) = evidence.prunings
    C, G = (expression(step.polynomial) for step in (pruning.come, pruning.go))
    come = ca.Function("c", [T, X], [C])
    start = float(come(0.0, evidence.statement.x0))
    cost = start - C + G - pruning.come.slack * T - pruning.go.slack * (1 - T) - 0.01
    exact = ca.Function("cost", [T, X], [cost])
    boxes = random_boxes(rng, region, 500)
    region = dataclasses.replace(region, prunings=(pruned,))
    cut, outside = region.cut_more(boxes)
    kept = 0
    for _ in range(100):
        y = points(rng, boxes)
        cheap = np.array(exact(y[:1], y[1:3])).ravel() <= evidence.known - 1e-11
        held = ((cut.lower <= y) & (y <= cut.upper)).all(axis=0)
        assert (held & ~outside)[cheap].all()
        kept += int(cheap.sum())
    assert kept > 1000
    assert outside.sum() > 20


@pytest.mark.parametrize("make", by_hand.ALL)
def test_points_that_hold_are_not_refuted(make: Callable[[], Evidence]) -> None:
    evidence = make()
    region, rng = region_of(evidence), np.random.default_rng(4)
    boxes = random_boxes(rng, region, 500).points()
    if not evidence.prunings and not region.split.path:
        task = StepTask(region.certificate.final, region)
        with np.errstate(all="ignore"):
            assert not task.refuted(boxes).any()


def single(low: list[float], high: list[float], slab: int = 0) -> Boxes:
    return Boxes(np.array([low]).T, np.array([high]).T, np.array([slab]))


@pytest.mark.parametrize("kind", ["step", "end"])
def test_a_box_is_proven_from_its_bound_on_and_suspect_below_its_middle(
    kind: str,
) -> None:
    """At the very slack that the bound needs it is proven, one float below not."""
    evidence, rng = random_evidence(RATES["affine"]), np.random.default_rng(6)
    region = region_of(evidence)
    boxes = random_boxes(rng, region, 40)
    final = region.certificate.final
    make = StepTask if kind == "step" else EndTask
    name = "slack" if kind == "step" else "end_slack"
    task = make(final, region)
    if isinstance(task, StepTask):
        least = task._least(boxes)
        below, at, extra = least.below, least.at.middle, least.pull
    else:
        below = task._excess(boxes)
        at, extra = below.middle, np.zeros((3, 40))
    bound = lowest(below)
    width = boxes.upper - boxes.lower
    shares = width / np.maximum(width.sum(axis=0), 1e-300)
    expected = pulls(below) + extra + below.error * shares
    for k in range(40):
        for slack, proven in ((-bound[k], True), (np.nextafter(-bound[k], -9), False)):
            changed = dataclasses.replace(final, **{name: float(slack)})  # type: ignore[arg-type]
            judged = make(changed, region).judge(boxes)
            assert judged.proven[k] == proven
            np.testing.assert_array_equal(judged.proven, bound >= -slack)
            np.testing.assert_array_equal(judged.suspect, at < -slack)
            np.testing.assert_allclose(judged.pull, expected, rtol=1e-12)
    at_middle = dataclasses.replace(final, **{name: -float(at[7])})  # type: ignore[arg-type]
    assert not make(at_middle, region).judge(boxes).suspect[7]


def test_a_missing_end_slack_is_zero() -> None:
    region = region_of(random_evidence(RATES["affine"]))
    final = region.certificate.final
    boxes = random_boxes(np.random.default_rng(7), region, 50)
    points = boxes.points()
    none, zero, tiny = (
        EndTask(dataclasses.replace(final, end_slack=slack), region)
        for slack in (None, 0.0, 1e-300)
    )
    expected = tiny.judge(boxes)
    assert tiny.refuted(points).any() and expected.suspect.any()
    for task in (none, zero):
        judged = task.judge(boxes)
        np.testing.assert_array_equal(judged.proven, expected.proven)
        np.testing.assert_array_equal(judged.suspect, expected.suspect)
        np.testing.assert_array_equal(task.refuted(points), tiny.refuted(points))


def constrained(**changes: ca.SX | tuple[ca.SX, ...]) -> Region:
    """x' = u, L = x_0 - x_1, phi = x_0 + x_1; x_0 <= .5, and x_1 <= .25 at the end."""
    evidence = random_evidence(RATES["affine"])
    entries: dict[str, ca.SX | tuple[ca.SX, ...]] = {
        "rate": U, "stage": X[0] - X[1], "end": X[0] + X[1],
        "path": (X[0] - 0.5,), "ends": (X[1] - 0.25,),
    }  # fmt: skip
    statement = dataclasses.replace(evidence.statement, **(entries | changes))  # type: ignore[arg-type]
    return region_of(dataclasses.replace(evidence, statement=statement))


def constant_step(region: Region, value: float) -> CheckedStep:
    return dataclasses.replace(
        region.certificate.final,
        exponents=((0, 0, 0),), coefficients=(value,), slack=0.125, end_slack=0.125,
    )  # fmt: skip


def at_points(*points: tuple[float, float, float]) -> Boxes:
    y = np.array(points).T
    return Boxes(y, y, np.zeros(len(points), dtype=np.int64))


def test_points_of_the_region_refute_and_others_do_not() -> None:
    """Of V = 1: L = x_0 - x_1 >= -.125, and V - phi <= .125 where x_1 <= .25 too."""
    region = constrained()
    step = StepTask(constant_step(region, 1.0), region)
    points = at_points(
        (0.1, 0.0, 0.5),  # L = -.5
        (0.1, 0.0, 0.0),
        (0.1, 0.75, 0.99),  # beyond the path constraint
        (0.1, 0.0, 9.0),  # outside of the tube
        (0.1, -0.125, 0.0),  # as much as the slack
        (0.1, -0.126, 0.0),
    )
    assert step.refuted(points).tolist() == [True, False, False, False, False, True]
    assert not step.refuted(points.only(slice(1, 5))).any()
    assert step.shown(points) == (0.1, 0.0, 0.5)
    end = EndTask(constant_step(region, 1.0), region)
    points = at_points(
        (0.1, 0.5, 0.25),  # phi = .75, on the edges of both constraints
        (0.1, 0.4, 0.2),
        (0.1, 0.45, 0.4),  # phi = .85, no end
        (0.1, 0.49, 0.24),
        (0.1, 0.7, 0.0),  # beyond the path constraint
        (0.1, -0.5, 0.2),
        (0.1, 0.75, 0.2),  # phi = .95
    )
    refuted = [False, True, False, True, False, True, False]
    assert end.refuted(points).tolist() == refuted
    assert not end.refuted(points.only(np.array([2, 4]))).any()
    assert end.shown(points.only(slice(1, None))) == (0.1, 0.4, 0.2)


def test_ends_are_cut_by_their_constraints_and_steps_only_by_the_path() -> None:
    region = constrained()
    box = single([0.0, 0.0, 0.0], [0.1, 1.0, 1.0])
    for task, high in (
        (StepTask(constant_step(region, 1.0), region), [0.1, 0.5, 1.0]),
        (EndTask(constant_step(region, 1.0), region), [0.1, 0.5, 0.25]),
    ):
        cut, outside = task.cut_more(box)
        np.testing.assert_allclose(cut.upper[:, 0], high, atol=1e-11)
        assert not outside.any()
        far = single([0.0, 0.0, 0.0], [0.1, 9.0, 9.0])
        np.testing.assert_array_equal(task.cut(far)[0].upper, region.cut(far)[0].upper)
