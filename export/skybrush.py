"""Show of drones without lights for Skybrush: a ZIP file with `show.json`.

A trajectory is a list of points [time, place, control points]: the path from the point
before is the Bezier curve with these control points, here a cubic one.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Sequence

import numpy as np

from swarmstart.arrays import Array
from swarmstart.export.paths import VehiclePath
from swarmstart.export.pieces import fitted

DEGREE, MOST_PIECES = 3, 4096
DIGITS = 4
"""Digits of a place after the point: a tenth of a millimetre."""
EPOCH = (1980, 1, 1, 0, 0, 0)
"""Time of the entries of the file, so that the same show has the same bytes."""


def skybrush_bytes(paths: Sequence[VehiclePath], *, error: float = 0.001) -> bytes:
    """Return a show of vehicles.

    Args:
        paths: Paths of the vehicles.
        error: Largest allowed distance of the curves from a path's samples [m].

    Raises:
        ExportError: If the curves are farther away than `error`.
    """
    drones = [
        {
            "type": "generic",
            "settings": {"name": path.name, "trajectory": _trajectory(path, error)},
        }
        for path in paths
    ]
    show = {
        "version": 1,
        "environment": {"type": "outdoor"},
        "swarm": {"drones": drones},
    }
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        entry = zipfile.ZipInfo("show.json", EPOCH)
        entry.compress_type = zipfile.ZIP_DEFLATED
        archive.writestr(entry, json.dumps(show, allow_nan=False))
    return made.getvalue()


def _trajectory(path: VehiclePath, error: float) -> dict[str, object]:
    """Return the points of a trajectory as data."""
    # Rounded places are half a digit off along each axis.
    rounding = 0.5 * 10.0**-DIGITS * np.sqrt(3.0)
    pieces = fitted(path, DEGREE, error - rounding, MOST_PIECES)
    points: list[object] = [[0.0, _rounded(pieces.coefficients[0, 0]), []]]
    every = zip(pieces.knots[1:], pieces.lengths, pieces.coefficients, strict=True)
    for when, length, piece in every:
        _, first, second, end = bezier(piece, length)
        time = round(float(when), 6)
        points.append([time, _rounded(end), [_rounded(first), _rounded(second)]])
    return {"version": 1, "points": points}


def bezier(piece: Array, length: float) -> Array:
    """Return the control points of a cubic polynomial, shape (4, 3).

    Args:
        piece: Coefficients of the polynomial, the constant first, shape (4, 3).
        length: Duration of the piece [s].
    """
    a, b, c, d = piece * length ** np.arange(4.0)[:, None]
    return np.array([a, a + b / 3.0, a + 2.0 * b / 3.0 + c / 3.0, a + b + c + d])


def _rounded(place: Array) -> list[float]:
    return [round(float(number), DIGITS) for number in place]
