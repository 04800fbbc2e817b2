"""A show is a ZIP file whose curves are the flights."""

import io
import json
import zipfile
from typing import Any

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.export.paths import ExportError, VehiclePath
from swarmstart.export.skybrush import skybrush_bytes
from swarmstart.tests.export.flights import loop, loop_at


def show_of(content: bytes) -> Any:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        assert archive.namelist() == ["show.json"] and archive.testzip() is None
        return json.loads(archive.read("show.json"))


def read(points: list[Any], times: Array) -> Array:
    """Return the places at times, by de Casteljau's rule, shape (k, 3)."""
    found = []
    for time in times:
        number = max(1, next(n for n, p in enumerate(points) if p[0] >= time))
        before, now = points[number - 1], points[number]
        share = (time - before[0]) / (now[0] - before[0])
        corners = np.array([before[1], *now[2], now[1]])
        while len(corners) > 1:
            corners = (1 - share) * corners[:-1] + share * corners[1:]
        found.append(corners[0])
    return np.array(found)


def test_the_curves_are_the_flight_within_the_error() -> None:
    show = show_of(skybrush_bytes([loop()], error=0.001))
    assert show["version"] == 1 and show["environment"] == {"type": "outdoor"}
    (drone,) = show["swarm"]["drones"]
    trajectory = drone["settings"]["trajectory"]
    assert trajectory["version"] == 1
    points = trajectory["points"]
    assert points[0][0] == 0.0 and points[0][2] == []
    assert all(len(point[2]) == 2 for point in points[1:])
    assert (np.diff([point[0] for point in points]) > 0).all()
    times = np.linspace(0.0, 20.0, 401)
    off = np.linalg.norm(read(points, times) - loop_at(times), axis=1)
    assert off.max() <= 0.001


def test_every_vehicle_is_a_drone_and_the_bytes_are_the_same_again() -> None:
    other = VehiclePath("other", [0, 1], [[0, 0, 1], [1, 0, 1]])
    content = skybrush_bytes([loop(), other])
    names = [one["settings"]["name"] for one in show_of(content)["swarm"]["drones"]]
    assert names == ["loop", "other"]
    assert content == skybrush_bytes([loop(), other])


def test_an_error_below_the_rounding_is_refused() -> None:
    with pytest.raises(ExportError, match="expected an error"):
        skybrush_bytes([loop()], error=5e-5)
