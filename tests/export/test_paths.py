"""Paths are checked, and places on the earth are those of WGS 84."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmstart.export.paths import ExportError, Origin, VehiclePath


@pytest.mark.parametrize(
    ("times", "positions", "said"),
    [
        ([0, 1], [[0, 0, 0]], "two times or more"),
        ([0], [[0, 0, 0]], "two times or more"),
        ([0, 1], [[0, 0], [1, 1]], "3 numbers"),
        ([0, 0], [[0, 0, 0], [1, 1, 1]], "times that rise"),
        ([0, 1], [[0, 0, 0], [1, 1e300, 1]], "positions between -1e\\+09 and 1e\\+09"),
        ([0, np.nan], [[0, 0, 0], [1, 1, 1]], "times between .* found nan"),
        ([0, 1], [[0, 0, 0], [1, np.inf, 1]], "positions between .* found inf"),
    ],
)
def test_a_path_that_is_none_is_refused_with_its_name(
    times: Any, positions: Any, said: str
) -> None:
    with pytest.raises(ExportError, match=f"vehicle red: expected .*{said}"):
        VehiclePath("red", times, positions)


def test_times_count_from_the_first_and_arrays_are_copies() -> None:
    times = np.array([2.0, 3.0, 5.0])
    path = VehiclePath("red", times, np.eye(3))
    times[0] = 9.0
    assert path.times.tolist() == [0.0, 1.0, 3.0] and path.duration == 3.0
    with pytest.raises(ValueError, match="read-only"):
        path.positions[0, 0] = 1.0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"latitude": 90.0}, "a latitude from -89 to 89, found 90"),
        ({"longitude": 181.0}, "a longitude"),
        ({"altitude": np.nan}, "an? altitude"),
        ({"heading": np.inf}, "a heading"),
    ],
)
def test_an_origin_that_is_no_place_is_refused(
    changes: dict[str, float], said: str
) -> None:
    with pytest.raises(ExportError, match=said):
        Origin(**{"latitude": 47.0, "longitude": 8.0, **changes})


def test_a_degree_of_latitude_has_its_published_length() -> None:
    # 111.132 km at 45 degrees, 110.574 km at the equator (WGS 84, NGA).
    for latitude, metres in ((45.0, 111_132.0), (0.0, 110_574.0)):
        at = Origin(latitude=latitude - 0.005, longitude=8.0)
        found = at.geodetic(np.array([[0.0, metres / 100, 0.0]]))[0]
        assert found[0] == pytest.approx(latitude + 0.005, abs=2e-7)


def test_x_points_along_the_heading_and_y_to_its_left() -> None:
    places = np.array([[100.0, 0.0, 0.0], [0.0, 100.0, 0.0]])
    for heading, of_x, of_y in ((90, "east", "north"), (0, "north", "west")):
        at = Origin(latitude=47.0, longitude=8.0, heading=heading)
        for place, side in zip(at.geodetic(places), (of_x, of_y), strict=True):
            moved = {
                "north": place[0] - 47.0, "east": place[1] - 8.0, "west": 8.0 - place[1]
            }  # fmt: skip
            assert moved[side] > 5e-4
            assert max(v for k, v in moved.items() if k != side) < 1e-7


@given(
    st.floats(-88, 88), st.floats(-180, 180), st.floats(-100, 5000), st.floats(0, 360),
    st.lists(st.floats(-5000, 5000), min_size=3, max_size=3),
)  # fmt: skip
def test_distances_are_kept_on_the_earth(
    latitude: float, longitude: float, altitude: float, heading: float,
    place: list[float],
) -> None:  # fmt: skip
    at = Origin(
        latitude=latitude, longitude=longitude, altitude=altitude, heading=heading
    )
    here, there = at.geodetic(np.array([[0.0, 0.0, 0.0], place]))
    np.testing.assert_allclose(here[0], latitude, atol=1e-11)
    assert here[2] == pytest.approx(altitude, abs=1e-6)
    apart = np.linalg.norm(cartesian(there) - cartesian(here))
    assert apart == pytest.approx(np.linalg.norm(place), abs=1e-6)


def cartesian(place: Any) -> Any:
    """Return a place in the frame of the earth's centre, written independently [m]."""
    a, f = 6378137.0, 1 / 298.257223563
    phi, lam, h = np.radians(place[0]), np.radians(place[1]), place[2]
    n = a / np.sqrt(1 - f * (2 - f) * np.sin(phi) ** 2)
    return np.array(
        [
            (n + h) * np.cos(phi) * np.cos(lam),
            (n + h) * np.cos(phi) * np.sin(lam),
            (n * (1 - f) ** 2 + h) * np.sin(phi),
        ]
    )
