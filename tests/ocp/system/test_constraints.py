"""Constraints: excesses by hand, relations as limits, and errors."""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    InvalidProblemError,
    PathConstraint,
    TerminalConstraint,
)
from swarmstart.ocp.system.constraints import (
    Rows,
    fixed_and_moving,
    limited,
    row_excess,
)
from swarmstart.tests.ocp.excesses import excess_of

X = ca.SX.sym("x", 2)


def outcome(relation: ca.SX, x: list[float]) -> list[float]:
    """Return the excess of each row of a relation."""
    found = limited("it", relation)
    assert found is not None
    expression, lower, upper = found
    over = row_excess(Rows(expression, lower, upper))
    return np.array(ca.Function("over", [X], [over])(x)).ravel().tolist()


@pytest.mark.parametrize(
    ("relation", "excess"),
    [
        (X[0] <= 3, 5 - 3),
        (X[0] < 3, 5 - 3),
        (X[0] >= 3, 3 - 5),
        (3 <= X[0], 3 - 5),
        (3 >= X[0], 5 - 3),
        (X[0] == 3, 2),
        (X[1] == 3, 5),
        (3 == X[1], 5),
        (X[0] <= X[1], 5 + 2),
        (X[0] >= X[1], -2 - 5),
        (X[1] == X[0], 7),
        (X[0], 5),
        (X[1], 2),
    ],
)
def test_relation_means_what_it_says(relation: ca.SX, excess: float) -> None:
    """At (5, -2): positive by the amount of the violation, negative inside."""
    assert outcome(relation, [5, -2]) == [excess]


def test_column_of_relations_has_a_row_for_each() -> None:
    column = ca.vertcat(X[0] <= 3, X[1] >= X[0], X[1] == 0)
    assert outcome(column, [5, -2]) == [2, 7, 2]
    assert limited("it", [1, 2]) is None
    with pytest.raises(InvalidProblemError, match="it must be relations or expr"):
        limited("it", ca.vertcat(X[0] <= 3, X[1]))


def test_range_is_broken_on_either_side() -> None:
    rows = Rows(X, np.array([-1, -np.inf]), np.array([2, np.inf]))
    over = ca.Function("over", [X], [row_excess(rows)])
    for value, excess in ((-4, 3), (-1, 0), (0, -1), (1.5, -0.5), (6, 4)):
        # A row without limits is neither broken nor inside of them.
        assert np.array(over([value, 1e9])).ravel().tolist() == [excess, 0]
    empty = Rows(ca.SX(0, 1), np.empty(0), np.empty(0))
    assert row_excess(empty).shape == (0, 1)


def test_path_excess_sums_scaled_rows_at_the_end() -> None:
    limits = {"expression": X, "lower": [-1, -np.inf], "upper": [1, 2]}
    nowhere, end = np.zeros(2), np.array([-4.0, 2.5])
    graded = PathConstraint(scale=0.5, **limits)  # type: ignore[arg-type]
    assert excess_of(graded)(nowhere, end) == pytest.approx((3 + 0.5) / 0.5)
    assert excess_of(graded)(end, nowhere) == 0
    counted = PathConstraint(measure="indicator", **limits)  # type: ignore[arg-type]
    assert excess_of(counted)(nowhere, end) == 2
    assert excess_of(counted)(nowhere, np.array([-1.0, 2.0])) == 0  # At its limits.
    assert counted.rows(X).values.numel() == 2  # a range is one row


def test_path_constraint_without_finite_limits_demands_nothing() -> None:
    constraint = PathConstraint(expression=X)
    assert excess_of(constraint)(np.full(2, -1e9), np.full(2, 1e9)) == 0


def test_terminal_excess_is_the_scaled_distance_from_the_interval() -> None:
    equality = TerminalConstraint(expression=X, scale=2.0)
    interval = TerminalConstraint(expression=X, lower=-1, upper=[1, 5])
    for constraint, beyond in ((equality, 3.5), (interval, 3 / 1 - 0 + 2)):
        value = excess_of(constraint)
        assert value(np.zeros(2), np.array([3.0, -4.0])) == beyond
        assert value(np.zeros(2), np.zeros(2)) == 0


def test_limits_are_copied_and_read_only() -> None:
    upper = np.array([1.0, 2.0])
    constraint = PathConstraint(expression=X, upper=upper)
    upper[0] = 9.0
    kept = np.asarray(constraint.upper)
    assert kept[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        kept[0] = 9.0


def test_weights_of_a_soft_constraint_are_columns_of_one_for_each_row() -> None:
    for given, rows, expected in (
        (3.0, 2, [3.0, 3.0]),
        ([4.0, 5.0], 2, [4.0, 5.0]),
        (6.0, 1, [6.0]),
        (7.0, 0, []),
        ([], 0, []),
    ):
        soft = PathConstraint(expression=ca.SX.sym("x", rows), upper=1.0, weight=given)
        for weight, numbers in zip(soft.weights, (expected, [0.0] * rows), strict=True):
            assert weight.shape == (rows, 1)
            assert [float(weight[i]) for i in range(rows)] == numbers


def test_moving_bounds_are_rows_and_the_numbers_beside_them_stay() -> None:
    s = ca.SX.sym("s", 2)
    inf = np.inf
    cases: tuple[tuple[Any, Any, list[Any]], ...] = (
        # Limits; the numbers that stay; of each row symbol - bound with its limits.
        (None, ((-inf,), (inf,)), []),
        ((-3, [4, 5]), ((-3,), (4, 5)), []),
        (
            ([-1, s[0]], [s[1], 1]),
            ((-1, -inf), (inf, 1)),
            [(20 - 5, 0, inf), (10 - 7, -inf, 0)],
        ),
        # One expression bounds all symbols.
        ((-8, s[0]), ((-8, -8), (inf, inf)), [(5, -inf, 0), (15, -inf, 0)]),
        ((s, 9), ((-inf, -inf), (9, 9)), [(5, 0, inf), (13, 0, inf)]),
        ((ca.SX(2), 3), ((2, 2), (3, 3)), []),
    )
    for limits, numbers, rows in cases:
        found, moving = fixed_and_moving("controls", limits, X, {"signals": s})
        assert tuple(tuple(np.ravel(side)) for side in found) == numbers
        for constraint in moving:
            assert constraint.name == "moving bounds of the controls"
            value = ca.Function("value", [X, s], [constraint.expression])
            values = np.array(value([10, 20], [5, 7])).ravel()
            sides = np.ravel(constraint.lower), np.ravel(constraint.upper)
            assert list(zip(values, *sides, strict=True)) == rows
        assert bool(moving) or not rows


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: PathConstraint(expression=X, measure="count"),  # type: ignore[arg-type]
            "measure must be excess or indicator, got 'count'",
        ),
        (
            lambda: PathConstraint(expression=X, scale=0),
            "scale .* must be positive, got 0",
        ),
        (
            lambda: PathConstraint(expression=X, lower=[1, 2, 3]),
            "pair .* of 2 numbers, got",
        ),
        (lambda: PathConstraint(expression=X, lower=2, upper=1), "lower <= upper"),
        (lambda: PathConstraint(expression=X, lower=np.inf), "lower below inf"),
        (lambda: PathConstraint(expression=X, lower=np.nan), "lower <= upper"),
        (
            lambda: TerminalConstraint(expression=X, scale=-1),
            "scale .* must be positive",
        ),
        (
            lambda: TerminalConstraint(expression="m"),  # type: ignore[arg-type]
            "expression must be a CasADi SX expression",
        ),
    ],
)
def test_refuses_what_is_no_constraint(
    make: Callable[[], object], message: str
) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        make()
