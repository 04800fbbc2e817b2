"""Statements on V: at points against floats, on sets up to the first failing level."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest

flint = pytest.importorskip("flint")

from flint import arb  # noqa: E402

from swarmstart.arrays import Array  # noqa: E402
from swarmstart.terminal_set.checker import ellipsoid_statements  # noqa: E402
from swarmstart.terminal_set.checker.decrease import Outcome, Search  # noqa: E402
from swarmstart.terminal_set.checker.ellipsoid_statements import (  # noqa: E402
    PointwiseChange,
    decrease_statement,
    growth_statement,
    margin_of_map,
    prove_decrease,
    prove_growth,
)
from swarmstart.terminal_set.checker.findings import (  # noqa: E402
    NEVER,
    Deadline,
    TimeIsUpError,
)
from swarmstart.tests.terminal_set.checker.certificates_by_hand import (  # noqa: E402
    Content,
    chen,
    scalar,
    signed,
)
from swarmstart.tests.terminal_set.checker.systems import (  # noqa: E402
    as_read,
    change,
    chen_field,
    relative_motion,
)

Q_M = [[0.5, 0.125], [0.125, 0.25]]
CORE = {"level": 1e-9, "drift": 0.03125}


def held(growth: float | None = 1.5, **changes: object) -> Content:
    between = None if growth is None else {"growth": growth, "grounds": "proven"}
    margin = {"relative_error": 0.0625, "grounds": "measured", "samples": 1}
    return chen(
        dt=0.25, substeps=2, Q_m=Q_M, statements=[], alpha=0.5, refuted=None,
        core=CORE, margins={"integrator": margin, "between_samples": between},
        **changes,
    )  # fmt: skip


def moving() -> Content:
    return chen(Q_m=Q_M, core=CORE, refuted=None, alpha=0.5)


def points() -> list[Array]:
    return list(0.1 * np.random.default_rng(0).normal(size=(4, 2)))


def test_margin_is_that_of_the_map_and_the_drift_together() -> None:
    error = 0.0625 + 0.03125
    assert float(margin_of_map(as_read(held())).mid()) == 2 * error + error**2


@pytest.mark.parametrize("content", [moving(), held()])
def test_change_at_a_point_is_that_of_the_definition(content: Content) -> None:
    certificate = as_read(content)
    pointwise, P = PointwiseChange(certificate), np.array(certificate.P)
    for e in points():
        V = float(e @ P @ e)
        ball = pointwise.level([arb(entry) for entry in e])
        assert float(ball.mid()) == pytest.approx(V, rel=1e-13)
        error = 0.0625 + 0.03125
        more = 2 * 0.03125 * V if certificate.dt is None else (2 * error + error**2) * V
        expected = change(chen_field, certificate, e) + more
        found = pointwise.change(tuple(e))
        assert float(found.mid()) == pytest.approx(expected, rel=1e-12)


def test_excess_is_what_v_grows_beyond_its_bound_at_a_time() -> None:
    certificate = as_read(held())
    P = np.array(certificate.P)
    for e in points():
        for time in (0.0, 0.125, 0.25):
            moved = relative_motion(chen_field, certificate, e, time)
            found = PointwiseChange(certificate).excess(tuple(e), time)
            expected = moved @ P @ moved - 1.5 * e @ P @ e
            assert float(found.mid()) == pytest.approx(expected, rel=1e-12)


def test_counterexamples_are_inside_the_set_and_not_its_centre() -> None:
    """x' = +e: V rises everywhere, in the set (|e| <= 1) and beyond."""
    content = scalar()
    content["dynamics"]["tape"][2] = ["sub", 0, 1]
    rising = PointwiseChange(as_read(signed(content)))
    assert rising.is_inside((1.0,)) and rising.violates_decrease((1.0,), 0.0)
    assert rising.is_inside((-0.5,)) and rising.violates_decrease((-0.5,), 0.0)
    for e in (0.0, 1.0000001, -1.1):
        assert not rising.is_inside((e,))
        assert not rising.violates_decrease((e,), 0.0)
    still = dataclasses.replace(
        rising.certificate, tape=(("const", (), 0.0),), xdot=(0,)
    )
    assert PointwiseChange(still).violates_decrease((0.5,), 0.0)  # Equal
    falling = PointwiseChange(as_read(scalar()))
    assert falling.is_inside((0.5,)) and not falling.violates_decrease((0.5,), 0.0)


def test_growth_fails_where_it_is_exceeded_or_met() -> None:
    """x' = +e held 1 s: V is multiplied by 2.70833^2 = 7.335 of Runge-Kutta."""
    content = scalar(dt=1.0)
    content["dynamics"]["tape"][2] = ["sub", 0, 1]
    exact = (1 + 1 + 1 / 2 + 1 / 6 + 1 / 24) ** 2
    for growth, fails in ((exact * (1 - 1e-9), True), (exact * (1 + 1e-9), False)):
        content["margins"]["between_samples"] = {"growth": growth, "grounds": "proven"}
        pointwise = PointwiseChange(as_read(signed(content)))
        assert pointwise.violates_growth((0.5,), 1.0) is fails
        assert not pointwise.violates_growth((1.5,), 1.0)
        assert not pointwise.violates_growth((0.5,), 0.5)


@pytest.mark.parametrize("content", [moving(), held()])
def test_decrease_is_stated_on_a_ball_that_holds_the_set(content: Content) -> None:
    certificate = as_read(content)
    statement = decrease_statement(certificate, NEVER)
    T, P = np.array(statement.T), np.array(certificate.P)
    np.testing.assert_allclose(T.T @ P @ T, np.eye(2), atol=1e-13)
    assert math.sqrt(0.5) <= statement.radius < math.sqrt(0.5) * (1 + 1e-9)
    dt = certificate.dt or 0.0
    assert statement.times == (dt, dt)
    image = np.array(
        [[float(x.mid()) for x in row] for row in statement.image.tolist()]
    )
    M = np.array([[float(x.mid()) for x in row] for row in statement.M.tolist()])
    Q_m = np.array(Q_M)
    if certificate.dt is None:
        np.testing.assert_allclose(image, T.T @ P, rtol=1e-12)
        Q_m = Q_m + 2 * 0.03125 * P
        assert statement.scale is None and statement.constant == 0
    else:
        np.testing.assert_allclose(image @ T, np.eye(2), atol=1e-12)
        assert statement.scale is not None and statement.scale >= 1
        error = 0.0625 + 0.03125
        weight = float(statement.constant.mid())
        assert weight == pytest.approx(-(1 - 2 * error - error**2), rel=1e-12)
    np.testing.assert_allclose(M, T.T @ Q_m @ T, rtol=1e-6)
    # Nearly diagonal: what the bounds of the search are tight for.
    form = [
        [float(x.mid()) for x in row]
        for row in Search(statement, NEVER).quadratic_form(statement.times).tolist()
    ]
    assert abs(form[0][1]) < 1e-11 * max(abs(form[0][0]), abs(form[1][1]))


def test_growth_is_stated_for_its_times_without_a_reserve() -> None:
    statement = growth_statement(as_read(held()), (0.0625, 0.125))
    assert statement.times == (0.0625, 0.125)
    assert float(statement.constant.mid()) == pytest.approx(-1.5, rel=1e-12)
    assert all(float(entry.mid()) == 0 for entry in statement.M.entries())
    points = (0.05, 0.02)
    certificate = as_read(held(growth=0.25))
    below = growth_statement(certificate, (0.0, 0.25))
    assert below.is_counterexample(points, 0.0)
    assert not statement.is_counterexample(points, 0.0)


@pytest.mark.parametrize(("share", "proven"), [(0.97, True), (1.03, False)])
def test_cubic_system_is_proven_up_to_its_pole_and_not_beyond(
    share: float, proven: bool
) -> None:
    """x' = -x + x^3: V falls up to |e| = 1."""
    content = scalar(alpha=share)
    content["dynamics"] = {
        "nx": 1, "nu": 1,
        "tape": [["x", 0], ["sq", 0], ["mul", 0, 1], ["sub", 2, 0]], "xdot": [3],
    }  # fmt: skip
    found = prove_decrease(as_read(signed(content)), NEVER)
    assert found.proven is proven
    assert (found.counterexample is None) is proven
    with pytest.raises(TimeIsUpError):
        prove_decrease(as_read(signed(content)), Deadline.after(-1.0))


@pytest.mark.parametrize(("share", "proven"), [(1.001, True), (0.999, False)])
def test_growth_is_proven_down_to_what_it_is(share: float, proven: bool) -> None:
    """x' = +e held 0.25 s: at the end V is the square of Runge-Kutta's polynomial."""
    content = scalar(dt=0.25)
    content["dynamics"]["tape"][2] = ["sub", 0, 1]
    h = 0.25
    exact = (1 + h + h**2 / 2 + h**3 / 6 + h**4 / 24) ** 2
    between = {"growth": share * exact, "grounds": "proven"}
    content["margins"]["between_samples"] = between
    certificate = as_read(signed(content))
    found = prove_growth(certificate, NEVER)
    assert found.proven is proven
    if not proven:
        assert found.counterexample is not None
        assert PointwiseChange(certificate).violates_growth(found.counterexample, 0.25)
        assert found.remark.startswith("in t = 0.2461 to 0.25 s")


def test_hold_is_searched_piece_by_piece_and_hard_pieces_are_halved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two of 64 pieces are not decided at first; all of the hold is in the end."""
    seen: list[tuple[tuple[float, float], float]] = []
    hard = {(0.0, 1 / 64), (1 / 64, 1.5 / 64)}

    class Watched(Search):
        __slots__ = ()

        def run(self) -> Outcome:
            times = self.statement.times
            seen.append((times, self.most_boxes))
            return Outcome(proven=times not in hard, counterexample=None, boxes=2)

    monkeypatch.setattr(ellipsoid_statements, "Search", Watched)
    content = scalar(dt=1.0)
    content["margins"]["between_samples"] = {"growth": 9.0, "grounds": "proven"}
    certificate = as_read(signed(content))
    found = prove_growth(certificate, NEVER)
    tried = [times for times, _ in seen]
    proven = sorted(times for times in tried if times not in hard)
    assert found.proven and found.boxes == 2 * len(seen) == 2 * (64 + 2)
    assert proven[0] == (0.0, 0.5 / 64) and proven[-1] == (63 / 64, 1.0)
    assert all(a[1] == b[0] for a, b in pairwise(proven))
    assert {most for _, most in seen} == {2000}
    assert tried[0] == (0.0, 1 / 64)  # The shortest times first.


def test_piece_of_time_that_is_never_decided_ends_the_proof(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    limits: list[tuple[float, float]] = []

    class Never(Search):
        __slots__ = ()

        def run(self) -> Outcome:
            low, high = self.statement.times
            limits.append((high - low, self.most_boxes))
            return Outcome(proven=False, counterexample=None, boxes=3, remark="stuck")

    monkeypatch.setattr(ellipsoid_statements, "Search", Never)
    content = scalar(dt=1.0)
    content["margins"]["between_samples"] = {"growth": 9.0, "grounds": "proven"}
    certificate = as_read(signed(content))
    found = prove_growth(certificate, NEVER)
    widths = [width for width, _ in limits]
    assert widths == [2.0**-k for k in range(6, 14)]  # Below 2^-12 of dt it ends,
    assert [most for _, most in limits] == [2000] * 7 + [math.inf]  # with all boxes.
    assert (found.proven, found.boxes) == (False, 3 * 8)
    assert found.remark == "in t = 0 to 0.0001221 s: stuck"
    limits.clear()
    # Time that passes in the search: the piece is not halved any more.
    monkeypatch.setattr(Never, "run", _out_of_time)
    deadline = Deadline.after(0.5)
    late = prove_growth(certificate, deadline)
    assert (late.proven, late.boxes, late.remark) == (
        False,
        1,
        "in t = 0 to 0.01562 s: late",
    )


def _out_of_time(search: Search) -> Outcome:
    while not search.deadline.has_passed:
        pass
    return Outcome(proven=False, counterexample=None, boxes=1, remark="late")
