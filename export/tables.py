"""Paths as CSV with units."""

from __future__ import annotations

from swarmstart.export.paths import VehiclePath


def table_text(path: VehiclePath) -> str:
    """Return times and positions of a vehicle as CSV, all digits kept."""
    lines = ["time_s,x_m,y_m,z_m"]
    for time, place in zip(path.times.tolist(), path.positions.tolist(), strict=True):
        lines.append(",".join(map(repr, (time, *place))))
    return "\n".join(lines) + "\n"
