"""Folder of a run on disk, and the check that a folder is that of a run.

    scenario.yaml    the scenario as resolved
    trajectory.npz   the simulated trajectory, see docs/record.md
    steps.csv        time and origin of the plans of each step
    run.json         settings, measures, claims; written last: marks a complete record
    partial.npz, partial.json   finished steps of an interrupted run
    figures/

Every file is written under a temporary name, synced and renamed. The folder's name is a
hash of what determines the result, so that the same command finds the same folder.
Nothing heavy is imported here, since `--version` prints the versions of a record.
"""

import contextlib
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from swarmstart.cases.format.document import shown
from swarmstart.errors import SwarmstartError

SCENARIO, TRAJECTORY, MARK, FIGURES = (
    *("scenario.yaml", "trajectory.npz", "run.json", "figures"),
)
SEEDS, COMPARISON, TABLE, CELLS = (
    *("seeds.json", "comparison.json", "results.csv", "cells"),
)
"""Files of runs over seeds and of comparisons, and the folder of their runs."""
SWEEP = "sweep.json"
"""File that marks a sweep over instances."""
MARKS = (MARK, SEEDS, SWEEP, COMPARISON, "replication.json")
PNG: tuple[str, ...] = ("png",)
FIGURE_FORMATS = ("png", "svg", "pdf")
RECORDED = ("swarmstart", "casadi", "numpy", "numba", "scipy")
"""Packages whose versions can change a result."""
_KEY = re.compile("[0-9a-f]{16}")
_LISTED = 3
"""Largest number of files that a message names."""


class OccupiedFolderError(SwarmstartError):
    """A folder has other content than the record of the run to be written there.

    Attributes:
        folder: The folder.
    """

    def __init__(
        self,
        folder: Path,
        found: str,
        *,
        expected: str = "an empty folder or the record of this run",
        way: str = "choose another --out, or write over it with --force",
    ) -> None:
        """Keep the folder; the message says what was found and what can be done."""
        super().__init__(f"{folder}: expected {expected}, found {found}; {way}")
        self.folder = folder


class UnknownFormatError(SwarmstartError, ValueError):
    """Figures are requested in a format in which they cannot be written."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Recording:
    """A folder for the record of a run, and options of recording.

    Attributes:
        folder: The run's folder; made if it is missing.
        figures: Whether figures are drawn.
        animation: "gif" or "mp4" for an animation beside the figures; None for no
            animation.
        force: Whether files of another run with the record's names are replaced. Other
            files are never touched.
        figure_formats: Formats in which each figure is written, from FIGURE_FORMATS.
    """

    folder: Path
    figures: bool = True
    animation: str | None = None
    force: bool = False
    figure_formats: tuple[str, ...] = PNG

    def __post_init__(self) -> None:
        """Refuse a format in which figures cannot be written."""
        given = self.figure_formats
        if not given or len({*given}) < len(given) or {*given} - {*FIGURE_FORMATS}:
            raise UnknownFormatError(
                f"figure_formats: expected some of {', '.join(FIGURE_FORMATS)}, each "
                f"once, found {', '.join(map(str, given)) or 'an empty list'}"
            )


def package_version(name: str) -> str:
    """Return an installed package's version; "unknown" if it is not installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"


def versions() -> dict[str, str]:
    """Return the versions of packages that are recorded with a run."""
    return {name: package_version(name) for name in RECORDED}


@cache
def environment() -> dict[str, Any]:
    """Return versions of packages and the hash of the code, which determine results."""
    # A change of any module can change a result, so all of them count.
    root = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for folder in ("cases", "ocp", "heuristics", "terminal_set", "machine_code"):
        for file in sorted((root / folder).rglob("*")):
            if file.suffix in (".py", ".yaml"):
                digest.update(file.read_bytes())
    for file in sorted(root.glob("*.py")):
        digest.update(file.read_bytes())
    return {"versions": versions(), "code": digest.hexdigest()}


def run_key(settings: Mapping[str, Any], seed: int, backend: str) -> str:
    """Return the 16 characters that name a run: a hash of all that it depends on."""
    own = {"settings": settings, "seed": seed, "backend": backend}
    return hash_of({**own, **environment()})


def hash_of(data: Mapping[str, Any]) -> str:
    """Return 16 characters that name plain data, whatever the order of its keys."""
    # Sorted and without spaces, so that equal data are one text.
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
    # 64 bits: two of a million cells share a key with a chance of 3e-8.
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def require_own(folder: Path, key: str, scenario: str) -> None:
    """Raise unless a folder is empty or has the record of this run.

    Args:
        folder: The folder; other files beside such a record may stay.
        key: The run's key.
        scenario: The run's resolved scenario, as it is written.

    Raises:
        OccupiedFolderError: If the folder has other content, or a scenario file that
            has been changed.
        RecordError: If an interrupted run has left its finished steps in the folder,
            and they cannot be read.
    """
    # Here, since it imports NumPy, which `--version` does without.
    from swarmstart.cases.record.partial import partial_key

    names = _names(folder)
    if not names:
        return
    keys = {kept for kept in (finished_key(folder), partial_key(folder)) if kept}
    if keys != {key}:
        raise OccupiedFolderError(folder, _content(names, is_record=bool(keys)))
    kept_scenario = folder / SCENARIO
    if kept_scenario.exists() and kept_scenario.read_bytes() != scenario.encode():
        raise OccupiedFolderError(folder, f"a changed {SCENARIO}")


def require_own_seeds(folder: Path, keys: Sequence[str]) -> None:
    """Raise unless a folder is empty or has runs over seeds of the same scenario.

    Args:
        folder: The folder; it need not exist. Other files beside such runs may stay.
        keys: Keys of the runs, that of seed 0 first. The number of runs may have
            changed.

    Raises:
        OccupiedFolderError: If the folder has other content.
    """
    names = _names(folder)
    if not names:
        return
    kept = finished_key(folder, SEEDS)
    if kept is None and {*names} <= {CELLS, FIGURES}:  # Interrupted before the mark.
        cells = _names(folder / CELLS)
        if not cells or {*cells} & {*keys}:
            return
    if kept != keys[0]:
        is_record = any((folder / mark).exists() for mark in MARKS)
        raise OccupiedFolderError(folder, _content(names, is_record=is_record))


def require_own_sweep(folder: Path, key: str) -> None:
    """Raise unless a folder is empty or has the record of this sweep.

    Args:
        folder: The folder; it need not exist. Other files beside the record may stay.
        key: The sweep's key.

    Raises:
        OccupiedFolderError: If the folder has other content.
    """
    names = _names(folder)
    if names and finished_key(folder, SWEEP) != key:
        is_record = any((folder / mark).exists() for mark in MARKS)
        raise OccupiedFolderError(folder, _content(names, is_record=is_record))


def require_comparisons(folder: Path) -> None:
    """Raise unless a folder is empty or has comparisons, of any scenarios.

    Args:
        folder: The folder; it need not exist. Other files beside them may stay.

    Raises:
        OccupiedFolderError: If the folder has other content.
    """
    names = _names(folder)
    is_begun = {*names} <= {CELLS} and all(
        _KEY.fullmatch(name) for name in _names(folder / CELLS)
    )
    if not (is_begun or COMPARISON in names or TABLE in names):
        is_record = any((folder / mark).exists() for mark in MARKS)
        raise OccupiedFolderError(
            folder,
            _content(names, is_record=is_record),
            expected="an empty folder or one of comparisons",
            way="choose another --out",
        )


def _names(folder: Path) -> list[str]:
    """Return the names in a folder, sorted; none if there is no such folder.

    Temporary files are left out.
    """
    # Here, since it imports NumPy, which `--version` does without.
    from swarmstart.cases.record.files import is_temporary

    try:
        return sorted(f.name for f in folder.iterdir() if not is_temporary(f.name))
    # Other paths are refused when a file is written. ValueError: a NUL in the name.
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return []


def _content(names: Sequence[str], *, is_record: bool) -> str:
    """Return in words what a folder has."""
    listed = ", ".join(map(shown, names[:_LISTED]))
    more = ", ..." if len(names) > _LISTED else ""
    whose = "the record of another run" if is_record else "other files"
    return f"{whose} ({listed}{more})"


def withdraw(folder: Path, mark: str = MARK) -> None:
    """Remove the record of another run: its mark, and the files that the mark lists.

    The mark is the file that is written last and makes a record complete. Other files
    stay, since they can be the user's own.
    """
    # Read before the mark is removed, which lists them.
    files = [*_listed(folder, "figures", mark), *_listed(folder, "documents", mark)]
    (folder / mark).unlink(missing_ok=True)
    for file in files:
        with contextlib.suppress(OSError):
            file.unlink()


def kept_figures(folder: Path, key: str) -> list[Path] | None:
    """Return the figures of a finished record; None if the run has no such record."""
    if finished_key(folder) != key:
        return None
    return [file for file in _listed(folder, "figures") if file.exists()]


def _listed(folder: Path, what: str, mark: str = MARK) -> list[Path]:
    """Return the files that a record lists as drawn or written."""
    place = folder / FIGURES if what == "figures" else folder
    try:
        names = json.loads((folder / mark).read_text(encoding="utf-8"))[what]
        # The last part only: a changed record cannot name files of other folders.
        return [place / Path(str(name)).name for name in names]
    except (OSError, ValueError, LookupError, TypeError):
        return []


def finished_key(folder: Path, mark: str = MARK) -> str | None:
    """Return the key of the run whose finished record is in a folder.

    It is "unknown" if the record is damaged, and None if there is no finished record.
    """
    try:
        text = (folder / mark).read_text(encoding="utf-8")
    except OSError:
        return None
    try:
        return str(json.loads(text)["key"])
    except (ValueError, LookupError, TypeError):
        return "unknown"
