"""Content of an FMU, read without running any of its code."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.errors import brief, load_optional
from swarmstart.simulators.common import SimulatorError, require_known

MOST_BYTES = 2**30
"""Largest size of an FMU's files together [bytes]."""
_REALS = ("Real", "Float64")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Described:
    """Facts that an FMU states of itself.

    Attributes:
        file: Path of the FMU.
        version: "2.0" or "3.0".
        identifier: Name of the FMU's library.
        token: Identifier (GUID) that the library compares when it is loaded.
        can_restore: True if the FMU's state can be saved and restored.
        variables: Name of each variable that is a scalar of 64 bits -> its description
            by FMPy.
    """

    file: Path
    version: str
    identifier: str
    token: str
    can_restore: bool
    variables: Mapping[str, Any]

    def references(self, names: Sequence[str]) -> list[int]:
        """Return the value references of variables."""
        return [int(self.variables[name].valueReference) for name in names]

    def units(self, names: Sequence[str]) -> dict[str, str]:
        """Return the unit of each variable that has one."""
        found = {}
        for name in names:
            one = self.variables[name]
            unit = one.unit or getattr(one.declaredType, "unit", None)
            if unit:
                found[name] = str(unit)
        return found

    def bounds(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Return the least and the largest values of variables; infinite if missing."""
        chosen = [self.variables[name] for name in names]
        least = [float(-np.inf if one.min is None else one.min) for one in chosen]
        most = [float(np.inf if one.max is None else one.max) for one in chosen]
        return np.array(least), np.array(most)

    def can_be_set(self, name: str) -> bool:
        """Return whether a variable can be set before a run begins."""
        one = self.variables[name]
        begins = one.initial in ("exact", "approx")
        is_given = one.causality in ("input", "parameter")
        return one.variability != "constant" and (begins or is_given)


def described(file: Path) -> Described:
    """Return what an FMU says of itself.

    Raises:
        SimulatorError: If the file is no FMU that this machine can run in
            co-simulation.
        MissingPackageError: If FMPy is not installed.
    """
    fmpy = load_optional("fmpy", extra="fmi", need="an FMU")
    names = _names_in(file)
    try:
        with file.open("rb") as content:  # FMPy would leave it open after an error.
            found = fmpy.read_model_description(content)
    except Exception as error:
        raise SimulatorError(
            str(file), f"expected a valid modelDescription.xml; {brief(str(error))}"
        ) from error
    version = str(found.fmiVersion)
    if not version.startswith(("2.", "3.")):
        raise SimulatorError(str(file), f"expected FMI 2.0 or 3.0, found {version}")
    one = found.coSimulation
    if one is None:
        raise SimulatorError(
            str(file),
            "expected an FMU for co-simulation, found one for model exchange only, "
            "which has no integrator: export it for co-simulation",
        )
    identifier = str(one.modelIdentifier)
    if not re.fullmatch(r"[A-Za-z_]\w*", identifier):
        raise SimulatorError(
            str(file), f"expected a C identifier as model, found {brief(identifier)}"
        )
    _require_library(fmpy, file, version, identifier, names)
    return Described(
        file=file, version=version[:3], identifier=identifier,
        token=str(found.guid or found.instantiationToken),
        can_restore=bool(
            getattr(one, "canGetAndSetFMUstate", False)
            or getattr(one, "canGetAndSetFMUState", False)
        ),
        variables={
            one.name: one
            for one in found.modelVariables
            if one.type in _REALS and not one.dimensions
        },
    )  # fmt: skip


def require_variables(
    found: Described, role: str, names: Sequence[str], causality: str = ""
) -> None:
    """Raise unless an FMU has all named variables, each with the expected causality.

    Args:
        found: Facts about the FMU.
        role: Role of the variables, for the message, such as "states".
        names: Names of the variables.
        causality: Expected causality, such as "input"; if empty, any.

    Raises:
        SimulatorError: If there are no names (unless they are parameters), a name is
            given twice, or a variable is missing or has another causality.
    """
    if not len(names) and role != "parameters":
        raise SimulatorError(str(found.file), f"expected some {role}, found no name")
    known = [
        name
        for name, one in found.variables.items()
        if not causality or one.causality == causality
    ]
    kind = f"{causality}s" if causality else "numbers"
    require_known(str(found.file), f"{role} among the {kind}", names, known)
    if len(set(names)) < len(names):
        raise SimulatorError(str(found.file), f"expected each of the {role} once")


def _names_in(file: Path) -> list[str]:
    """Return the names of the files in an archive, none of which may leave it."""
    try:
        with zipfile.ZipFile(file) as archive:
            entries = archive.infolist()
    except FileNotFoundError as error:
        raise SimulatorError(str(file), "expected an FMU, found no file") from error
    except (OSError, zipfile.BadZipFile) as error:
        raise SimulatorError(
            str(file), f"expected an FMU, which is a ZIP archive; {error}"
        ) from error
    for entry in entries:
        name = entry.filename
        parts = PurePosixPath(name.replace("\\", "/"))
        if parts.is_absolute() or ".." in parts.parts or ":" in name or "\\" in name:
            raise SimulatorError(
                str(file), f"expected names within the archive, found {brief(name)}"
            )
    size = sum(entry.file_size for entry in entries)
    if size > MOST_BYTES:
        raise SimulatorError(
            str(file), f"expected at most {MOST_BYTES:,} bytes unpacked, found {size:,}"
        )
    return [entry.filename for entry in entries]


def _require_library(
    fmpy: Any, file: Path, version: str, identifier: str, names: list[str]
) -> None:
    """Raise if an FMU has no library for this machine."""
    here = fmpy.platform if version.startswith("2.") else fmpy.platform_tuple
    wanted = f"binaries/{here}/{identifier}{fmpy.sharedLibraryExtension}"
    if wanted in names:
        return
    parts = [name.split("/") for name in names]
    others = {one[1] for one in parts if one[0] == "binaries" and len(one) > 2}  # noqa: PLR2004 - with a file
    if not others and any(one[0] == "sources" for one in parts):
        others = {"sources only"}
    raise SimulatorError(
        str(file),
        f"expected a library for this machine, {wanted}; found "
        f"{', '.join(sorted(others)) or 'none'}",
    )
