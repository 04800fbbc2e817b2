"""Finished steps of an interrupted run, kept in its folder to continue it.

    partial.npz    the finished steps, as in trajectory.npz
    partial.json   their number and the random generator's state; the mark, written last

Each file has a checksum of its content: a file that a disk error or an editor has
changed is refused, and the run is not continued from it.
"""

import contextlib
import hashlib
import json
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.record.files import (
    RecordError,
    read_arrays,
    to_json,
    write_arrays,
    write_text,
)
from swarmstart.cases.record.multiplier_arrays import PREFIX, dual_arrays, with_duals
from swarmstart.cases.record.trajectory_arrays import steps_of, trajectory_arrays
from swarmstart.ocp import Step, Trajectory

MARK, ARRAYS = "partial.json", "partial.npz"
NOTHING: Mapping[str, NDArray[Any]] = MappingProxyType({})
# What JSON, NumPy, zipfile and the conversions raise for a damaged file.
UNREADABLE = (
    *(OSError, LookupError, TypeError, ValueError, AttributeError, EOFError),
    *(
        ZeroDivisionError,
        BadZipFile,
        NotImplementedError,
        zlib.error,
        struct.error,
        SyntaxError,
    ),
)


def save_partial(
    folder: Path,
    key: str,
    trajectory: Trajectory,
    rng_state: Mapping[str, Any],
    multipliers: Mapping[str, NDArray[Any]] = NOTHING,
) -> None:
    """Keep the finished steps of an interrupted run, to continue it.

    Args:
        folder: The run's folder.
        key: The run's key.
        trajectory: The finished steps.
        rng_state: State of the generator after them, `rng.bit_generator.state`.
        multipliers: Multipliers of the first plan, which the steps do not contain.
    """
    arrays: dict[str, NDArray[Any]] = trajectory_arrays(trajectory)
    arrays |= multipliers
    arrays |= dual_arrays(trajectory, _finished(folder, key))
    arrays["key"] = np.array(key)
    checksum = np.array(_checksum_of_arrays(arrays))
    write_arrays(folder / ARRAYS, {**arrays, "checksum": checksum})
    mark = {
        "schema": 1,
        "key": key,
        "steps": len(trajectory.decisions),
        "rng": rng_state,
    }
    # Last: it says that the arrays are complete.
    write_text(folder / MARK, _with_checksum(mark))


def _finished(folder: Path, key: str) -> int:
    """Return the number of steps that the mark names, after which a run continues."""
    with contextlib.suppress(*UNREADABLE):
        mark = _mark(folder)
        return int(mark["steps"]) if mark["key"] == key else 0
    return 0


def remove_partial(folder: Path) -> None:
    """Remove the files of `save_partial`, the mark first."""
    for name in (MARK, ARRAYS):
        (folder / name).unlink(missing_ok=True)


def partial_key(folder: Path) -> str | None:
    """Return the key of the run whose steps are in a folder; None if there are none.

    Raises:
        RecordError: If finished steps exist, but cannot be read.
    """
    try:
        if (folder / MARK).exists():
            return str(_mark(folder)["key"])
        if (folder / ARRAYS).exists():  # Killed before the first mark.
            return str(_arrays(folder)["key"])
    except UNREADABLE as error:
        raise _broken(folder, error) from error
    return None


def load_partial(
    folder: Path, key: str, substeps: int
) -> tuple[list[Step], Any, dict[str, NDArray[Any]]] | None:
    """Return the finished steps of an interrupted run, with the generator's state.

    Args:
        folder: The run's folder.
        key: The run's key; steps of another run are not used.
        substeps: Steps of the plant in a control interval.

    Returns:
        Steps, the generator's state, and the multipliers of the first plan; None if
        there are no finished steps.

    Raises:
        RecordError: If finished steps exist, but cannot be read.
    """
    if not (folder / MARK).exists():
        return None
    try:
        mark = _mark(folder)
        if mark["key"] != key:
            return None
        arrays = _arrays(folder)
        # Another run wrote its arrays and was killed before its mark.
        if str(arrays["key"]) != key:
            return None
        # The arrays can have more steps than the mark, which is written after them.
        steps = with_duals(steps_of(arrays, substeps)[: mark["steps"]], arrays)
        if len(steps) != mark["steps"]:
            raise ValueError(f"{len(steps)} of {mark['steps']} steps")
    except UNREADABLE as error:
        raise _broken(folder, error) from error
    kept = {name: one for name, one in arrays.items() if name.startswith(PREFIX)}
    return steps, mark["rng"], kept


def _mark(folder: Path) -> Mapping[str, Any]:
    text = (folder / MARK).read_text(encoding="utf-8")
    kept = json.loads(text)
    kept.pop("checksum")
    # The whole text, so that a changed layout is noticed, too.
    if text != _with_checksum(kept):
        raise ValueError("a wrong checksum")
    return dict(kept)


def _with_checksum(mark: Mapping[str, Any]) -> str:
    checksum = hashlib.sha256(to_json(mark).encode()).hexdigest()
    return to_json({**mark, "checksum": checksum}, indent=2) + "\n"


def _arrays(folder: Path) -> dict[str, NDArray[Any]]:
    arrays = read_arrays(folder / ARRAYS)
    if str(arrays.pop("checksum")) != _checksum_of_arrays(arrays):
        raise ValueError("a wrong checksum")
    return arrays


def _checksum_of_arrays(arrays: Mapping[str, NDArray[Any]]) -> str:
    digest = hashlib.sha256()
    for name, values in sorted(arrays.items()):
        # The same bytes in another shape or type are other values.
        digest.update(f"{name} {values.dtype.str} {values.shape} ".encode())
        digest.update(values.tobytes())
    return digest.hexdigest()


def _broken(folder: Path, error: Exception) -> RecordError:
    return RecordError(
        f"{folder / MARK}: expected what an interrupted run had finished, found: "
        f"{error}; remove {MARK} and {ARRAYS} there to start again"
    )
