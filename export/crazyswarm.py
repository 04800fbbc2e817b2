"""Trajectory of a Crazyflie: polynomials of degree 7, for Crazyswarm and Crazyswarm2.

A line has the duration of a piece and eight coefficients, the constant first, of x, y,
z [m] and yaw [rad], which is 0. The memory of the vehicle has room for 31 pieces.
"""

from __future__ import annotations

from collections.abc import Mapping

from swarmstart.export.paths import ExportError, VehiclePath
from swarmstart.export.pieces import Pieces, fitted

DEGREE, MOST_PIECES = 7, 31
HEADER = ",".join(
    ["Duration", *(f"{axis}^{n}" for axis in ("x", "y", "z", "yaw") for n in range(8))]
)
LIMITS = {"speed": (1, "m/s"), "acceleration": (2, "m/s^2")}
"""Name of a limit -> the derivative that it limits, and its unit."""


def crazyswarm_text(path: VehiclePath, *, error: float = 0.005, **limits: float) -> str:
    """Return the trajectory of a vehicle as CSV.

    Args:
        path: Path of the vehicle.
        error: Largest allowed distance of the polynomials from the path's samples [m].
        **limits: Largest speed [m/s] and acceleration [m/s^2] of the polynomials.

    Raises:
        ExportError: If 31 pieces are not near enough, or a limit is exceeded.
    """
    return text_of(pieces_of(path, error=error, limits=limits))


def pieces_of(
    path: VehiclePath, *, error: float, limits: Mapping[str, float]
) -> Pieces:
    """Return the polynomials, which keep the limits; see `crazyswarm_text`."""
    found = fitted(path, DEGREE, error, MOST_PIECES)
    for name, most in limits.items():
        derivative, unit = LIMITS[name]
        size, time = found.largest(derivative)
        if size > most:
            raise ExportError(
                f"vehicle {path.name}: expected a {name} of at most {most:g} {unit}, "
                f"found {size:.4g} {unit} at {time:.3g} s"
            )
    return found


def text_of(pieces: Pieces) -> str:
    """Return polynomials as CSV."""
    lines = [HEADER]
    for length, piece in zip(pieces.lengths, pieces.coefficients, strict=True):
        numbers = [length, *piece.T.ravel(), *[0.0] * (DEGREE + 1)]
        lines.append(",".join(f"{number:.9g}" for number in numbers))
    return "\n".join(lines) + "\n"
