"""Numbers and words from users: accepted forms, and errors."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.limits import (
    limits_of,
    require_choice,
    require_distance,
    require_number,
    scales_given,
    vector_of,
)


@given(
    one=hnp.arrays(np.float64, 3, elements=st.floats(allow_nan=False)),
    other=hnp.arrays(np.float64, 3, elements=st.floats(allow_nan=False)),
)
def test_limits_are_taken_if_something_can_be_between_them(
    one: Array, other: Array
) -> None:
    possible = bool(((one <= other) & (one < np.inf) & (other > -np.inf)).all())
    if not possible:
        with pytest.raises(InvalidProblemError, match="must have lower <= upper"):
            limits_of("states", (one, other), 3)
        return
    lower, upper = limits_of("states", (one, other), 3)
    np.testing.assert_array_equal(lower, one)
    np.testing.assert_array_equal(upper, other)


@pytest.mark.parametrize(
    "given", [1, [1, 1], (1, 1), np.ones(2), ca.DM([1, 1]), [True, True]]
)
def test_limits_come_in_many_forms_and_leave_read_only(given: object) -> None:
    lower, upper = limits_of("controls", (given, given), 2)  # type: ignore[arg-type]
    np.testing.assert_array_equal(lower, [1, 1])
    assert lower.dtype == upper.dtype == np.float64
    for limit in (lower, upper):
        with pytest.raises(ValueError, match="read-only"):
            limit[0] = 2


def test_limits_share_no_memory_with_what_was_given() -> None:
    given = np.zeros(2)
    lower, _ = limits_of("controls", (given, 1), 2)
    given[0] = 9
    assert lower[0] == 0


@pytest.mark.parametrize(
    "limits",
    [
        (0,),
        (0, 1, 2),
        3,
        None,
        ("0", "1"),
        (None, 1),
        ([], []),
        ([0, 0, 0], 1),
        ([[0, 0], [0]], 1),
        ([0j, 0j], 1),
        (ca.SX.sym("a"), 1),
    ],
)
def test_refuses_what_is_no_pair_of_limits(limits: object) -> None:
    with pytest.raises(InvalidProblemError, match=r"a pair .* of 2 numbers, got"):
        limits_of("states", limits, 2)  # type: ignore[arg-type]


def test_scale_that_is_not_given_stays_open() -> None:
    assert scales_given("states", None, 3) is None
    scales = scales_given("states", 2, 3)
    assert scales is not None
    np.testing.assert_array_equal(scales, [2, 2, 2])


@pytest.mark.parametrize(
    "limits", [(np.inf, np.inf), (-np.inf, -np.inf), (1, 0), (np.nan, 1), (0, np.nan)]
)
def test_refuses_limits_with_no_number_between(limits: tuple[float, float]) -> None:
    with pytest.raises(InvalidProblemError, match="must have lower <= upper"):
        limits_of("states", limits, 2)


@pytest.mark.parametrize("scale", [0, -1, np.nan, np.inf, [1, 0]])
def test_refuses_scales_that_are_not_positive(scale: object) -> None:
    with pytest.raises(InvalidProblemError, match="scale of the row must be positive"):
        scales_given("row", scale, 2)  # type: ignore[arg-type]


@pytest.mark.parametrize("scale", ["1", [], [1, 2, 3], {}])
def test_refuses_scales_that_are_no_numbers(scale: object) -> None:
    with pytest.raises(InvalidProblemError, match="a positive number or 2 of them"):
        scales_given("row", scale, 2)  # type: ignore[arg-type]


def test_column_becomes_a_vector() -> None:
    np.testing.assert_array_equal(vector_of(ca.DM([1, 2])), [1, 2])
    assert vector_of(ca.DM([1])).shape == (1,)
    with pytest.raises(TypeError, match="expected numbers"):
        vector_of("12")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: require_number("horizon", "3"), r"must be a number, got '3' \(str\)"),
        (lambda: require_number("horizon", True), r"must be a number, got True"),
        (lambda: require_number("horizon", None), "must be a number, got None"),
        (lambda: require_distance("radius", 0), "radius must be positive, got 0"),
        (lambda: require_distance("radius", np.nan), "must be positive, got nan"),
        (lambda: require_distance("r", 1, -1), "margins must be at least 0, got -1"),
        (lambda: require_distance("r", 1, np.inf), "margins must be at least 0"),
        (
            lambda: require_choice("along", "x", ("points", "segments")),
            "along must be points or segments, got 'x'",
        ),
    ],
)
def test_refusals_name_what_is_wrong(call: Callable[[], object], message: str) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        call()


def test_numbers_of_all_kinds_become_floats() -> None:
    for number in (3, 3.0, np.float32(3), np.int64(3)):
        assert require_number("horizon", number) == 3.0
        assert type(require_number("horizon", number)) is float
