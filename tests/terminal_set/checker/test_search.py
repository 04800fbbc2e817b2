"""Bounds, cuts and the search agree with exact arithmetic and with counting by hand."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.terminal_set.checker.findings import (
    NEVER,
    Deadline,
    TimeIsUpError,
    Verdict,
)
from swarmstart.terminal_set.checker.models import Model, algebra_of
from swarmstart.terminal_set.checker.search import (
    BATCH,
    Boxes,
    Flags,
    Judgement,
    Outcome,
    cut_by,
    finding_of,
    is_empty,
    judgement,
    lowest,
    prove,
)

SIZES = [0.0, 1e-9, 0.1, 1.0, 9.0, 1e6]


def random_model(
    rng: np.random.Generator,
    d: int,
    count: int,
    *,
    scale: float,
    sizes: list[float] = SIZES,
) -> Model:
    algebra = algebra_of(d)
    shape = (len(algebra.monomials), count)
    coefficients = rng.normal(size=shape) * rng.choice(sizes, size=shape)
    error = rng.choice(sizes, size=count)
    return Model(algebra, scale * coefficients, scale * error)


def column(model: Model, k: int) -> dict[tuple[int, ...], Fraction]:
    """Exponents -> coefficient of one box."""
    pairs = zip(model.algebra.monomials, model.coefficients[:, k], strict=True)
    return {tuple(map(int, e)): Fraction(float(c)) for e, c in pairs}


def least_square(g: Fraction, h: Fraction) -> Fraction:
    """Least of h s^2 + g s over [-1, 1]."""
    found = min(h + g, h - g, Fraction(0))
    return min(found, -g * g / (4 * h)) if 2 * h > abs(g) else found


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
@pytest.mark.parametrize("d", [1, 2, 3])
def test_lowest_is_the_least_of_squares_and_slopes_less_all_else(
    d: int, scale: float
) -> None:
    count = 300
    model = random_model(np.random.default_rng(d), d, count, scale=scale)
    found, tiny = lowest(model), Fraction(1, 10**199)
    for k in range(count):
        terms = column(model, k)
        exact = terms.pop((0,) * d) - Fraction(float(model.error[k]))
        for a in range(d):
            unit = tuple(int(i == a) for i in range(d))
            square = tuple(2 * i for i in unit)
            exact += least_square(terms.pop(unit), terms.pop(square))
        size = sum(map(abs, column(model, k).values()), Fraction(float(model.error[k])))
        exact -= sum(map(abs, terms.values()), Fraction(0))
        assert found[k] <= exact
        assert exact - Fraction(float(found[k])) <= Fraction(2, 10**12) * size + tiny


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_a_cut_is_the_one_of_exact_arithmetic(scale: float) -> None:
    """g_a s_a <= rest - c_0 + the sum over the others of |g|, and no farther."""
    rng, d, count = np.random.default_rng(0), 3, 400
    model = random_model(rng, d, count, scale=1.0, sizes=[0.0, 0.1, 1.0])
    model.coefficients[1 : 1 + d] *= 8
    whole = np.abs(model.coefficients[1:]).sum(axis=0) + model.error
    model.coefficients[0] = rng.uniform(-0.2, 1.1, count) * whole
    model.coefficients *= 10.0 ** rng.uniform(-6, 1, count)
    lower = scale * (rng.normal(size=(d, count)) + rng.choice([0, -1e6, 1e6], count))
    boxes = Boxes(
        lower, lower + scale * rng.uniform(0.1, 2, (d, count)), np.zeros(count, int)
    )
    cut, outside = cut_by(boxes, model)
    parts = boxes.middle, boxes.radius
    seen = dict.fromkeys(("right", "left", "none"), 0)
    for k in range(count):
        terms = column(model, k)
        error = Fraction(float(model.error[k]))
        slopes = [terms[tuple(int(i == a) for i in range(d))] for a in range(d)]
        rest = sum((abs(c) for e, c in terms.items() if sum(e) > 1), error)
        room = rest - terms[(0,) * d] + sum(map(abs, slopes), Fraction(0))
        size = room + 2 * abs(terms[(0,) * d])
        assert outside[k] == (room < 0)
        for a, g in enumerate(slopes):
            low, high = Fraction(float(lower[a, k])), Fraction(float(boxes.upper[a, k]))
            middle, radius = (Fraction(float(part[a, k])) for part in parts)
            share = (room - abs(g)) / abs(g) if g else Fraction(1)
            kept = Fraction(float(cut.lower[a, k])), Fraction(float(cut.upper[a, k]))
            exact = [low, high]
            if -1 <= share < 1:
                exact[int(g > 0)] = middle + (
                    share * radius if g > 0 else -share * radius
                )
                seen["right" if g > 0 else "left"] += 1
            seen["none"] += share >= 1
            if share >= -1:
                # Reserves are parts of all terms of the bound, and of the numbers.
                near = Fraction(3, 10**12) * radius * size / (abs(g) or 1)
                near += Fraction(4, 10**15) * (abs(low) + abs(high))
                assert exact[0] - near <= kept[0] <= exact[0]
                assert exact[1] <= kept[1] <= exact[1] + near
    assert min(seen.values()) > 50


def test_a_constraint_that_holds_at_one_end_leaves_that_end() -> None:
    """c = s + 1 is 0 at s = -1 only, c = 1 - s at s = 1 only."""
    algebra, one = algebra_of(1), np.ones(2)
    boxes = Boxes(np.array([[1.0, -3.0]]), np.array([[3.0, -1.0]]), np.zeros(2, int))
    for sign, end in ((1.0, boxes.lower), (-1.0, boxes.upper)):
        model = algebra.constant(one)
        model.coefficients[1] = sign
        cut, outside = cut_by(boxes, model)
        assert not outside.any()
        assert (cut.lower <= end).all() and (end <= cut.upper).all()
        assert (cut.upper - cut.lower < 1e-11).all()


def test_losses_count_for_the_variables_they_depend_on() -> None:
    """3 + s_0 - 2 s_1 + 4 s_0 s_1 + 5 s_1^3 +- 6 over widths 1 and 2."""
    algebra = algebra_of(2)
    model = algebra.constant(np.full(2, 3.0), 6.0)
    for exponents, c in {(1, 0): 1, (0, 1): -2, (1, 1): 4, (0, 3): 5}.items():
        model.coefficients[algebra.numbers[exponents]] = c
    lower = np.full((2, 2), 5.0)
    boxes = Boxes(lower, lower + np.array([[1.0, 0.0], [2.0, 0.0]]), np.zeros(2, int))
    mask = np.array([True, False])
    extra = np.array([[10.0], [20.0]])
    for more, added in (({"extra": extra}, extra), ({}, np.zeros((2, 1)))):
        found = judgement(model, boxes, proven=mask, suspect=~mask, **more)
        # Each s_1^3 counts three times; the error by the widths, of a point not at all.
        expected = np.array([[5.0 + 2.0, 5.0], [21.0 + 4.0, 21.0]]) + added
        np.testing.assert_allclose(found.pull, expected, rtol=1e-14)
        assert found.proven is mask
        np.testing.assert_array_equal(found.suspect, ~mask)


def test_boxes_are_empty_if_one_side_is() -> None:
    lower = np.array([[0.0, 1.0, 1.0, 2.0], [0.0, 1.0, 3.0, 2.0]])
    upper = np.array([[1.0, 1.0, 2.0, 1.0], [1.0, 1.0, 2.0, 1.0]])
    boxes = Boxes(lower, upper, np.zeros(4, int))
    np.testing.assert_array_equal(is_empty(boxes), [False, False, True, True])


def test_the_radius_reaches_the_ends_and_is_zero_at_a_point() -> None:
    rng = np.random.default_rng(0)
    lower = rng.normal(size=(1, 500)) * rng.choice([1e-300, 1e-3, 1.0, 1e200], size=500)
    width = rng.choice([0.0, 1e-16, 1e-8, 1.0], size=500) * np.abs(lower)
    boxes = Boxes(lower, lower + width, np.zeros(500, int))
    assert ((boxes.radius == 0.0) == (boxes.lower == boxes.upper)).all()
    for low, high, middle, radius in zip(
        *(map(Fraction, part[0].tolist())
          for part in (boxes.lower, boxes.upper, boxes.middle, boxes.radius)),
        strict=True,
    ):  # fmt: skip
        assert low <= middle <= high
        assert radius >= max(high - middle, middle - low)
        assert radius <= (high - low) / 2 + abs(middle) / 2**52


def row(*ends: tuple[float, float]) -> Boxes:
    lower, upper = np.array(ends).T
    return Boxes(lower[None], upper[None], np.arange(len(ends)))


@dataclass
class Widths:
    """Proves boxes up to a width; what lies beyond `within` is outside of the set."""

    width: float = 0.25
    within: tuple[float, float] = (-np.inf, np.inf)
    late: int = 0
    false_at: float = np.nan
    pull: float = 1.0
    batches: list[int] = field(default_factory=list)

    def _cut(self, boxes: Boxes) -> tuple[Boxes, Flags]:
        low, high = self.within
        outside = (boxes.upper[0] < low) | (boxes.lower[0] > high)
        lower, upper = np.maximum(boxes.lower, low), np.minimum(boxes.upper, high)
        # What is outside may have any ends.
        return Boxes(
            np.where(outside, 0, lower), np.where(outside, 1, upper), boxes.slab
        ), outside

    cut = cut_more = _cut

    def judge(self, boxes: Boxes) -> Judgement:
        self.batches.append(boxes.count)
        if len(self.batches) == self.late:
            raise TimeIsUpError
        wide = boxes.upper - boxes.lower
        proven = (wide <= self.width)[0]
        return Judgement(proven, boxes.middle[0] >= self.false_at, self.pull * wide)

    def refuted(self, points: Boxes) -> Flags:
        assert (points.middle[0] >= self.false_at).all()
        return np.asarray(points.middle[0] > self.false_at)

    def shown(self, points: Boxes) -> tuple[float, ...]:
        assert points.count == 1
        return tuple(map(float, points.lower[:, 0]))


@pytest.mark.parametrize("pull", [1.0, np.nan, np.inf])
@pytest.mark.parametrize(
    ("levels", "roots"), [(0, 1), (1, 3), (3, 1), (12, 1), (5, 70)]
)
def test_every_box_is_halved_until_it_is_proven(
    levels: int, roots: int, pull: float
) -> None:
    task = Widths(2.0**-levels, pull=pull)
    outcome = prove(task, row(*[(float(k), k + 1.0) for k in range(roots)]), NEVER)
    assert outcome == Outcome(True, roots * (2 ** (levels + 1) - 1))
    assert sum(task.batches) == outcome.boxes
    assert max(task.batches) <= BATCH
    # All that are left are judged together, as far as a batch holds them.
    assert max(task.batches) == min(BATCH, roots * 2**levels)


def test_what_is_outside_of_the_set_is_not_judged_or_halved() -> None:
    task = Widths(0.25, within=(0.5, 0.75))
    roots = row((0.0, 1.0), (2.0, 3.0), (-1.0, 0.5), (0.75, 9.0))
    outcome = prove(task, roots, NEVER)
    assert outcome == Outcome(True, 3)
    assert task.batches == [3]
    assert prove(task, row((2.0, 3.0)), NEVER) == Outcome(True, 0)


def test_time_that_is_up_leaves_the_boxes_that_were_not_judged() -> None:
    roots = row((0.0, 1.0), (1.0, 2.0), (2.0, 3.0))
    for call, judged, left in ((1, 3, 3), (2, 9, 6), (3, 21, 12)):
        outcome = prove(Widths(late=call), roots, NEVER)
        remark = f"{left} boxes left in the queue"
        assert outcome == Outcome(False, judged - left, remark=remark)
    outcome = prove(Widths(), roots, Deadline.after(-1.0))
    assert outcome == Outcome(False, 0, remark="3 boxes left in the queue")


def test_the_first_middle_that_is_refuted_is_the_counterexample() -> None:
    roots = row((0.0, 1.0), (1.0, 3.0), (3.0, 5.0), (5.0, 7.0))
    outcome = prove(Widths(false_at=2.0), roots, NEVER)
    assert outcome == Outcome(False, 4, (4.0,))
    # A suspect that is not refuted is no counterexample, and neither is one cut away.
    assert prove(Widths(1.0, false_at=6.0), roots, NEVER) == Outcome(True, 10)
    task = Widths(1.0, within=(0.0, 3.5), false_at=3.75)
    assert prove(task, roots, NEVER).proven


def test_a_box_between_neighbouring_numbers_ends_the_search_there() -> None:
    low = 1.0
    next_one, third = np.nextafter(low, 2), np.nextafter(np.nextafter(low, 2), 2)
    for ends in ((low, next_one), (next_one, third), (low, low)):
        outcome = prove(Widths(-1.0), row((4.0, 6.0), ends, (7.0, 7.0)), NEVER)
        assert outcome == Outcome(False, 3, remark="floats end at (1)")
    between = prove(Widths(-1.0), row((low, third)), NEVER)
    assert between == Outcome(False, 3, remark="floats end at (1)")


def test_a_box_is_cut_where_most_is_lost_and_it_is_not_a_point() -> None:
    cut: list[tuple[Array, Array]] = []

    class Once(Widths):
        def judge(self, boxes: Boxes) -> Judgement:
            cut.append((boxes.lower, boxes.upper))
            proven = np.full(boxes.count, len(cut) > 1)
            return Judgement(
                proven,
                np.zeros(boxes.count, dtype=bool),
                losses[:, :1].repeat(boxes.count, axis=1),
            )

    box = np.array([[5.0, 9.0, 0.0], [5.0, 10.0, 4.0]])  # The first is a point.
    for axis, pull in [
        (1, [3.0, 2.0, 1.0]),
        (2, [0.0, 1.0, 2.0]),
        (1, [0.0, 0.0, 0.0]),
        # If any is not known, the widest.
        (2, [0.0, np.inf, 1.0]),
        (2, [np.nan, 1.0, 0.5]),
    ]:
        cut.clear()
        losses = np.array([pull]).T
        roots = Boxes(box[0][:, None], box[1][:, None], np.array([7]))
        assert prove(Once(), roots, NEVER) == Outcome(True, 3)
        halves = cut[1][1] - cut[1][0]
        expected = np.repeat((box[1] - box[0])[:, None], 2, axis=1)
        expected[axis] /= 2
        np.testing.assert_array_equal(halves, expected)


@pytest.mark.parametrize(
    ("outcome", "verdict", "text"),
    [
        (Outcome(True, 7), Verdict.PROVED, r"it rains \(7 boxes, \d+\.\d\d s\)"),
        (
            Outcome(False, 7, (1.0, 2.5)),
            Verdict.REFUSED,
            r"it is false that it rains: e = \(1, 2\.5\)",
        ),
        (
            Outcome(False, 7, remark="late"),
            Verdict.UNDECIDED,
            r"it rains \(7 boxes, \d+\.\d\d s; late\)",
        ),
    ],
)
def test_the_finding_states_the_outcome(
    outcome: Outcome, verdict: Verdict, text: str
) -> None:
    found = finding_of(outcome, "it rains", time.monotonic(), "e")
    assert found.verdict is verdict
    assert re.fullmatch(text, found.text)
