"""Walls: the gauge bounds a rounded rectangle, and walls have no other gaps."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.cases.hard.walls import EDGE, GAP, HALF_HEIGHT, drawn_walls
from swarmstart.tests.cases.hard.problems import drawn_problem, path_values

SIZES = {"walls": 3, "gaps": 2, "seed": 2}
ROOM, _ = drawn_walls(**SIZES)
POSED = drawn_problem("walls", **SIZES)


@settings(max_examples=200, deadline=None)
@given(
    block=st.integers(0, len(ROOM.blocks) - 1),
    along=st.floats(0, 1),
    side=st.sampled_from([-1, 1]),
    out=st.floats(-0.2, 3),
)
def test_the_constraint_is_zero_on_the_rounded_rectangle_and_grows_outwards(
    block: int, along: float, side: int, out: float
) -> None:
    """Points at a distance from the outline, from its parametrisation by arc length."""
    one = ROOM.blocks[block]
    r, c = one.radius, one.half_height - one.radius
    place = along * (2 * c + np.pi * r)
    if place < 2 * c:
        foot, normal = np.array([side * r, place - c]), np.array([side, 0.0])
    else:
        angle = (place - 2 * c) / r  # Around the upper end, from right to left.
        normal = np.array([np.cos(angle), np.sin(angle)])
        foot = np.array([0.0, c]) + r * normal
        foot, normal = foot * [1, side], normal * [1, side]
    centre = np.array([one.x, one.y])
    on, off = (
        path_values(POSED, (centre + foot + distance * normal)[:, None])[block, 0]
        for distance in (0.0, out)
    )
    # The rounded kinks move the outline by EDGE / 4 at most: log(g) by that over r.
    assert abs(on) < EDGE / 4 / r * 1.5
    if abs(out) > EDGE:
        assert np.sign(off) == np.sign(out)


def test_a_wall_is_open_at_its_gaps_only() -> None:
    heights = np.linspace(-HALF_HEIGHT, HALF_HEIGHT, 4001)
    for x in sorted({block.x for block in ROOM.blocks}):
        states = np.stack([np.full(heights.size, x), heights])
        free = np.asarray((path_values(POSED, states) >= 0).all(axis=0))
        assert not free[[0, -1]].any()
        edges = heights[1:][free[1:] != free[:-1]]
        widths = edges[1::2] - edges[::2]
        assert len(widths) == 2 and np.allclose(widths, GAP, atol=0.005)


def test_the_bound_of_speed_allows_a_way_through_the_nearest_gaps() -> None:
    """The way along the axes has this length, and its cost is its square."""
    assert ROOM.fastest > np.hypot(ROOM.goal[0], ROOM.goal[1] - ROOM.start[1])
