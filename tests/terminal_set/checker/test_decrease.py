"""The search of the checker: its bounds against q in floats, by differences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

flint = pytest.importorskip("flint")

from flint import arb  # noqa: E402

from swarmstart.terminal_set.checker.decrease import (  # noqa: E402
    Box,
    Interval,
    Outcome,
    Search,
)
from swarmstart.terminal_set.checker.ellipsoid_statements import (  # noqa: E402
    decrease_statement,
    growth_statement,
    margin_of_map,
)
from swarmstart.terminal_set.checker.findings import (  # noqa: E402
    NEVER,
    Deadline,
    TimeIsUpError,
)
from swarmstart.tests.terminal_set.checker.certificates_by_hand import (  # noqa: E402
    certificate_of,
    chen,
    signed,
)
from swarmstart.tests.terminal_set.checker.systems import (  # noqa: E402
    as_read,
    change,
    chen_field,
    relative_motion,
)

Q_M = [[0.5, 0.125], [0.125, 0.25]]
RHO = 1


def held(substeps: int = 2, growth: float | None = None) -> dict[str, object]:
    """The example, its input held 0.25 s; nothing about it is proven here."""
    between = None if growth is None else {"growth": growth, "grounds": "proven"}
    margin = {"relative_error": 1e-3, "grounds": "measured", "samples": 1}
    return chen(
        dt=0.25, substeps=substeps, Q_m=Q_M, statements=[], alpha=0.5, refuted=None,
        margins={"integrator": margin, "between_samples": between},
    )  # fmt: skip


def moving() -> dict[str, object]:
    return chen(Q_m=Q_M, refuted=None, alpha=0.5)


class Known:
    """A search, and its q in floats from the definition of the statement.

    Attributes:
        search: For the statement.
    """

    def __init__(self, kind: str, times: Interval = (0.0625, 0.125)) -> None:
        self._kind = kind
        self._c = as_read({"moving": moving(), "held": held()}.get(kind, held(2, 1.5)))
        if kind == "growing":
            self.search = Search(growth_statement(self._c, times), NEVER)
        else:
            self.search = Search(decrease_statement(self._c), NEVER)
        self.T = np.array(self.search.statement.T)

    def q(self, centre: Sequence[float]) -> float:
        """Return c(e) / rho^2 at (t, rho, w)."""
        time, rho, *w = centre
        e = rho * self.T @ np.array(w) / np.linalg.norm(w)
        P = np.array(self._c.P)
        if self._kind == "growing":
            moved = relative_motion(chen_field, self._c, e, time)
            return float(moved @ P @ moved - 1.5 * e @ P @ e) / rho**2
        found = change(chen_field, self._c, e)
        if self._kind == "held":
            found += float(margin_of_map(self._c).mid()) * float(e @ P @ e)
        return found / rho**2

    def slope(self, centre: Sequence[float], k: int) -> float:
        """Return the derivative of q along one coordinate of (t, rho, w)."""
        h, ends = 1e-5, []
        for side in (h, -h):
            at = list(centre)
            at[k] += side
            ends.append(self.q(at))
        return (ends[0] - ends[1]) / (2 * h)


KINDS = ["moving", "held", "growing"]


def centres(kind: str) -> list[list[float]]:
    rng = np.random.default_rng(0)
    time = {"moving": 0.0, "held": 0.25}
    found = []
    for side in (1.0, -1.0):
        for face in (0, 1):
            w = rng.uniform(-0.9, 0.9, 2)
            w[face] = side
            at = time.get(kind, float(rng.uniform(0.07, 0.12)))
            found.append([at, float(rng.uniform(0.2, 0.6)), *w.tolist()])
    return found


def around(kind: str, centre: list[float], width: float) -> Box:
    """Return a box around a point, none of whose face is left."""
    widths = [width if kind == "growing" else 0.0, width]
    widths += [0.0 if abs(entry) == 1 else width for entry in centre[2:]]
    widths[0] *= 0.01
    return tuple((c - h / 2, c + h / 2) for c, h in zip(centre, widths, strict=True))


def ends(ball: arb) -> tuple[float, float]:
    return float(ball.lower()), float(ball.upper())


@pytest.mark.parametrize("kind", KINDS)
def test_value_is_the_change_over_the_square_of_the_radius(kind: str) -> None:
    known = Known(kind)
    for centre in centres(kind):
        value = known.search.value(centre)
        # The reserve is raised by a part in 1e9 of Q_m.
        assert float(value.mid()) == pytest.approx(known.q(centre), abs=1e-8)
        assert float(value.rad()) < 1e-10
        at_zero = float(known.search.value([centre[0], 0.0, *centre[2:]]).mid())
        near = [known.q([centre[0], rho, *centre[2:]]) for rho in (1e-3, 2e-3)]
        assert at_zero == pytest.approx(2 * near[0] - near[1], abs=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_gradient_over_a_tiny_box_is_that_at_its_point(kind: str) -> None:
    known = Known(kind)
    for centre in centres(kind):
        box = around(kind, centre, 1e-8)
        gradient = known.search._gradient(box, known.search._ray(box))
        for k in range(1 if kind != "growing" else 0, len(centre)):
            low, high = ends(gradient[k])
            size = 1 + abs(known.slope(centre, k))
            assert (low + high) / 2 == pytest.approx(
                known.slope(centre, k), abs=1e-4 * size
            )
            assert high - low < 1e-5 * size


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("width", [0.02, 0.15])
@pytest.mark.parametrize("low", [None, 0.0])
def test_bounds_over_a_box_hold_at_its_points(
    kind: str, width: float, low: float | None
) -> None:
    """The gradient too where the box begins at the origin."""
    known, rng = Known(kind), np.random.default_rng(1)
    for centre in centres(kind):
        box = around(kind, centre, width)
        if low is not None:
            box = (box[0], (low, width), *box[2:])
        ray = known.search._ray(box)
        bound = ends(known.search._separate_bound(box, ray))[1]
        gradient = known.search._gradient(box, ray)
        values = []
        for _ in range(25):
            at = [float(rng.uniform(*interval)) for interval in box]
            at[RHO] = max(at[RHO], 1e-3)
            values.append(known.q(at))
            for k in range(1 if kind != "growing" else 0, len(at)):
                least, most = ends(gradient[k])
                slope = known.slope(at, k)
                assert least - 1e-5 <= slope <= most + 1e-5
        assert max(values) <= bound + 1e-8
        if width < 0.1 and low is not None:
            assert bound <= max(values) + 4 * width


@pytest.mark.parametrize("kind", KINDS)
def test_bound_of_parts_is_exact_in_one_direction_near_the_centre(kind: str) -> None:
    """Of a quotient that is nearly straight in rho: its ends are 0 and the reach."""
    known, reach = Known(kind), 1e-2
    for time, _, *w in centres(kind):
        box = ((time, time), (0.0, reach), *((entry, entry) for entry in w))
        ray = known.search._ray(box)
        found = ends(known.search._separate_bound(box, ray))[1]
        near = [known.q([time, rho, *w]) for rho in (1e-3, 2e-3, reach)]
        assert found == pytest.approx(max(2 * near[0] - near[1], near[2]), abs=1e-5)


def flat(search: Search) -> float:
    return float(search.statement.radius)


@pytest.mark.parametrize("kind", ["moving", "held"])
def test_boxes_are_decided_as_q_says(kind: str) -> None:
    known = Known(kind)
    decided, refuted = 0, 0
    for angle in np.linspace(0, 2 * np.pi, 25):
        w = np.array([np.cos(angle), np.sin(angle)])
        w /= np.abs(w).max()
        for rho in (0.3, 0.69, 2.0, 4.0):
            centre = [{"moving": 0.0, "held": 0.25}[kind], rho, *w.tolist()]
            q = known.q(centre)
            left = known.search.judge(around(kind, centre, 1e-5))
            if q < -1e-3:
                assert left == []
                decided += 1
            if q > 1e-3:
                # Beyond the set that is no counterexample.
                assert left != []
                if isinstance(left, Outcome):
                    assert left.counterexample is None and not left.proven
                refuted += 1
    assert decided > 20 and refuted > 10


def test_counterexample_is_a_state_of_the_set_where_v_does_not_fall() -> None:
    certificate = as_read(chen(alpha=3.0, refuted=None))
    search = Search(decrease_statement(certificate), NEVER)
    outcome = search.run()
    assert not outcome.proven and outcome.counterexample is not None
    e = np.array(outcome.counterexample)
    assert change(chen_field, certificate, e) >= 0
    assert e @ np.array(certificate.P) @ e <= 3.0
    assert outcome.boxes > 0 and outcome.remark == ""


@pytest.mark.parametrize("over", [1e-6, 1e-3])
def test_counterexample_is_told_however_little_v_rises(over: float) -> None:
    """Near where q changes its sign, on a ray from the centre, within the set."""
    certificate = as_read(chen(alpha=3.0, refuted=None))
    search = Search(decrease_statement(certificate), NEVER)
    outcome = search.run()
    assert outcome.counterexample is not None
    e, P = np.array(outcome.counterexample), np.array(certificate.P)

    def rises(part: float) -> float:
        size = float(part**2 * e @ P @ e)
        return float(change(chen_field, certificate, part * e)) / size

    edge = brentq(lambda part: rises(part) - over, 0.1, 1.0)
    T = np.array(search.statement.T)
    w = np.linalg.solve(T, e)
    rho, w = edge * np.linalg.norm(w), w / np.abs(w).max()
    box = ((0.0, 0.0), (rho, rho * (1 + 1e-12)), *((one, one) for one in w.tolist()))
    found = search.judge(box)
    assert isinstance(found, Outcome) and found.counterexample is not None
    np.testing.assert_allclose(found.counterexample, edge * e, rtol=1e-6)


def test_search_begins_with_all_faces_of_the_cube_and_the_whole_radius() -> None:
    search = Known("growing").search
    radius = flat(search)
    assert 0.5 <= radius**2 < 0.5 * (1 + 1e-9)
    full, right, left = (-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0)
    expected = {
        ((0.0625, 0.125), (0.0, radius), *w)
        for w in ((right, full), (left, full), (full, right), (full, left))
    }
    boxes = search._start()
    assert set(boxes) == expected and len(boxes) == 4


def test_point_is_on_the_ray_a_hair_inside() -> None:
    search = Known("moving").search
    T = np.array(search.statement.T)
    e = np.array(search.point([0.0, 0.5, 1.0, -0.5]))
    w = np.array([1.0, -0.5])
    exact = 0.5 * T @ w / np.linalg.norm(w)
    np.testing.assert_allclose(e, exact, rtol=1e-12)
    P = np.array([[16.5926, 11.5926], [11.5926, 16.5926]])
    assert e @ P @ e < exact @ P @ exact * (1 - 1e-13)


def monotone(slopes: list[arb]) -> Box:
    """Return what is left of a box if the gradient has these signs."""
    search = Known("growing").search
    box = ((0.0625, 0.125), (0.25, 0.5), (1.0, 1.0), (-0.5, 0.25))
    seen: list[Box] = []

    class Watched(Search):
        __slots__ = ()

        def _gradient(self, box: Box, ray: object) -> list[arb]:
            return slopes

        def _separate_bound(self, box: Box, ray: object) -> arb:
            return arb(1)

        def value(self, centre: Sequence[float]) -> arb:
            return arb(0)

        def _split(self, face: Box, weights: list[arb]) -> list[Box] | Outcome:
            seen.append(face)
            return []

    Watched(search.statement, NEVER).judge(box)
    return seen[0]


def test_where_q_is_monotone_only_the_larger_end_is_looked_at() -> None:
    both, up, down = arb(-1).union(arb(1)), arb(2), arb(-2)
    first, last = (0.0625, 0.125), (-0.5, 0.25)
    face = (1.0, 1.0)
    assert monotone([up, down, both, both]) == (
        (0.125, 0.125), (0.25, 0.25), face, last
    )  # fmt: skip
    assert monotone([both, both, up, up]) == (first, (0.25, 0.5), face, (0.25, 0.25))
    assert monotone([arb(0), both, up, down]) == (
        (0.125, 0.125), (0.25, 0.5), face, (-0.5, -0.5)
    )  # fmt: skip
    edge = arb(0).union(arb(1))  # From 0 on: it does not fall.
    assert monotone([both, edge, up, both])[1][1] == 0.5


def test_box_is_cut_where_the_slope_times_the_width_is_largest() -> None:
    search = Known("growing").search
    box = ((0.0625, 0.125), (0.25, 0.5), (1.0, 1.0), (-0.5, 0.25))

    def cut(weights: list[float]) -> list[Box] | Outcome:
        return search._split(box, [arb(weight) for weight in weights])

    low, high = ((0.25, 0.375), (0.375, 0.5))
    assert cut([1, 3, 9, 2]) == [(box[0], part, *box[2:]) for part in (low, high)]
    parts = ((-0.5, -0.125), (-0.125, 0.25))
    assert cut([1, 3, 9, 4]) == [(*box[:3], part) for part in parts]
    assert cut([0, 0, 9, 0]) == [
        (part, *box[1:]) for part in ((0.0625, 0.09375), (0.09375, 0.125))
    ]
    # Unknown slopes: the relatively widest first; rho has 0.25 of 0.707, w 0.75.
    assert cut([math.inf, math.inf, 0, math.inf]) == cut([0, 0, 0, 1])
    assert cut([1e9, math.nan, 0, 0]) == cut([0, 1, 0, 0])
    # The time has 0.0625 of 0.125, more than rho.
    assert cut([math.inf, math.inf, 0, 0]) == cut([1, 0, 0, 0])
    point = tuple((low, low) for low, _ in box)
    found = search._split(point, [arb(1)] * 4)
    assert isinstance(found, Outcome)
    e = np.array(search.point([0.0625, 0.25, 1.0, -0.5]))
    shown = ", ".join(f"{entry:.6g}" for entry in e)
    assert (found.proven, found.counterexample) == (False, None)
    assert found.remark == f"no bound decides the single point e = ({shown})"


def test_search_ends_at_its_limits_with_what_is_left() -> None:
    statement = decrease_statement(as_read(moving()))
    whole = Search(statement, NEVER).run()
    assert whole.proven and whole.boxes > 8 and whole.remark == ""
    for most in (0, 3):
        cut = Search(statement, NEVER, most).run()
        assert (cut.proven, cut.counterexample, cut.boxes) == (False, None, most)
        assert cut.remark.endswith("boxes left in the queue")
    assert Search(statement, NEVER, 0).run().remark == "4 boxes left in the queue"
    assert Search(statement, NEVER, whole.boxes).run().proven
    late = Search(statement, Deadline.after(-1.0)).run()
    assert (late.proven, late.boxes) == (False, 0)

    class Stopped(Search):
        __slots__ = ()

        def judge(self, box: Box) -> list[Box] | Outcome:
            raise TimeIsUpError

    ended = Stopped(statement, NEVER).run()
    assert (ended.proven, ended.boxes) == (False, 1)
    assert ended.remark == "4 boxes left in the queue"


@pytest.mark.parametrize(("weight", "has_margin"), [(0.9, True), (1.1, False)])
def test_linear_part_without_a_margin_is_not_searched(
    weight: float, has_margin: bool
) -> None:
    """Q_m asks for nine tenths of how V falls at 0, or for eleven."""
    P = np.array([[16.5926, 11.5926], [11.5926, 16.5926]])
    K = np.array([[2.118, 2.118]])
    A = np.array([[0.0, 1.0], [1.0, 0.0]]) - 0.5 * np.ones((2, 1)) @ K
    falls = -(A.T @ P + P @ A)
    Q_m = (weight * (falls + falls.T) / 2).tolist()
    outcome = Search(
        decrease_statement(as_read(signed(chen(Q_m=Q_m, alpha=1e-4, refuted=None)))),
        NEVER,
    ).run()
    assert outcome.proven is has_margin
    assert outcome.remark.startswith("the linear part has no margin") is not has_margin
    assert (outcome.boxes > 0) is has_margin


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_quadratic_form_is_the_quotient_at_the_centre(scale: float) -> None:
    """Whatever |Y|^2 is weighted with: u'Bu and the constant are q for rho = 0."""
    statement = replace(Known("held").search.statement, scale=arb(scale))
    search = Search(statement, NEVER)
    form = search.quadratic_form((0.25, 0.25))
    B = np.array([[float(entry.mid()) for entry in row] for row in form.tolist()])
    for w in ([1.0, 0.3], [-0.6, 1.0]):
        u = np.array(w) / np.linalg.norm(w)
        q = float(search.value([0.25, 0.0, *w]).mid())
        assert u @ B @ u + float(statement.constant.mid()) == pytest.approx(q)


def test_held_state_that_decays_moves_straight_along_its_ray() -> None:
    """The map of x' = -x is linear in one state, so it has no curvature."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    f = ca.Function("decay", [x, u], [-x + 0 * u])
    certificate = certificate_of(f, [[1.0]], 1.0, dt=0.5)
    search = Search(decrease_statement(certificate), NEVER)
    ray = search._ray(((0.5, 0.5), (0.25, 0.75), (1.0, 1.0)))
    assert float(ray.curvature[0].abs_upper()) < 1e-12
