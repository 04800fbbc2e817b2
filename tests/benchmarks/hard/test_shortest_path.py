"""Shortest paths among blocks: closed forms, invariances, and bounds from above."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.sparse.csgraph import dijkstra

from swarmstart.arrays import Array
from swarmstart.benchmarks.hard.blocks import (
    Block,
    Box,
    Point,
    clearance,
    corners,
    disc,
    enlarged,
    segment_clearance,
)
from swarmstart.benchmarks.hard.paths import Arc, Piece, Segment, ShortestPath
from swarmstart.benchmarks.hard.shortest_path import CLEARANCE, shortest_path

BOX: Box = ((0.0, 0.0), (10.0, 8.0))
START: Point = (0.5, 4.0)
GOAL: Point = (9.5, 3.0)
ROUNDING = 30 * CLEARANCE
"""Bound of what the enlarged radii add in these boxes, of diagonal 13."""


def the_path(
    blocks: list[Block], start: Point = START, goal: Point = GOAL, box: Box = BOX
) -> ShortestPath:
    path = shortest_path(start, goal, blocks, box)
    assert path is not None
    return path


def length(
    blocks: list[Block], start: Point = START, goal: Point = GOAL, box: Box = BOX
) -> float:
    path = shortest_path(start, goal, blocks, box)
    return np.inf if path is None else path.length


CENTRAL: Box = ((-5.0, -5.0), (5.0, 5.0))


@pytest.mark.parametrize(
    ("blocks", "expected"),
    [
        ([], 4.0),
        ([disc((0, 0), 1)], 2 * np.sqrt(3) + np.pi / 3),
        # To the circle at (-0.8, 0.3), d = (1.2, 0.3) away, and along the upper side.
        (
            [Block((0, 0), 1, 0.5, 0.2)],
            2 * np.sqrt(1.2**2 + 0.3**2 - 0.2**2)
            + 1.6
            + 0.4 * (np.pi / 2 + np.arctan(0.25) - np.arccos(0.2 / np.hypot(1.2, 0.3))),
        ),
        ([Block((0, 0), 1, 0.5, 0)], 2 * np.hypot(1, 0.5) + 2),
        # Discs that touch at (0, 0): over the upper one, tangents of length 2.
        ([disc((0, 1), 1), disc((0, -1.5), 1.5)], 4 + 2 * np.pi - 4 * np.arctan(2)),
    ],
    ids=["nothing", "disc", "rounded rectangle", "sharp rectangle", "touching discs"],
)
def test_lengths_are_those_of_closed_forms(
    blocks: list[Block], expected: float
) -> None:
    path = the_path(blocks, (-2, 0), (2, 0), CENTRAL)
    assert expected <= path.length + 1e-12
    assert path.length == pytest.approx(expected, rel=ROUNDING)
    assert path.cost == pytest.approx(expected**2, rel=2 * ROUNDING)


def test_belt_that_crosses_between_two_discs_has_its_closed_form() -> None:
    # Walls close the way below the left disc and above the right one.
    discs = [disc((-2, 0), 1), disc((2, 0), 1)]
    walls = [Block((-2, -3), 0.1, 2.5, 0.1), Block((2, 3), 0.1, 2.5, 0.1)]
    path = the_path(discs + walls, (-4, 0), (4, 0), CENTRAL)
    expected = 4 * np.sqrt(3) + 2 * np.pi / 3
    assert path.length == pytest.approx(expected, rel=ROUNDING)
    assert [type(piece) for piece in path.pieces] == [Segment, Arc] * 2 + [Segment]
    assert np.sign([p.sweep for p in path.pieces if isinstance(p, Arc)]).tolist() == [
        -1,
        1,
    ]


def test_blocks_that_touch_close_a_wall() -> None:
    wall = [Block((5, 2), 0.5, 2, 0.2), Block((5, 6), 0.5, 2, 0.2)]
    assert shortest_path(START, GOAL, wall, BOX) is None
    opened = [wall[0], Block((5, 6 + 1e-6), 0.5, 2, 0.2)]
    assert shortest_path(START, GOAL, opened, BOX) is not None


@pytest.mark.parametrize(
    "blocks",
    [
        [Block((6, 6.5), 0.1, 1.5, 0), Block((6, 1.5), 0.1, 1.5, 0)],
        [disc((6, 6), 0.3), Block((5, 1), 0.5, 1, 0)],
        [Block((5, 1), 0.5, 1, 0)],
    ],
    ids=["side of a block", "corner of a block", "box"],
)
def test_an_arc_is_blocked_off_its_middle_and_at_the_box(blocks: list[Block]) -> None:
    # The way round the central disc is closed below, and above by what is named.
    top = 5.9 if len(blocks) == 1 else 6.2
    box: Box = ((0, 0), (10, top))
    ends = ((2.9, 4.0), (7.1, 4.0))
    assert shortest_path(*ends, [disc((5, 4), 2), *blocks], box) is None
    assert the_path([disc((5, 4), 2)], *ends, BOX).length < 7


def test_arcs_among_overlapping_discs_meet_no_disc() -> None:
    # A drawn case in which an arc crosses a disc far from its middle.
    circles = [
        (7.3, 5.2, 1.3), (6.9, 1.3, 0.3), (4.9, 0.7, 1.2), (2.4, 3.2, 1.8),
        (3.1, 5.9, 1), (6.7, 4.7, 1.2), (5.9, 0.7, 0.8), (7.9, 8, 1.7),
        (5.2, 7.6, 1.2), (4.9, 5.7, 1.1),
    ]  # fmt: skip
    discs = [disc((x, y), r) for x, y, r in circles]
    path = the_path(discs, (0.1, 4), (9.9, 4))
    for piece in path.pieces:
        points = np.array([piece.point(share) for share in np.linspace(0, 1, 1000)]).T
        assert all(clearance(points, block).min() >= 0 for block in discs)


def the_direction(piece: Piece, share: float) -> Array:
    if isinstance(piece, Segment):
        return np.asarray(np.subtract(piece.end, piece.start) / piece.length)
    angle = piece.angle + share * piece.sweep
    left = np.array([-np.sin(angle), np.cos(angle)])
    return np.asarray(left * np.copysign(1, piece.sweep))


sizes = st.integers(1, 8).map(lambda n: n / 8)
blocks_drawn = st.lists(
    st.builds(
        lambda x, y, a, b, share: Block((x, y), a, b, share * min(a, b)),
        st.integers(16, 64).map(lambda n: n / 8),
        st.integers(0, 64).map(lambda n: n / 8),
        sizes,
        sizes.map(lambda b: 2 * b),
        st.sampled_from([0.0, 0.25, 1.0]),
    ),
    max_size=6,
)
"""Blocks on a coarse grid, so that sides are often in line, touch or overlap."""


@settings(max_examples=20)
@given(blocks_drawn)
def test_pieces_join_smoothly_and_meet_no_block(blocks: list[Block]) -> None:
    path = shortest_path(START, GOAL, blocks, BOX)
    if path is None:
        return
    assert sum(piece.length for piece in path.pieces) == pytest.approx(path.length)
    ends = [START, *(piece.point(1) for piece in path.pieces)]
    assert np.allclose(ends, [*(p.point(0) for p in path.pieces), GOAL], atol=1e-12)
    for piece in path.pieces:
        points = np.array([piece.point(share) for share in np.linspace(0, 1, 50)]).T
        assert all(clearance(points, block).min() >= 0 for block in blocks)
    # The direction of a segment as short as delta is known to few digits only.
    for first, second in pairwise(path.pieces):
        if min(p.length for p in (first, second) if isinstance(p, Segment)) > 1e-4:
            angle = the_direction(first, 1) @ the_direction(second, 0)
            assert angle == pytest.approx(1, abs=1e-9)


def turned(p: Point) -> Point:
    return -p[1], p[0]


def mirrored(p: Point) -> Point:
    return p[0], -p[1]


def scaled(p: Point) -> Point:
    return 1e3 * p[0], 1e3 * p[1]


def unmoved(p: Point) -> Point:
    return p


def the_box(corner: Point, other: Point) -> Box:
    (left, right), (low, high) = (
        sorted(pair) for pair in zip(corner, other, strict=True)
    )
    return (left, low), (right, high)


@settings(max_examples=20)
@given(
    blocks_drawn, st.sampled_from([turned, mirrored, scaled, unmoved]), st.booleans()
)
def test_length_is_unchanged_by_turns_mirrors_scales_and_reversal(
    blocks: list[Block], move: Callable[[Point], Point], back: bool
) -> None:
    factor = 1e3 if move is scaled else 1.0
    moved = []
    for block in blocks:
        a, b = move((block.half_width, block.half_height))
        moved.append(Block(move(block.center), abs(a), abs(b), factor * block.radius))
    ends = (GOAL, START) if back else (START, GOAL)
    box = the_box(move(BOX[0]), move(BOX[1]))
    other = length(moved, move(ends[0]), move(ends[1]), box)
    assert other == pytest.approx(factor * length(blocks), rel=ROUNDING)


@settings(max_examples=20)
@given(blocks_drawn.filter(bool))
def test_another_block_never_makes_the_path_shorter(blocks: list[Block]) -> None:
    fewer, straight = length(blocks[:-1]), np.hypot(*np.subtract(GOAL, START))
    assert straight - 1e-12 <= fewer <= length(blocks) + ROUNDING


coordinates = st.floats(-3, 3).map(lambda x: round(x, 3))


@given(coordinates, coordinates, coordinates, coordinates, sizes, sizes)
def test_clearance_of_a_segment_is_the_least_of_its_points(
    x: float, y: float, to_x: float, to_y: float, a: float, r: float
) -> None:
    block = Block((0.5, -0.25), a + r, r, r)
    start, end = np.array([[x], [y]]), np.array([[to_x], [to_y]])
    points = start + (end - start) * np.linspace(0, 1, 3001)
    sampled = clearance(points, block).min()
    exact = segment_clearance(start, end, block)[0]
    assert exact <= sampled + 1e-12
    assert sampled - exact <= np.hypot(to_x - x, to_y - y) / 3000 + 1e-12


def through_points(points: Array, blocks: list[Block]) -> float:
    """Return the shortest way from the first point to the last over free chords."""
    n = points.shape[1]
    i, j = np.triu_indices(n, 1)
    free = np.ones(i.size, dtype=bool)
    shares = np.linspace(0, 1, 200)
    for block in blocks:
        steps = points[:, i, None] + (points[:, j] - points[:, i])[:, :, None] * shares
        free &= (
            clearance(steps.reshape(2, -1), block).reshape(i.size, -1).min(1) >= -1e-9
        )
    graph = np.zeros((n, n))
    graph[i[free], j[free]] = np.hypot(*(points[:, j] - points[:, i]))[free]
    return float(dijkstra(graph, directed=False, indices=0)[-1])


def around(blocks: list[Block], count: int, factor: float) -> Array:
    """Return start, points around all corners on circles of factor r, and goal."""
    x, y, r = corners(blocks)[:, :, None]
    angle = 2 * np.pi * np.arange(count) / count
    rows = [x + factor * r * np.cos(angle), y + factor * r * np.sin(angle)]
    inner = np.array([row.ravel() for row in rows])
    outside = np.min([clearance(inner, block) for block in blocks], axis=0) >= -1e-9
    return np.column_stack([START, inner[:, outside], GOAL])


def test_ways_along_outer_polygons_converge_from_above() -> None:
    blocks = [disc((3, 4), 1.2), Block((6, 2), 0.8, 2.2, 0.6), disc((6, 5.6), 1)]
    exact = length(blocks)
    ways = [
        through_points(around(blocks, n, 1 / np.cos(np.pi / n)), blocks)
        for n in (8, 16, 32)
    ]
    assert exact < ways[2] < ways[1] < ways[0]
    assert ways[2] == pytest.approx(exact, rel=2e-3)


def test_chords_between_points_on_a_curved_boundary_are_no_way() -> None:
    # However many there are: every chord cuts the body.
    lone = [disc((5, 3.5), 1)]
    for n in (16, 64):
        assert through_points(around(lone, n, 1.0), lone) == np.inf


@pytest.mark.parametrize(
    ("inner", "factor"), [(True, -1 / 12), (False, 1 / 6)], ids=["nodes", "whole path"]
)
def test_held_controls_differ_from_the_optimum_by_the_stated_share(
    inner: bool, factor: float
) -> None:
    # Polygons round one disc by SLSQP, limited at their nodes or at all points.
    block, r = disc((0, 0), 1.0), 1.0
    start, goal = np.array([-1.3, 0.0]), np.array([1.3, 0.0])
    path = the_path([block], (-1.3, 0), (1.3, 0), CENTRAL)
    angle = sum(abs(piece.sweep) for piece in path.pieces if isinstance(piece, Arc))

    def cost(free: Array, n: int) -> float:
        nodes = np.column_stack([start, free.reshape(2, -1), goal])
        return float(n * (np.diff(nodes) ** 2).sum())

    def limits(free: Array) -> Array:
        nodes = np.column_stack([start, free.reshape(2, -1), goal])
        if inner:
            return np.asarray(np.hypot(*nodes[:, 1:-1]) - r)
        return segment_clearance(nodes[:, :-1], nodes[:, 1:], block)

    n = 16
    height = 1.2 * np.sin(np.pi * np.linspace(0, 1, n + 1))
    guess = np.array([np.linspace(-1.3, 1.3, n + 1), height])[:, 1:-1].ravel()
    found = minimize(
        cost, guess, (n,), method="SLSQP", options={"maxiter": 500, "ftol": 1e-12},
        constraints={"type": "ineq", "fun": limits},
    )  # fmt: skip
    expected = factor * angle * path.length / (r * n**2)
    assert found.fun / path.cost - 1 == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(
    ("start", "goal", "box", "message"),
    [
        ((11, 4), GOAL, BOX, r"start must be in the box .*, got \(11, 4\)"),
        (START, (5, 4), BOX, r"goal must be outside all blocks, got \(5, 4\), .* 0: "),
        (START, (6, 4), BOX, "goal must be outside all blocks"),
        (START, START, BOX, "start and goal must be two points"),
        (START, GOAL, (BOX[1], BOX[0]), "lower left corner first"),
    ],
    ids=["out of the box", "in a block", "on a block", "one point", "empty box"],
)
def test_ends_that_no_path_can_have_are_named(
    start: Point, goal: Point, box: Box, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        shortest_path(start, goal, [disc((5, 4), 1)], box)


@pytest.mark.parametrize("sizes", [(1, 1, 2), (1, 1, -1), (0, 0, 0), (np.nan, 1, 0)])
def test_invalid_blocks_are_refused(sizes: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="a block needs finite numbers, half sizes"):
        Block((0, 0), *sizes)


def test_enlarged_blocks_keep_their_core() -> None:
    block = enlarged(Block((1, 2), 3, 4, 0.5), 0.25)
    assert block == Block((1, 2), 3.25, 4.25, 0.75)
