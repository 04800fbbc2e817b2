"""Controls over the time of a plan: their values, and their means over steps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.ocp.statement.control_shape import Profile

HELD = Profile(controls=np.array([[1.0, -1.0, 0.5], [0.0, 2.0, 4.0]]), piece=0.3)


def test_held_controls_jump_at_the_start_of_their_piece_and_last_beyond_the_end() -> (
    None
):
    found = HELD.at(np.array([-1.0, 0.0, 0.29, 0.31, 0.89, 7.0]))
    np.testing.assert_array_equal(found[0], [1.0, 1.0, 1.0, -1.0, 0.5, 0.5])


def test_linear_controls_join_their_knots_by_lines() -> None:
    lines = Profile(controls=np.array([[1.0, 0.0]]), piece=2.0, start=np.array([0.0]))
    np.testing.assert_allclose(lines.ends(4.0, 4), [[0.0, 0.5, 1.0, 0.5, 0.0]])


def test_a_step_across_an_edge_has_the_mean_of_both_controls() -> None:
    # 0.2 s to 0.4 s: half of it at 1, half at -1.
    np.testing.assert_allclose(HELD.means(0.6, 3)[0], [1.0, 0.0, -1.0], atol=1e-15)


def test_a_step_over_several_pieces_has_the_mean_of_all() -> None:
    np.testing.assert_allclose(HELD.means(0.9, 1)[:, 0], [0.5 / 3, 2.0])


def test_a_step_within_a_piece_has_its_control_bit_for_bit() -> None:
    held = Profile(controls=np.array([[0.1, 0.7]]), piece=1 / 3)
    found = held.means(1 / 3, 7)
    np.testing.assert_array_equal(found[:, :-1], np.full((1, 6), 0.1))
    assert found[0, -1] == pytest.approx(0.1, rel=1e-12)


@settings(max_examples=60, deadline=None)
@given(
    controls=st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=8),
    piece=st.floats(0.01, 2.0),
    dt=st.floats(0.01, 5.0),
    steps=st.integers(1, 40),
)
def test_means_keep_the_integral_and_the_bounds(
    controls: list[float], piece: float, dt: float, steps: int
) -> None:
    held = Profile(controls=np.array([controls]), piece=piece)
    means = held.means(dt, steps)
    assert means.min() >= min(controls) and means.max() <= max(controls)
    edges = np.append(np.arange(len(controls)) * piece, max(dt, len(controls) * piece))
    lengths = np.diff(np.clip(edges, 0.0, dt))
    assert means.sum() * dt / steps == pytest.approx(
        float(lengths @ np.array(controls)), abs=1e-9
    )
