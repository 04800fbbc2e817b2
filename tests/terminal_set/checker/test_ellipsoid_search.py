"""Branch and bound over an ellipsoid: bounds over boxes hold at every point of them."""

from __future__ import annotations

import math
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

pytest.importorskip("flint")

from swarmstart.arrays import Array
from swarmstart.terminal_set.checker.certificate_file import Certificate
from swarmstart.terminal_set.checker.ellipsoid_search import (
    DecreaseTask,
    quadratic_forms,
)
from swarmstart.terminal_set.checker.ellipsoid_statements import (
    decrease_task,
    growth_task,
    margin_of_map,
    prove_on_set,
)
from swarmstart.terminal_set.checker.findings import NEVER, Deadline
from swarmstart.terminal_set.checker.search import Boxes
from swarmstart.tests.terminal_set.checker.certificates_by_hand import (
    certificate_of,
    chen,
    signed,
)
from swarmstart.tests.terminal_set.checker.changes import after_looks
from swarmstart.tests.terminal_set.checker.systems import (
    as_read,
    change,
    chen_field,
    relative_motion,
)

P = np.array([[16.5926, 11.5926], [11.5926, 16.5926]])
Q_M = [[0.5, 0.125], [0.125, 0.25]]
KINDS = ["moving", "held", "growing"]


def certificate_with(kind: str, alpha: float = 0.5) -> Certificate:
    margin = {"relative_error": 0.0625, "grounds": "measured", "samples": 1}
    between = {"growth": 1.5, "grounds": "proven"} if kind == "growing" else None
    held = {
        "dt": 0.25, "substeps": 2, "statements": [],
        "margins": {"integrator": margin, "between_samples": between},
    }  # fmt: skip
    return as_read(
        chen(Q_m=Q_M, refuted=None, alpha=alpha, **({} if kind == "moving" else held))
    )


def task_of(kind: str, alpha: float = 0.5) -> DecreaseTask:
    certificate = certificate_with(kind, alpha)
    return (growth_task if kind == "growing" else decrease_task)(certificate)


def exact(kind: str, e: Array, time: float) -> float:
    """Return c(e) in floats, from the definition of the statement."""
    certificate = certificate_with(kind)
    if kind == "growing":
        moved = relative_motion(chen_field, certificate, e, time)
        return float(moved @ P @ moved - 1.5 * e @ P @ e)
    more = float(margin_of_map(certificate)) if kind == "held" else 0.0
    return change(chen_field, certificate, e) + more * float(e @ P @ e)


def random_boxes(task: DecreaseTask, width: float, low: float | None) -> Boxes:
    """Boxes of all faces and some pieces of time, within the roots."""
    rng, roots = np.random.default_rng(0), task.roots()
    chosen = roots.only(np.arange(0, roots.count, max(1, roots.count // 16)))
    lower, upper = chosen.lower.copy(), chosen.upper.copy()
    share = rng.random(lower.shape)
    start = lower + share * (1 - width) * (upper - lower)
    stop = start + width * (upper - lower)
    if low is not None:
        stop[0], start[0] = stop[0] - start[0], low
    return Boxes(start, stop, chosen.slab)


def states(task: DecreaseTask, boxes: Boxes, share: Array) -> tuple[Array, Array]:
    """The states at a share of each box, (nx, N), and v = e / s."""
    y = boxes.lower + share * (boxes.upper - boxes.lower)
    e, v = np.zeros((2, task.n, boxes.count))
    for k in range(boxes.count):
        face, piece = boxes.slab[k] % (2 * task.n), boxes.slab[k] // (2 * task.n)
        w = np.insert(y[1 : task.n, k], face // 2, 1.0 - 2.0 * (face % 2))
        v[:, k] = task.T[piece] @ w
        e[:, k] = y[0, k] * v[:, k]
    return e, y


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("width", [1e-4, 0.05, 0.4])
@pytest.mark.parametrize("low", [None, 0.0])
def test_change_over_a_box_encloses_that_at_its_points(
    kind: str, width: float, low: float | None
) -> None:
    """From the centre on, it is that over the square of s."""
    task, rng = task_of(kind), np.random.default_rng(1)
    boxes = random_boxes(task, width, low)
    found = task._change(boxes)
    judged = task.judge(boxes)
    for _ in range(25):
        share = rng.random(boxes.lower.shape)
        e, y = states(task, boxes, share)
        values = np.array([exact(kind, e[:, k], y[-1, k]) for k in range(e.shape[1])])
        assert (values[judged.proven] < 0.0).all()
        scale = np.ones(boxes.count) if low is None else y[0] ** 2
        far = y[0] > 1e-3  # Nearer, the floats of this test are too coarse.
        values = (values / scale)[far]
        assert (found.lower[far] - 1e-8 <= values).all()
        assert (values <= found.upper[far] + 1e-8).all()
    if width < 1e-3:
        assert (found.spread < 0.05 * (1 + np.abs(found.middle))).all()


@pytest.mark.parametrize("kind", KINDS)
def test_roots_and_cuts_keep_every_state_of_the_set(kind: str) -> None:
    task, rng = task_of(kind), np.random.default_rng(2)
    roots = task.roots()
    assert roots.count == 4 * len(task.T)
    assert 0.5 <= roots.upper[0].max() ** 2 < 0.5 * (1 + 1e-9)
    T = task.T[0]
    for share in (1.0, 0.3):
        z = rng.standard_normal((2, 200))
        e = np.linalg.solve(np.linalg.cholesky(P).T, z / np.linalg.norm(z, axis=0))
        e *= math.sqrt(share * 0.5 * (1 - 1e-13))
        w = np.linalg.solve(T, e)
        s = np.abs(w).max(axis=0)
        face = np.abs(w).argmax(axis=0)
        side = w[face, np.arange(200)] < 0
        beside = (w / s)[1 - face, np.arange(200)]
        at = np.vstack([s, beside])
        if task.times is not None:
            at = np.vstack([at, np.full(200, task.times[1] / 3)])
        inside = Boxes(at, at, 2 * face + side)
        cut, outside = task.cut(inside)
        assert not outside.any()
        assert (cut.upper[0] >= s * (1 - 1e-14)).all()
        beyond = Boxes(at * 1.0, at * 1.0, inside.slab)
        beyond.lower[0] *= math.sqrt(1.001 / share)
        assert task.cut(beyond)[1].all()


def plain_task(rng: np.random.Generator, n: int, pieces: int) -> DecreaseTask:
    """Coordinates by chance, without a statement."""
    return DecreaseTask(
        change=None,  # type: ignore[arg-type]
        stated=None,  # type: ignore[arg-type]
        alpha=0.7,
        T=rng.normal(size=(pieces, n, n)) * 10.0 ** rng.integers(-3, 3, (pieces, n, n)),
        delta=rng.uniform(0, 0.2, pieces),
        times=None if pieces == 1 else np.linspace(0, 0.5, pieces + 1),
    )


def boxes_of_faces(rng: np.random.Generator, task: DecreaseTask, count: int) -> Boxes:
    """About all faces and pieces; some are points, some hold the axis of their face."""
    d = task.n + (task.times is not None)
    lower = rng.uniform(-1, 1, (d, count))
    lower[0] = rng.uniform(0.2, 1.2, count)
    upper = lower + rng.choice([0.0, 1e-9, 0.3], (d, count))
    return Boxes(lower, upper, rng.integers(0, 2 * task.n * len(task.T), count))


@pytest.mark.parametrize(("n", "pieces"), [(1, 1), (2, 1), (3, 1), (3, 4)])
def test_a_cut_is_at_the_least_direction_of_the_box(n: int, pieces: int) -> None:
    """s^2 (1 - delta) (1 + the least of |w|^2 beside the face) <= alpha, exactly."""
    rng = np.random.default_rng(n)
    task = plain_task(rng, n, pieces)
    boxes = boxes_of_faces(rng, task, 300)
    cut, outside = task.cut(boxes)
    np.testing.assert_array_equal(cut.lower, boxes.lower)
    np.testing.assert_array_equal(cut.upper[1:], boxes.upper[1:])
    for k in range(300):
        square = Fraction(1)
        for a in range(1, n):
            low, high = (Fraction(float(e[a, k])) for e in (boxes.lower, boxes.upper))
            square += max(low, -high, Fraction(0)) ** 2
        square *= 1 - Fraction(float(task.delta[boxes.slab[k] // (2 * n)]))
        low, high, found = (
            Fraction(float(e[0, k])) for e in (boxes.lower, boxes.upper, cut.upper)
        )
        alpha = Fraction(0.7)
        assert outside[k] == (low**2 * square > alpha)
        if found < high:
            assert alpha <= found**2 * square <= alpha * (1 + Fraction(1, 10**12))
        else:
            assert high**2 * square <= alpha * (1 + Fraction(1, 10**12))
    assert (cut.upper[0] < boxes.upper[0]).any() and 20 < outside.sum() < 280


@pytest.mark.parametrize(("n", "pieces"), [(1, 1), (2, 1), (3, 1), (3, 4)])
def test_directions_are_those_of_the_faces(n: int, pieces: int) -> None:
    """v = T w, with 1 or -1 in the place of the face, linear in the other entries."""
    rng = np.random.default_rng(n)
    task = plain_task(rng, n, pieces)
    boxes = boxes_of_faces(rng, task, 100)
    models = task._directions(boxes)
    for k in range(100):
        face = int(boxes.slab[k]) % (2 * n)
        T = task.T[int(boxes.slab[k]) // (2 * n)]
        others = [j for j in range(n) if j != face // 2]
        s = [Fraction(int(c), 8) for c in rng.integers(-8, 9, len(boxes.lower))]
        w = [Fraction(1 - 2 * (face % 2))] * n
        for a, j in enumerate(others, start=1):
            middle, radius = boxes.middle[a, k], boxes.radius[a, k]
            w[j] = Fraction(float(middle)) + s[a] * Fraction(float(radius))
        for i, model in enumerate(models):
            exact_entry = sum(Fraction(float(T[i, j])) * w[j] for j in range(n))
            size = sum(abs(Fraction(float(T[i, j])) * w[j]) for j in range(n))
            found = Fraction(float(model.middle[k])) + sum(
                Fraction(float(model.coefficients[1 + a, k])) * s[a]
                for a in range(len(boxes.lower))
            )
            off = abs(found - exact_entry)
            assert off <= Fraction(float(model.error[k]))
            most = sum(abs(Fraction(float(T[i, j]))) for j in range(n)) * 2
            assert Fraction(float(model.error[k])) <= most / 2**46 + size / 2**46
            assert Fraction(float(model.error[k])) > 0
            assert not model.coefficients[1 + len(boxes.lower) :, k].any()


@pytest.mark.parametrize(("n", "pieces"), [(1, 1), (3, 1), (2, 3)])
def test_roots_are_all_faces_for_all_times(n: int, pieces: int) -> None:
    task = plain_task(np.random.default_rng(n), n, pieces)
    roots = task.roots()
    assert roots.slab.tolist() == list(range(2 * n * pieces))
    most = np.sqrt(0.7 / (1 - task.delta))
    np.testing.assert_array_equal(roots.lower[0], 0.0)
    np.testing.assert_allclose(roots.upper[0], most.repeat(2 * n), rtol=1e-12)
    assert (roots.lower[1:n] == -1.0).all() and (roots.upper[1:n] == 1.0).all()
    if task.times is not None:
        np.testing.assert_array_equal(roots.lower[n], task.times[:-1].repeat(2 * n))
        np.testing.assert_array_equal(roots.upper[n], task.times[1:].repeat(2 * n))
    cut, outside = task.cut_more(roots)
    assert cut is roots and outside.shape == (2 * n * pieces,) and not outside.any()


def test_quadratic_part_is_nearly_diagonal_and_that_at_the_centre() -> None:
    for kind in KINDS:
        task = task_of(kind)
        with np.errstate(all="ignore"):
            forms = quadratic_forms(task.change, task.T, task.times)
        for k in (0, len(forms) - 1):
            B, T = forms[k], task.T[k]
            np.testing.assert_allclose(T.T @ P @ T, np.eye(2), atol=1e-13)
            assert abs(B[0, 1]) < 1e-11 * np.abs(np.diag(B)).max()
            time = 0.0 if task.times is None else task.times[k : k + 2].mean()
            w = np.array([1.0, -0.3])
            near = [exact(kind, s * T @ w, time) / s**2 for s in (1e-3, 2e-3)]
            assert w @ B @ w == pytest.approx(2 * near[0] - near[1], abs=1e-4)


def test_counterexample_is_a_state_of_the_set_where_v_does_not_fall() -> None:
    certificate = as_read(chen(alpha=3.0, refuted=None))
    outcome = prove_on_set(decrease_task(certificate), NEVER)
    assert not outcome.proven and outcome.counterexample is not None
    e = np.array(outcome.counterexample)
    assert change(chen_field, certificate, e) >= 0
    assert e @ np.array(certificate.P) @ e <= 3.0
    assert outcome.boxes > 0 and outcome.remark == ""


@pytest.mark.parametrize("over", [1e-6, 1e-3, -1e-6])
def test_counterexample_is_told_however_little_v_rises(over: float) -> None:
    """Near where c changes its sign, on a ray from the centre, within the set."""
    certificate = as_read(chen(alpha=3.0, refuted=None))
    task = decrease_task(certificate)
    outcome = prove_on_set(task, NEVER)
    assert outcome.counterexample is not None
    e = np.array(outcome.counterexample)

    def rises(part: float) -> float:
        size = float(part**2 * e @ P @ e)
        return float(change(chen_field, certificate, part * e)) / size

    edge = brentq(lambda part: rises(part) - over, 0.1, 1.0)
    w = np.linalg.solve(task.T[0], edge * e)
    s, face = np.abs(w).max(), int(np.abs(w).argmax())
    at = np.array([[s], [w[1 - face] / s]])
    box = Boxes(at, at, np.array([2 * face + (w[face] < 0)]))
    assert task.refuted(box)[0] == (over > 0)
    assert task.judge(box).proven[0] == (over < 0)
    np.testing.assert_allclose(task.shown(box), edge * e, rtol=1e-6)


def test_search_ends_at_its_limits_with_what_is_left() -> None:
    task = decrease_task(certificate_with("moving"))
    whole = prove_on_set(task, NEVER)
    assert whole.proven and whole.boxes > 4 and whole.remark == ""
    late = prove_on_set(task, Deadline.after(-1.0))
    assert (late.proven, late.boxes) == (False, 0)
    assert late.remark == "4 boxes left in the queue"
    cut = prove_on_set(task, after_looks(1))
    assert (cut.proven, cut.counterexample, cut.boxes) == (False, None, 4)
    assert cut.remark.endswith("boxes left in the queue")


@pytest.mark.parametrize(("weight", "has_margin"), [(0.9, True), (1.1, False)])
def test_linear_part_without_a_margin_is_not_searched(
    weight: float, has_margin: bool
) -> None:
    """Q_m asks for nine tenths of how V falls at 0, or for eleven."""
    K = np.array([[2.118, 2.118]])
    A = np.array([[0.0, 1.0], [1.0, 0.0]]) - 0.5 * np.ones((2, 1)) @ K
    falls = -(A.T @ P + P @ A)
    Q_m = (weight * (falls + falls.T) / 2).tolist()
    content = signed(chen(Q_m=Q_m, alpha=1e-4, refuted=None))
    outcome = prove_on_set(decrease_task(as_read(content)), NEVER)
    assert outcome.proven is has_margin
    assert outcome.remark.startswith("the linear part has no margin") is not has_margin
    assert (outcome.boxes > 0) is has_margin


@pytest.mark.parametrize("dt", [None, 0.5])
def test_one_state_is_searched_without_directions(dt: float | None) -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    f = ca.Function("decay", [x, u], [-x + x**3 + 0 * u])
    for alpha, proven in ((0.98, True), (1.02, False)):
        task = decrease_task(certificate_of(f, [[1.0]], alpha, dt=dt))
        assert prove_on_set(task, NEVER).proven is proven
