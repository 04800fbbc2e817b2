"""Slots: their assignment, and the distance of each UAV from its own."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.cases.kinds.planar import PlanarState, Point
from swarmstart.cases.kinds.reconfiguration.problem import (
    assigned_slots,
    position_errors,
    slots_in_plane,
)
from swarmstart.cases.kinds.reconfiguration.scenario import ReconfigurationScenario
from swarmstart.tests.cases.kinds.reconfiguration.scenarios import reconfiguration

if TYPE_CHECKING:
    from swarmstart.tests.cases.kinds.reconfiguration.conftest import Make

V = [(-20, 20), (-10, 10), (0, 0), (-10, -10), (-20, -20)]

coordinates = st.floats(-100, 100)
shifts = st.tuples(coordinates, coordinates)


@st.composite
def formations(draw: st.DrawFn) -> tuple[Array, Array, int]:
    """Return starts and slots, each (uavs, 2), and the leader; one slot is (0, 0)."""
    uavs = draw(st.integers(2, 6))
    points = st.lists(
        st.tuples(coordinates, coordinates), min_size=uavs, max_size=uavs
    ).map(np.array)
    slots = draw(points) + np.array([200.0, 0.0])  # none of these at the leader's
    slots[draw(st.integers(0, uavs - 1))] = 0.0
    return draw(points), slots, draw(st.integers(0, uavs - 1))


def posed(starts: Array, slots: Array, leader: int) -> ReconfigurationScenario:
    """Return a scenario with the shortest assignment, without checks of distances."""
    return reconfiguration().model_copy(
        update={
            "uavs": [
                PlanarState(speed_m_s=2.0, heading_rad=0.0, x_m=x, y_m=y)
                for x, y in starts
            ],
            "slots": [Point(x_m=x, y_m=y) for x, y in slots],
            "leader_uav": leader + 1,
            "assignment": "shortest",
        }
    )


def summed(starts: Array, chosen: Array) -> float:
    return float(np.sum((starts - chosen) ** 2))


@settings(max_examples=40, deadline=None)
@given(formations())
def test_no_permutation_is_shorter(formation: tuple[Array, Array, int]) -> None:
    starts, slots, leader = formation
    chosen = assigned_slots(posed(starts, slots, leader))
    assert sorted(map(tuple, chosen)) == sorted(map(tuple, slots))
    assert chosen[leader].tolist() == [0.0, 0.0]
    allowed = [
        summed(starts, slots[list(order)])
        for order in itertools.permutations(range(len(slots)))
        if not slots[order[leader]].any()
    ]
    assert summed(starts, chosen) == pytest.approx(min(allowed), rel=1e-12)


@settings(max_examples=40, deadline=None)
@given(formations(), shifts)
def test_where_the_formation_stands_does_not_matter(
    formation: tuple[Array, Array, int], shift: tuple[float, float]
) -> None:
    starts, slots, leader = formation
    chosen = assigned_slots(posed(starts, slots, leader))
    moved = assigned_slots(posed(starts + shift, slots, leader))
    # Other slots may be chosen where two assignments are equally short.
    assert summed(starts, moved) == pytest.approx(summed(starts, chosen), rel=1e-9)


def test_given_slots_are_kept_as_they_are_written(make: Make) -> None:
    assert assigned_slots(make()).tolist() == [list(map(float, slot)) for slot in V]


def test_uavs_in_a_line_do_not_cross_where_the_slots_are_written_in_reverse(
    make: Make,
) -> None:
    upside_down = ", ".join(f"{{x_m: {x}, y_m: {y}}}" for x, y in V[::-1])
    chosen = assigned_slots(make(f"slots=[{upside_down}]", "assignment=shortest"))
    assert chosen.tolist() == [list(map(float, slot)) for slot in V]


def test_position_errors_by_hand() -> None:
    slots = np.array([[0.0, 0], [-10, 10], [-10, -10]])
    there = [5.0, 0.1, 7, 1, 6.0, 0.2, -3, 11, 7.0, 0.3, -3, -9]
    off = [5.0, 0.1, 7, 1, 6.0, 0.2, 0, 15, 7.0, 0.3, -3, -9.5]
    errors = position_errors(np.transpose([there, off]), slots, leader=0, turned=False)
    assert errors == pytest.approx(np.array([[0, 0], [0, 5], [0, 0.5]]))


def test_slots_turn_with_the_leader_where_they_are_told_to() -> None:
    """A slot 10 m behind and 5 m to the left of a leader that flies east or north."""
    slots, headings = np.array([[0.0, 0.0], [-10.0, 5.0]]), np.array([0.0, np.pi / 2])
    turned = slots_in_plane(slots, headings, turned=True)
    assert turned.shape == (2, 2, 2)
    assert turned[0] == pytest.approx(np.zeros((2, 2)))
    assert turned[1].T == pytest.approx(np.array([[-10, 5], [-5, -10]]))
    fixed = slots_in_plane(slots, headings, turned=False)
    assert fixed[1].T == pytest.approx(np.array([[-10, 5], [-10, 5]]))


@given(angle=st.floats(-10, 10), shift=shifts)
def test_a_formation_turned_as_a_whole_is_as_far_from_slots_that_turn(
    angle: float, shift: tuple[float, float]
) -> None:
    rng = np.random.default_rng(0)
    states, slots = rng.uniform(-30, 30, (20, 3)), np.array(V, dtype=np.float64)
    moved = states.reshape(5, 4, 3).copy()
    x, y = moved[:, 2].copy(), moved[:, 3].copy()
    moved[:, 1] += angle
    moved[:, 2] = x * np.cos(angle) - y * np.sin(angle) + shift[0]
    moved[:, 3] = x * np.sin(angle) + y * np.cos(angle) + shift[1]
    before, after = (
        position_errors(each, slots, leader=2, turned=True)
        for each in (states, moved.reshape(20, 3))
    )
    assert after == pytest.approx(before, abs=1e-10)
    assert not before[2].any() and before[[0, 1, 3, 4]].min() > 1
