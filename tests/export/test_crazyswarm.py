"""A reader written from the format finds the flight again."""

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.export.crazyswarm import crazyswarm_text
from swarmstart.export.paths import ExportError
from swarmstart.tests.export.flights import loop, loop_at


def read(text: str, times: Array) -> Array:
    """Return (x, y, z, yaw) at times, shape (k, 4), as a vehicle evaluates the file."""
    rows = [
        [float(word) for word in line.split(",")] for line in text.split("\n")[1:-1]
    ]
    begins = np.concatenate([[0.0], np.cumsum([row[0] for row in rows])])
    found = []
    for time in times:
        number = min(int(np.searchsorted(begins, time, "right")) - 1, len(rows) - 1)
        since, row = time - begins[number], rows[number]
        found.append(
            [
                sum(c * since**n for n, c in enumerate(row[1 + 8 * k : 9 + 8 * k]))
                for k in range(4)
            ]
        )
    return np.array(found)


def test_the_file_is_the_flight_within_the_error() -> None:
    text = crazyswarm_text(loop(), error=0.002)
    lines = text.splitlines()
    assert lines[0].startswith("Duration,x^0,x^1") and lines[0].endswith("yaw^7")
    assert len(lines) - 1 <= 31
    assert all(len(line.split(",")) == 33 for line in lines)
    times = np.linspace(0.0, 20.0, 401)
    found = read(text, times)
    off = np.linalg.norm(found[:, :3] - loop_at(times), axis=1)
    assert off.max() <= 0.002 + 1e-5
    assert not found[:, 3].any()
    total = sum(float(line.split(",")[0]) for line in lines[1:])
    assert total == pytest.approx(20.0, abs=1e-6)


def test_a_flight_that_is_too_fast_or_too_long_is_refused() -> None:
    with pytest.raises(ExportError, match=r"speed of at most 3 m/s, found 3\.27"):
        crazyswarm_text(loop(), speed=3.0)
    with pytest.raises(ExportError, match=r"acceleration of at most 3\.5 m/s\^2"):
        crazyswarm_text(loop(), acceleration=3.5)
    with pytest.raises(ExportError, match="31 pieces of degree 7"):
        crazyswarm_text(loop(seconds=300.0, samples=9001))
    assert crazyswarm_text(loop(), speed=3.4, acceleration=4.5)
