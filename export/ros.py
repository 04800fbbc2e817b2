"""Bag of ROS 2 in the container MCAP: the poses of each vehicle over time.

Topics are /NAME/pose (geometry_msgs/PoseStamped), a message for each sample, and
/NAME/path (nav_msgs/Path), the whole path in one message at time 0. Vehicles have no
orientation: the quaternion is (0, 0, 0, 1). Times count from 0.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

from swarmstart.errors import load_optional
from swarmstart.export.paths import VehiclePath

FRAME = "map"
"""Frame of the positions, x east and y north in the convention of ROS (REP 105)."""
SEPARATOR = "\n" + 80 * "=" + "\n"
_HEADER = """MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id"""
_TIME = """MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec"""
_POSE = """MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation"""
_POINT = """MSG: geometry_msgs/Point
float64 x
float64 y
float64 z"""
_QUATERNION = """MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w"""
_PARTS = (_HEADER, _TIME, _POSE, _POINT, _QUATERNION)
_STAMPED = """std_msgs/Header header
geometry_msgs/Pose pose"""
POSE, PATH = "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Path"
DEFINITIONS = {
    POSE: SEPARATOR.join([_STAMPED, *_PARTS]),
    PATH: SEPARATOR.join(
        [
            "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses",
            "MSG: geometry_msgs/PoseStamped\n" + _STAMPED,
            *_PARTS,
        ]
    ),
}
"""Type of a message -> its definition, as a bag has it."""


def mcap_bytes(paths: Sequence[VehiclePath]) -> bytes:
    """Return a bag with the poses of vehicles.

    Args:
        paths: Paths of the vehicles.

    Raises:
        MissingPackageError: If mcap-ros2-support is not installed.
    """
    ros = load_optional("mcap_ros2.writer", extra="ros", need="a bag of ROS 2")
    made = io.BytesIO()
    bag = ros.writer.Writer(made)
    schemas = {
        name: bag.register_msgdef(name, text) for name, text in DEFINITIONS.items()
    }
    for path in paths:
        poses = [
            _stamped(round(1e9 * time), place)
            for time, place in zip(
                path.times.tolist(), path.positions.tolist(), strict=True
            )
        ]
        whole = {"header": _header(0), "poses": poses}
        bag.write_message(f"/{topic(path)}/path", schemas[PATH], whole, log_time=0)
        for pose in poses:
            stamp = pose["header"]["stamp"]
            bag.write_message(
                f"/{topic(path)}/pose", schemas[POSE], pose,
                log_time=stamp["sec"] * 10**9 + stamp["nanosec"],
            )  # fmt: skip
    bag.finish()
    return made.getvalue()


def topic(path: VehiclePath) -> str:
    """Return the name of a vehicle as ROS takes it: it begins with a letter."""
    name = path.name.replace("-", "_")
    return name if name[0].isalpha() else f"vehicle_{name}"


def _header(nanoseconds: int) -> dict[str, Any]:
    seconds, rest = divmod(nanoseconds, 10**9)
    return {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": FRAME}


def _stamped(nanoseconds: int, place: Sequence[float]) -> dict[str, Any]:
    point = dict(zip("xyz", place, strict=True))
    turn = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    return {
        "header": _header(nanoseconds),
        "pose": {"position": point, "orientation": turn},
    }
