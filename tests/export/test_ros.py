"""Another reader finds the poses of the flight in a bag."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmstart.export.paths import VehiclePath
from swarmstart.tests.export.flights import loop

pytest.importorskip("mcap_ros2")
from swarmstart.export.ros import mcap_bytes, topic


def test_rosbags_reads_the_poses_at_their_times(tmp_path: Path) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel")
    paths = [loop(), VehiclePath("7", [0.0, 1.5], [[0, 0, 1], [1, 2, 3]])]
    file = tmp_path / "flight.mcap"
    file.write_bytes(mcap_bytes(paths))
    found: dict[str, list[tuple[int, Any]]] = {}
    with highlevel.AnyReader([file]) as reader:
        for link, when, raw in reader.messages():
            message = reader.deserialize(raw, link.msgtype)
            found.setdefault(link.topic, []).append((when, message))
    assert {*found} == {
        "/loop/pose",
        "/loop/path",
        "/vehicle_7/pose",
        "/vehicle_7/path",
    }
    for path in paths:
        poses = found[f"/{topic(path)}/pose"]
        whole = found[f"/{topic(path)}/path"][0][1]
        assert [when for when, _ in poses] == [round(1e9 * t) for t in path.times]
        for read in ([m for _, m in poses], whole.poses):
            places = [[getattr(m.pose.position, axis) for axis in "xyz"] for m in read]
            np.testing.assert_array_equal(places, path.positions)
            assert {m.pose.orientation.w for m in read} == {1.0}
            assert {m.header.frame_id for m in read} == {"map"}
