"""Rounding: nearest whole numbers, sum-up rounding, and steps to neighbours."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swarmstart.ocp import Bounds, InvalidProblemError, Model, OptimalControlProblem
from swarmstart.ocp.statement.decisions import (
    neighbours,
    sum_up_rounded,
    whole,
    whole_symbols,
    widened,
)

LIMITS = (np.array([0.0, -2.0, -5.0]), np.array([1.0, 3.0, 5.0]))
RELAXED = arrays(np.float64, (3, 9), elements=st.floats(0.0, 1.0))


@given(RELAXED)
def test_sums_of_rounded_controls_stay_within_half_a_unit(relaxed: np.ndarray) -> None:
    rounded = sum_up_rounded(relaxed, (0, 1), LIMITS, [1] * 9)
    apart = np.cumsum(relaxed - rounded, axis=1)
    assert np.abs(apart[:2]).max() <= 0.5 + 1e-9
    lengths = [1, 1, 2, 3, 1, 1, 2, 2, 4]
    blocks = sum_up_rounded(relaxed, (0, 1), LIMITS, lengths)
    apart = np.cumsum((relaxed - blocks) * lengths, axis=1)
    assert np.abs(apart[:2]).max() <= max(lengths) / 2 + 1e-9
    np.testing.assert_array_equal(rounded[2], relaxed[2])
    np.testing.assert_array_equal(rounded[:2], np.rint(rounded[:2]))


@given(arrays(np.float64, (3, 4), elements=st.floats(-9.0, 9.0)))
def test_symbols_are_rounded_as_numbers_are(controls: np.ndarray) -> None:
    u = ca.SX.sym("u", 3)
    f = ca.Function("f", [u], [whole_symbols(u, (0, 1), LIMITS)])
    rounded = whole(controls, (0, 1), LIMITS)
    np.testing.assert_array_equal(np.array(f(controls)), rounded)
    lower, upper = (side[:2, None] for side in LIMITS)
    assert (rounded[:2] >= lower).all() and (rounded[:2] <= upper).all()


def test_every_whole_number_has_as_much_room_in_the_box_of_a_search() -> None:
    lower, upper = widened(LIMITS, (0, 1))
    draws = np.random.default_rng(0).uniform(lower, upper, (60_000, 3)).T
    rounded = whole(draws, (0, 1), LIMITS)
    for row, count in zip(rounded, (2, 6), strict=False):
        shares = np.unique(row, return_counts=True)[1] / row.size
        np.testing.assert_allclose(shares, np.full(count, 1 / count), rtol=0.05)


def test_neighbours_are_one_step_away_and_within_the_bounds() -> None:
    controls = np.array([[0.0, 1.0], [0.0, 0.0], [0.5, 0.5]])
    found = {tuple(one[0]) for one in neighbours(controls, (0,), LIMITS)}
    assert found == {(1.0, 1.0), (0.0, 0.0), (1.0, 0.0)}
    assert (neighbours(controls, (0, 1), LIMITS)[:, 2] == 0.5).all()


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        (Bounds(controls=(0, 1.5), integer=[0]), "'u_0', which takes whole"),
        (Bounds(controls=(0, 1), integer=["v"]), "some of u_0, u_1, or give"),
        (Bounds(controls=(0, 1), integer=[2]), "got 2"),
        (Bounds(controls=(0, 1), integer=[True]), "got True"),
        (Bounds(controls=(0, 1), integer=[0.0]), "got 0.0"),  # type: ignore[list-item]
        (
            Bounds(controls=(0, 2), search=(0.5, 1.5), integer=[0]),
            "bounds in the search of 'u_0', which takes whole",
        ),
    ],
)
def test_what_cannot_be_whole_is_refused(bounds: Bounds, message: str) -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u", 2)
    with pytest.raises(InvalidProblemError, match=message):
        OptimalControlProblem(
            Model(states=x, controls=u, ode=u[0]), horizon=1, intervals=2,
            stage_cost=x**2, bounds=bounds,
        )  # fmt: skip


def test_names_and_numbers_mean_the_same() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u", 2)
    for given_as in ("u_1", ["u_1"], [1], (1, "u_1")):
        problem = OptimalControlProblem(
            Model(states=x, controls=u, ode=u[0]), horizon=1, intervals=2,
            stage_cost=x**2, bounds=Bounds(controls=(0, 1), integer=given_as),
        )  # fmt: skip
        assert problem.integer == (1,)
