"""Path of a vehicle over time, and the place of its frame on the earth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError

AXES = 3
FARTHEST = 1e9
"""Largest time [s] and coordinate [m]; in larger ones a millimetre is rounding."""
EQUATOR_M, FLATTENING = 6_378_137.0, 1.0 / 298.257223563
"""Semi-major axis [m] and flattening of WGS 84."""
MOST_LATITUDE, MOST_LONGITUDE = 89.0, 180.0
"""Largest latitude, so that east is defined, and longitude of an origin [deg]."""
ROUNDS = 6
"""Steps of the iteration for latitude and altitude, more than doubles need."""


class ExportError(SwarmstartError):
    """A path or a controller cannot be written in a format, or not exactly enough."""


@dataclass(frozen=True, init=False, slots=True, eq=False)
class VehiclePath:
    """Positions of a vehicle over time.

    Attributes:
        name: Name of the vehicle.
        times: Times from 0 on, rising, shape (k,) [s].
        positions: Positions, z up, shape (k, 3) [m].

    Raises:
        ExportError: If shapes do not fit, a number is not finite or beyond 1e9 in size,
            there are fewer than two times, or times do not rise.
    """

    name: str
    times: Array
    positions: Array

    def __init__(self, name: str, times: ArrayLike, positions: ArrayLike) -> None:
        """Copy the arrays, and count the times from the first one."""
        when = np.array(times, dtype=np.float64)
        places = np.array(positions, dtype=np.float64)
        if when.ndim != 1 or places.shape != (when.size, AXES) or when.size <= 1:
            raise ExportError(
                f"vehicle {name}: expected two times or more and as many positions of "
                f"{AXES} numbers, found shapes {when.shape} and {places.shape}"
            )
        for what, numbers in (("times", when), ("positions", places)):
            if not (np.abs(numbers) <= FARTHEST).all():  # Nor is NaN.
                raise ExportError(
                    f"vehicle {name}: expected {what} between {-FARTHEST:g} and "
                    f"{FARTHEST:g}, found {numbers[~(np.abs(numbers) <= FARTHEST)][0]}"
                )
        if not (np.diff(when) > 0).all():
            raise ExportError(f"vehicle {name}: expected times that rise")
        for key, value in (("times", when - when[0]), ("positions", places)):
            value.flags.writeable = False
            object.__setattr__(self, key, value)
        object.__setattr__(self, "name", name)

    @property
    def duration(self) -> float:
        """Time from the first to the last position [s]."""
        return float(self.times[-1])


@dataclass(frozen=True, kw_only=True, slots=True)
class Origin:
    """Place of a local frame on the earth.

    Attributes:
        latitude: Latitude of the frame's origin [deg].
        longitude: Longitude of the frame's origin [deg].
        altitude: Height of the frame's origin above the reference ellipsoid of the
            earth [m].
        heading: Direction of the frame's x axis, clockwise from north; y is to the left
            of x [deg].

    Raises:
        ExportError: If a number is not finite, or no place on the earth, or the place
            is too near to a pole.
    """

    latitude: float
    longitude: float
    altitude: float = 0.0
    heading: float = 90.0

    def __post_init__(self) -> None:
        """Check the place."""
        limits = {
            "latitude": MOST_LATITUDE, "longitude": MOST_LONGITUDE,
            "altitude": 1e5, "heading": 360.0,
        }  # fmt: skip
        for name, most in limits.items():
            if not abs(getattr(self, name)) <= most:
                raise ExportError(
                    f"expected a {name} from {-most:g} to {most:g}, found "
                    f"{getattr(self, name):g}"
                )

    def geodetic(self, positions: Array) -> Array:
        """Return latitudes [deg], longitudes [deg] and heights [m], shape (k, 3).

        Args:
            positions: Positions in the frame, shape (k, 3) [m].
        """
        turned, at = np.radians([self.heading, self.latitude]), self.longitude
        north = np.array([np.cos(turned[0]), np.sin(turned[0]), 0.0]) @ positions.T
        east = np.array([np.sin(turned[0]), -np.cos(turned[0]), 0.0]) @ positions.T
        phi, lam = turned[1], np.radians(at)
        to_east = np.array([-np.sin(lam), np.cos(lam), 0.0])
        to_up = np.array([np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam),
                          np.sin(phi)])  # fmt: skip
        to_north = np.cross(to_up, to_east)
        places = self._cartesian()[:, None] + (
            np.outer(to_east, east)
            + np.outer(to_north, north)
            + np.outer(to_up, positions[:, 2])
        )
        return _geodetic(places)

    def _cartesian(self) -> Array:
        """Return the origin in the frame of the earth's centre, shape (3,) [m]."""
        phi, lam = np.radians([self.latitude, self.longitude])
        squared = FLATTENING * (2.0 - FLATTENING)
        across = EQUATOR_M / np.sqrt(1.0 - squared * np.sin(phi) ** 2)
        flat = (across + self.altitude) * np.cos(phi)
        up = (across * (1.0 - squared) + self.altitude) * np.sin(phi)
        return np.array([flat * np.cos(lam), flat * np.sin(lam), up])


def _geodetic(places: Array) -> Array:
    """Return latitudes, longitudes [deg] and heights [m] of points (3, k), (k, 3)."""
    x, y, z = places
    squared, flat = FLATTENING * (2.0 - FLATTENING), np.hypot(x, y)
    phi = np.arctan2(z, flat * (1.0 - squared))
    height = np.zeros_like(phi)
    for _ in range(ROUNDS):
        across = EQUATOR_M / np.sqrt(1.0 - squared * np.sin(phi) ** 2)
        height = flat / np.cos(phi) - across
        phi = np.arctan2(z, flat * (1.0 - squared * across / (across + height)))
    return np.stack([np.degrees(phi), np.degrees(np.arctan2(y, x)), height], axis=1)
