"""Missions for autopilots: waypoints on the earth, without times.

There are two formats: `.plan` is JSON of QGroundControl; "QGC WPL 110" is text that
ArduPilot and PX4 read. Heights count from the origin. A mission is a path and no
trajectory: the autopilot decides how fast the vehicle goes.
"""

from __future__ import annotations

import json

import numpy as np

from swarmstart.arrays import Array
from swarmstart.export.paths import Origin, VehiclePath

WAYPOINT, RELATIVE_ALTITUDE = 16, 3
"""MAV_CMD_NAV_WAYPOINT and MAV_FRAME_GLOBAL_RELATIVE_ALT."""
GENERIC_AUTOPILOT, QUADROTOR = 0, 2
"""MAV_AUTOPILOT_GENERIC and MAV_TYPE_QUADROTOR."""


def plan_text(
    path: VehiclePath, origin: Origin, *, error: float = 0.1, speed: float = 5.0
) -> str:
    """Return a mission as JSON of QGroundControl.

    Args:
        path: Path of the vehicle.
        origin: Place of the path's frame on the earth.
        error: Largest distance of a sample of the path from the straight lines between
            waypoints [m].
        speed: Speed that the mission sets for the autopilot [m/s].
    """
    items = [
        {
            "type": "SimpleItem",
            "autoContinue": True,
            "command": WAYPOINT,
            "doJumpId": number,
            "frame": RELATIVE_ALTITUDE,
            "params": [0, 0, 0, None, latitude, longitude, height],
        }
        for number, (latitude, longitude, height) in enumerate(
            waypoints(path, origin, error), 1
        )
    ]
    content = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [], "version": 2},
        "mission": {
            "version": 2,
            "firmwareType": GENERIC_AUTOPILOT,
            "vehicleType": QUADROTOR,
            "cruiseSpeed": speed,
            "hoverSpeed": speed,
            "plannedHomePosition": [
                origin.latitude, origin.longitude, origin.altitude
            ],
            "items": items,
        },
    }  # fmt: skip
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def waypoints_text(path: VehiclePath, origin: Origin, *, error: float = 0.1) -> str:
    """Return a mission as "QGC WPL 110"; line 0 is the origin; see `plan_text`."""
    home = (origin.latitude, origin.longitude, origin.altitude)
    lines = ["QGC WPL 110", _line(0, 0, home)]
    for number, place in enumerate(waypoints(path, origin, error), 1):
        lines.append(_line(number, RELATIVE_ALTITUDE, place))
    return "\n".join(lines) + "\n"


def _line(number: int, frame: int, place: tuple[float, ...]) -> str:
    is_current = int(number == 0)
    numbers = [*[0.0] * 4, *place]
    return "\t".join(
        [str(number), str(is_current), str(frame), str(WAYPOINT)]
        + [f"{one:.9f}" for one in numbers]
        + ["1"]
    )


def waypoints(
    path: VehiclePath, origin: Origin, error: float
) -> list[tuple[float, ...]]:
    """Return latitudes, longitudes [deg] and heights above the origin [m].

    Args:
        path: Path of the vehicle.
        origin: Place of the path's frame on the earth.
        error: Largest distance of a sample of the path from the straight lines between
            waypoints [m].
    """
    places = path.positions[_corners(path.positions, error)]
    on_earth = origin.geodetic(places)
    on_earth[:, 2] -= origin.altitude
    return [tuple(row) for row in on_earth.tolist()]


def _corners(places: Array, error: float) -> list[int]:
    """Return the samples between which straight lines are near enough to the path.

    Source: Douglas and Peucker (1973), Cartographica 10.
    """
    kept, parts = {0, len(places) - 1}, [(0, len(places) - 1)]
    while parts:
        begin, end = parts.pop()
        if end - begin <= 1:
            continue
        way = places[end] - places[begin]
        off = places[begin + 1 : end] - places[begin]
        share = np.clip(off @ way / max(float(way @ way), 1e-300), 0.0, 1.0)
        away = np.linalg.norm(off - np.outer(share, way), axis=1)
        worst = int(away.argmax())
        if away[worst] > error:
            middle = begin + 1 + worst
            kept.add(middle)
            parts += [(begin, middle), (middle, end)]
    return sorted(kept)
