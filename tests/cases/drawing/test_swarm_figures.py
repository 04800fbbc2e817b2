"""The figure of a swarm's flight: its numbers are those of the flight."""

import numpy as np
import pytest

import swarmstart as ss


@pytest.fixture(scope="module")
def flight() -> ss.SwarmFlight:
    swarm = ss.Swarm(
        starts=np.array([[0.0, 0, 0], [2, 0, 0], [1, 1, 0]]),
        goals=np.array([[2.0, 0, 0], [0, 0, 0], [1, -1, 0]]),
        distance=0.3,
        obstacles=[
            ss.Obstacle(radius=0.1, path=[[1.0, 0.4, 0.0]]),
            ss.Obstacle(radius=0.1, path=[[-2, 3, 0], [3, 3, 0]], times=[0.0, 5.0]),
        ],
    )
    return ss.simulate_swarm(swarm, seed=0)


def test_tracks_distance_and_arrivals_are_those_of_the_flight(
    flight: ss.SwarmFlight,
) -> None:
    tracks, near, arrived = flight.plot().axes
    drawn = [line.get_xydata() for line in tracks.lines if line.get_linewidth() == 1.0]
    assert len(drawn) == 3
    for path, line in zip(flight.positions, drawn, strict=True):
        assert np.array_equal(path[:2].T, line)
    (stairs,) = near.patches
    assert np.array_equal(stairs.get_data().values, flight.apart)
    (limit,) = [line for line in near.lines if line.get_label() == "least distance"]
    assert set(limit.get_ydata()) == {0.3}
    times, shares = arrived.lines[0].get_data()
    assert shares[-1] == 1.0
    for time, share in zip(times, shares, strict=True):
        assert share == pytest.approx((flight.arrival_s <= time).mean())
    assert len(tracks.patches) == 2
    names = [text.get_text() for text in tracks.figure.legends[0].get_texts()]
    assert names == ["obstacle", "start", "goal", "nearest two", "least distance"]


def test_one_vehicle_has_no_distance() -> None:
    swarm = ss.Swarm(starts=np.zeros((1, 3)), goals=np.ones((1, 3)), distance=0.3)
    _, near, _ = ss.simulate_swarm(swarm, seed=0).plot().axes
    assert not near.patches
