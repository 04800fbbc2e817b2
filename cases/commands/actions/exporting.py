"""`swarmstart export`: flights as files of other programs, controllers as C."""

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path

from swarmstart.cases.commands.terminal import DONE, answer
from swarmstart.cases.format.document import printable
from swarmstart.cases.record.files import require_new, write_bytes
from swarmstart.cases.record.results import load
from swarmstart.cases.record.vehicle_paths import paths_of
from swarmstart.errors import SwarmstartError
from swarmstart.export import (
    Origin,
    VehiclePath,
    crazyswarm_text,
    mcap_bytes,
    plan_text,
    skybrush_bytes,
    table_text,
    waypoints_text,
)

Written = Mapping[str, bytes]
"""Name of a file -> its content."""
ERRORS = {"crazyswarm": 0.005, "skybrush": 0.001, "qgc": 0.1, "wpl": 0.1}
"""Largest error of each format by default [m]."""


_EAST = 90.0
"""Direction of the x axis by default [deg]."""


class WrongExportError(SwarmstartError, ValueError):
    """Options of the export do not fit a format or a record."""


def export_command(options: argparse.Namespace) -> int:
    """Write the files, and print their paths; return the exit code.

    Raises:
        WrongExportError: If the options do not fit the format or the record.
        RecordError: If the record cannot be read, or a file exists or cannot be
            written.
        ExportError: If a path or a controller cannot be written as asked.
    """
    _require_own(options)
    if options.what == "trajectory":
        options.format = options.format or "csv"
        folder, files = _of_trajectory(options)
    else:
        # CasADi and its neighbours are slow to import.
        from swarmstart.cases.commands.actions.exporting_code import c_files

        folder, files = c_files(options)
    chosen = {folder / name: content for name, content in files.items()}
    require_new(chosen, "choose another --out")
    for file, content in chosen.items():
        write_bytes(file, content)
    answer("\n".join(f"file  {printable(str(file))}" for file in chosen))
    return DONE


_OF_CODE = (
    "variant", "assignments", "name", "starts", "iterations", "precision", "seed",
)  # fmt: skip
OWN = {
    "trajectory": (
        "format", "positions", "height", "error", "max_speed", "max_acceleration",
        "origin", "heading",
    ),
    "c": (*_OF_CODE, "main"),
    "fmu": (*_OF_CODE, "fmi"),
}  # fmt: skip
"""Word for an export -> the options that it has, besides those of all."""
_FORMATS_OF = {
    "max_speed": ("crazyswarm",), "max_acceleration": ("crazyswarm",),
    "error": tuple(ERRORS), "origin": ("qgc", "wpl"), "heading": ("qgc", "wpl"),
}  # fmt: skip
"""Option of a trajectory -> the formats that use it, if others do not."""
FLAGS = {"assignments": "set"}
"""Name of an option in the code -> its name for users, if that is another."""


def _require_own(options: argparse.Namespace) -> None:
    """Raise if an option is given that belongs to another export."""
    for what, names in OWN.items():
        for name in names:
            is_given = getattr(options, name) not in (None, False, [])
            if is_given and name not in OWN[options.what]:
                flag = FLAGS.get(name, name).replace("_", "-")
                raise WrongExportError(
                    f"--{flag}: expected export {what} with it, found export "
                    f"{options.what}"
                )


def _of_trajectory(options: argparse.Namespace) -> tuple[Path, Written]:
    """Return the folder and the files of a flight."""
    for name, formats in _FORMATS_OF.items():
        if getattr(options, name) is not None and options.format not in formats:
            raise WrongExportError(
                f"--{name.replace('_', '-')}: expected --format "
                f"{' or '.join(formats)} with it, found {options.format}"
            )
    folder = Path(options.out or Path(options.source) / "export")
    return folder, FORMATS[options.format](chosen_paths(options), options)


def chosen_paths(options: argparse.Namespace) -> list[VehiclePath]:
    """Return the paths of the vehicles that are asked for."""
    names = [name for name in (options.positions or "").split(",") if name]
    if options.positions is not None and len(names) not in (2, 3):
        raise WrongExportError(
            f"--positions: expected two or three names, such as x,y,z; found "
            f"{options.positions!r}"
        )
    height = options.height or 0.0
    paths = paths_of(load(options.source), names, height=height)
    known = [path.name for path in paths]
    for name in options.vehicle:
        if name not in known:
            raise WrongExportError(
                f"--vehicle: expected one of {', '.join(known)}, found {name!r}"
            )
    wanted = options.vehicle or known
    return [path for path in paths if path.name in wanted]


def _error(options: argparse.Namespace) -> float:
    found = ERRORS[options.format] if options.error is None else options.error
    return float(found)


def _crazyswarm(paths: list[VehiclePath], options: argparse.Namespace) -> Written:
    limits = {"speed": options.max_speed, "acceleration": options.max_acceleration}
    given = {name: most for name, most in limits.items() if most is not None}
    return {
        f"{path.name}.csv": crazyswarm_text(
            path, error=_error(options), **given
        ).encode()
        for path in paths
    }


def _skybrush(paths: list[VehiclePath], options: argparse.Namespace) -> Written:
    return {"show.skyc": skybrush_bytes(paths, error=_error(options))}


def _bag(paths: list[VehiclePath], options: argparse.Namespace) -> Written:
    del options
    return {"flight.mcap": mcap_bytes(paths)}


def _plans(paths: list[VehiclePath], options: argparse.Namespace) -> Written:
    at, error = _origin(options), _error(options)
    return {f"{p.name}.plan": plan_text(p, at, error=error).encode() for p in paths}


def _waypoints(paths: list[VehiclePath], options: argparse.Namespace) -> Written:
    at, error = _origin(options), _error(options)
    return {
        f"{path.name}.waypoints": waypoints_text(path, at, error=error).encode()
        for path in paths
    }


def _tables(paths: list[VehiclePath], options: argparse.Namespace) -> Written:
    del options
    return {f"{path.name}.csv": table_text(path).encode() for path in paths}


def _origin(options: argparse.Namespace) -> Origin:
    """Return the place of the frame on the earth."""
    try:
        numbers = [float(word) for word in (options.origin or "").split(",")]
        latitude, longitude, altitude = numbers
    except ValueError:
        raise WrongExportError(
            "--origin: expected LATITUDE,LONGITUDE,ALTITUDE in degrees and metres, "
            f"which the format {options.format} needs; found {options.origin}"
        ) from None
    return Origin(
        latitude=latitude, longitude=longitude, altitude=altitude,
        heading=_EAST if options.heading is None else options.heading,
    )  # fmt: skip


FORMATS: dict[str, Callable[[list[VehiclePath], argparse.Namespace], Written]] = {
    "crazyswarm": _crazyswarm,
    "skybrush": _skybrush,
    "mcap": _bag,
    "qgc": _plans,
    "wpl": _waypoints,
    "csv": _tables,
}
