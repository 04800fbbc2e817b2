"""The box: what it accepts, what it contains."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from swarmstart.heuristics import Box, InvalidBoxError, InvalidPointsError


def test_bounds_are_copied_and_locked() -> None:
    lower = np.zeros(3)
    box = Box(lower=lower, upper=np.ones(3))
    lower[0] = 5.0
    assert box.lower[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        box.upper[0] = 2.0


def test_contains_its_boundary_and_no_nan() -> None:
    box = Box(lower=np.array([0.0, -1.0]), upper=np.array([1.0, 1.0]))
    points = np.array([[0.0, 1.0, 0.5, np.nan], [-1.0, 1.0, 1.1, 0.0]])
    assert box.contains(points).tolist() == [True, True, False, False]
    assert box.contains([0.5, 0.5]).shape == ()
    assert (box.dim, box.width.tolist()) == (2, [1.0, 2.0])


@pytest.mark.parametrize(
    ("lower", "upper", "message"),
    [
        ([0.0, 0.0], [1.0], r"shapes \(2,\) and \(1,\)"),
        ([], [], "at least 1"),
        ([0.0, 2.0], [1.0, 1.5], r"variable 1 .* got \[2.0, 1.5\]"),
        (["a"], [1.0], "lower must be a vector of numbers"),
        ([np.nan], [1.0], "must be finite"),
        ([-np.inf], [1.0], "must be finite"),
        ([-1.7e308], [1.7e308], "must be finite"),
    ],
)
def test_refuses_what_is_no_box(
    lower: list[Any], upper: list[float], message: str
) -> None:
    with pytest.raises(InvalidBoxError, match=message):
        Box(lower=lower, upper=upper)  # type: ignore[arg-type]


def test_equal_bounds_fix_a_variable() -> None:
    box = Box(lower=np.array([0.0, 2.0, -1.0]), upper=np.array([1.0, 2.0, 1.0]))
    assert box.free.tolist() == [0, 2]
    assert box.contains([0.5, 2.0, 0.0])
    assert not box.contains([0.5, np.nextafter(2.0, 3.0), 0.0])


def test_all_variables_count_as_free_where_all_are_fixed() -> None:
    assert Box(lower=np.ones(2), upper=np.ones(2)).free.tolist() == [0, 1]


@pytest.mark.parametrize("points", [[0.5, 0.5], 0.5, np.zeros((1, 2, 2))])
def test_refuses_points_of_another_dimension(points: ArrayLike) -> None:
    with pytest.raises(InvalidPointsError, match=r"points must have shape \(1,\)"):
        Box(lower=np.zeros(1), upper=np.ones(1)).contains(points)
