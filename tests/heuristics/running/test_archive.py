"""The best distinct basins."""

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    Algorithm,
    Box,
    Budget,
    DifferentialEvolution,
    Order,
    Search,
    feasibility_first,
    minimize,
)
from swarmstart.heuristics.laws.order import better_at
from swarmstart.heuristics.running.archive import (
    Archive,
    collect,
    distance,
    new_archive,
)

BOX = Box(lower=np.array([-1.0, 0.0, 5.0]), upper=np.array([1.0, 8.0, 6.0]))


def spread(points: Array) -> Array:
    """Distances of all pairs, shape (n, n), by the formula of the module."""
    scaled = points / BOX.width[:, None]
    squares = (scaled[:, :, None] - scaled[:, None, :]) ** 2
    distances: Array = np.sqrt(squares.mean(axis=0))
    return distances


def filled(order: Order, generations: int, size: int, *, room: int) -> Archive:
    archive = new_archive(BOX, room=room, radius=0.2)
    rng = np.random.default_rng(room + size)
    for _ in range(generations):
        points = BOX.lower[:, None] + BOX.width[:, None] * rng.random((3, size))
        cost, violation = rng.normal(size=size), np.maximum(rng.normal(size=size), 0)
        cost[rng.random(size) < 0.2] = np.nan
        collect(order.running(), archive, points, cost, violation)
    return archive


def test_distance_is_the_root_of_the_mean_square_of_the_fractions() -> None:
    archive = filled(feasibility_first(), 1, 30, room=5)
    points = archive.points[:, : archive.members[0]]
    expected = spread(points)
    for k in range(points.shape[1]):
        measured = [distance(archive, point.copy(), k) for point in points.T]
        np.testing.assert_allclose(measured, expected[k], rtol=1e-14)


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 9), st.integers(1, 6), st.integers(1, 20))
def test_members_are_apart_in_order_and_no_more_than_there_is_room_for(
    order: Order, room: int, generations: int, size: int
) -> None:
    archive = filled(order, generations, size, room=room)
    members = int(archive.members[0])
    assert members <= room
    apart = spread(archive.points[:, :members]) + np.eye(members)
    assert (apart >= archive.radius[0] * (1.0 - 1e-12)).all()
    values = list(zip(archive.cost, archive.violation, strict=True))[:members]
    assert np.isfinite(values).all()
    running = order.running()
    for earlier, later in itertools.pairwise(values):
        assert not better_at(running, order.tolerance, *later, *earlier)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 7), st.integers(0, 3)), min_size=1, max_size=40),
    st.integers(1, 8),
    st.integers(1, 7),
    st.randoms(use_true_random=False),
)
def test_the_best_of_each_of_the_best_clusters_is_kept(
    told: list[tuple[int, int]], room: int, size: int, random: object
) -> None:
    # Clusters 1 apart and 3/16 wide, in a box 8 wide; the radius is 0.4.
    box = Box(lower=np.zeros(1), upper=np.full(1, 8.0))
    points = np.array([[cluster + k / 16 for cluster, k in told]])
    cost = np.arange(len(told), dtype=np.float64)
    random.shuffle(cost)  # type: ignore[attr-defined]
    archive = new_archive(box, room=room, radius=0.05)
    order = feasibility_first().running()
    for k in range(0, len(told), size):
        part = slice(k, k + size)
        violation = np.zeros(cost[part].size)
        collect(order, archive, points[:, part].copy(), cost[part], violation)
    clusters = np.floor(points[0]).astype(int)
    best = [int(np.where(clusters == c, cost, np.inf).argmin()) for c in set(clusters)]
    best = sorted(best, key=cost.__getitem__)[:room]
    members = int(archive.members[0])
    assert archive.cost[:members].tolist() == cost[best].tolist()
    assert archive.points[0, :members].tolist() == points[0, best].tolist()


def test_the_best_found_is_the_first_member(algorithm: Algorithm, order: Order) -> None:
    rng = np.random.default_rng(1)
    search = Search(algorithm, BOX, order=order, rng=rng, basins=3)
    for k in range(15):
        points = search.ask(progress=k / 14)
        cost = np.where(points[0] > 0.5, np.nan, (points**2).sum(axis=0))
        search.tell(cost, np.maximum(3.0 - points[1], 0.0))
        first = search.basins[0]
        np.testing.assert_array_equal(first.x, search.best.x)
        assert first[1:] == search.best[1:]


def test_without_room_nothing_is_kept() -> None:
    assert filled(feasibility_first(), 3, 9, room=0).members[0] == 0
    search = Search(DifferentialEvolution(), BOX, rng=np.random.default_rng(2))
    search.tell(search.ask().sum(axis=0), np.zeros(50))
    assert search.basins == ()


def test_both_minima_of_a_function_with_two_are_found() -> None:
    minima = np.array([[0.5, -0.5], [0.0, 0.0]])

    def two(points: Array) -> tuple[Array, Array]:
        squares = ((points[:, :, None] - minima[:, None, :]) ** 2).sum(axis=0)
        return (squares + np.array([0.0, 0.1])).min(axis=1), np.zeros(points.shape[1])

    result = minimize(
        two,
        Box(lower=np.full(2, -1.0), upper=np.full(2, 1.0)),
        algorithm=DifferentialEvolution(size=30),
        budget=Budget(evaluations=3000),
        rng=np.random.default_rng(3),
        basins=2,
        radius=0.25,
    )
    # The minima are 0.35 apart. The other basin is left early: its best is coarse.
    assert len(result.basins) == 2
    np.testing.assert_allclose(result.basins[0].x, minima[:, 0], atol=1e-3)
    np.testing.assert_allclose(result.basins[1].x, minima[:, 1], atol=0.1)
    assert result.basins[0].cost == result.cost
