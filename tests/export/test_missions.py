"""Missions have the fields of their formats, and follow the path."""

import itertools
import json

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.export.missions import plan_text, waypoints, waypoints_text
from swarmstart.export.paths import Origin, VehiclePath
from swarmstart.tests.export.flights import loop

AT = Origin(latitude=47.0, longitude=8.0, altitude=400.0)


def local(places: list[tuple[float, ...]]) -> Array:
    """Return waypoints in the frame of the origin, to the first order [m]."""
    rows = np.array(places)
    north = (rows[:, 0] - 47.0) * 111_160.7
    east = (rows[:, 1] - 8.0) * 76_056.3
    return np.stack([east, north, rows[:, 2]], axis=1)


def test_every_sample_is_near_the_straight_ways() -> None:
    path = loop()
    found = local(waypoints(path, AT, 0.1))
    assert 10 < len(found) < 100
    least = np.full(len(path.positions), np.inf)
    for begin, end in itertools.pairwise(found):
        way = end - begin
        share = np.clip((path.positions - begin) @ way / (way @ way), 0.0, 1.0)
        near = begin + share[:, None] * way
        least = np.minimum(least, np.linalg.norm(path.positions - near, axis=1))
    assert least.max() <= 0.1 + 1e-3


def test_a_straight_way_has_two_waypoints_and_a_smaller_error_has_more() -> None:
    straight = VehiclePath("s", np.arange(9.0), np.outer(np.arange(9.0), [1, 2, 0.5]))
    assert len(waypoints(straight, AT, 1e-9)) == 2
    assert len(waypoints(loop(), AT, 0.01)) > len(waypoints(loop(), AT, 0.1))


def test_the_plan_has_what_the_ground_station_reads() -> None:
    plan = json.loads(plan_text(loop(), AT))
    assert (plan["fileType"], plan["version"]) == ("Plan", 1)
    assert plan["geoFence"]["version"] == plan["rallyPoints"]["version"] == 2
    mission = plan["mission"]
    assert mission["version"] == 2
    assert mission["plannedHomePosition"] == [47.0, 8.0, 400.0]
    items = mission["items"]
    assert [one["doJumpId"] for one in items] == list(range(1, len(items) + 1))
    for one, place in zip(items, waypoints(loop(), AT, 0.1), strict=True):
        assert one["type"] == "SimpleItem" and one["autoContinue"] is True
        assert (one["command"], one["frame"], len(one["params"])) == (16, 3, 7)
        assert one["params"][4:] == list(place)


def test_the_text_has_twelve_fields_a_line() -> None:
    text = waypoints_text(loop(), AT)
    first, *lines = text.splitlines()
    assert first == "QGC WPL 110"
    fields = [line.split("\t") for line in lines]
    assert {len(one) for one in fields} == {12}
    assert [int(one[0]) for one in fields] == list(range(len(lines)))
    assert [one[1] for one in fields] == ["1"] + ["0"] * (len(lines) - 1)
    assert [float(word) for word in fields[0][8:11]] == [47.0, 8.0, 400.0]
    found = [tuple(float(word) for word in one[8:11]) for one in fields[1:]]
    expected = waypoints(loop(), AT, 0.1)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_pymavlink_reads_the_waypoints(tmp_path: object) -> None:
    mavwp = pytest.importorskip("pymavlink.mavwp")
    file = f"{tmp_path}/loop.waypoints"
    with open(file, "w", encoding="utf-8") as written:
        written.write(waypoints_text(loop(), AT))
    loader = mavwp.MAVWPLoader()
    assert loader.load(file) == len(waypoints(loop(), AT, 0.1)) + 1
    assert loader.wp(1).x == pytest.approx(waypoints(loop(), AT, 0.1)[0][0], abs=1e-7)
