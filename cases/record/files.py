"""Files written whole or not at all, in folders that one command at a time writes to.

A file is written under a temporary name, synced and renamed. A signal waits until that
is done; what a kill leaves under a temporary name is removed by the next command that
writes to the folder.
"""

import contextlib
import errno
import io
import json
import math
import os
import re
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from swarmstart.errors import SwarmstartError
from swarmstart.heuristics.interrupts import put_off

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

PATIENCE_S = 3.0
"""How long to wait for a folder: workers of a killed command need a moment to end."""
POLL_S = 0.05
ROOM = 4096
"""Bytes that a folder must have room for before any work is done [B]."""
_TEMPORARY = re.compile(
    r"\.[^.].*\.(csv|gif|html|json|mp4|npz|parquet|png|py|yaml)\.[0-9]+\.tmp(\.gif|\.mp4)?"
)


class RecordError(SwarmstartError):
    """A file of a record could not be written or read."""


class ForeignFileError(SwarmstartError):
    """A file to be written exists already, and this package has not written it."""


class FolderInUseError(RecordError):
    """Another command writes to the folder."""


@contextlib.contextmanager
def replacing(path: Path, *, suffix: str = "") -> Iterator[Path]:
    """Yield a temporary name; the file of that name takes the place of another.

    Args:
        path: The file to be replaced; its folder is made if it is missing.
        suffix: What the temporary name must end in.

    Raises:
        RecordError: If the file cannot be written; the old one is left.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp{suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield temporary
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise RecordError(f"{path}: expected a file to write to: {said(error)}") from (
            error
        )


def write_atomically(
    path: Path, write: Callable[[BinaryIO], object], *, sync: bool = True
) -> None:
    """Write a file under a temporary name, sync it and rename it.

    Args:
        path: The file; its folder is made if it is missing.
        write: Writes the content.
        sync: Whether it is on the disk before it has its name. Without, a crash of the
            machine (not of the program) may leave an empty or a broken file.

    Raises:
        RecordError: If the file cannot be written; the old one is left.
    """
    with put_off(), replacing(path) as temporary, temporary.open("wb") as file:
        write(file)
        file.flush()
        if sync:
            os.fsync(file.fileno())


def write_text(path: Path, text: str, *, sync: bool = True) -> None:
    """Write a text file atomically, in UTF-8; see `write_atomically`."""
    write_atomically(path, lambda file: file.write(text.encode("utf-8")), sync=sync)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file atomically; what is not finite becomes null."""
    write_text(path, to_json(content, indent=2) + "\n")


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write an .npz file atomically."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    write_atomically(path, lambda file: file.write(buffer.getvalue()))


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of an .npz file; nothing is unpickled.

    The file is closed however that ends, which np.load alone does not see to.
    """
    with path.open("rb") as file, np.load(file, allow_pickle=False) as opened:
        return dict(opened)


def to_json(content: Any, *, indent: int | None = None) -> str:
    """Return JSON text; NaN and infinities become null."""
    return json.dumps(_without_nan(content), indent=indent, allow_nan=False)


def _without_nan(content: Any) -> Any:
    if isinstance(content, float) and not math.isfinite(content):
        return None
    if isinstance(content, Mapping):
        return {key: _without_nan(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_without_nan(value) for value in content]
    return content


def require_ours(path: Path, is_ours: Callable[[str], bool], what: str) -> None:
    """Refuse to replace a file that another program has written.

    Args:
        path: The file; it need not exist.
        is_ours: Text -> whether this package has written it.
        what: What it should be, for the message.

    Raises:
        ForeignFileError: If it is another one.
        RecordError: If it cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return
    except UnicodeDecodeError:
        text = ""
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise RecordError(f"{path}: expected {what}: {said(error)}") from error
    if not is_ours(text):
        raise ForeignFileError(
            f"{path}: expected {what}, found another file; choose another --out"
        )


def is_record(text: str, name: str) -> bool:
    """Return whether a text is the JSON of a record of that name."""
    try:
        return bool(json.loads(text)["record"] == name)
    except (ValueError, LookupError, TypeError):
        return False


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make a folder, and keep other commands out of it while in the context.

    The lock is one of the system on the folder itself (flock): it ends with the
    process, however that ends, and leaves no file. On systems and file systems that
    have none, nothing is kept out.

    Args:
        folder: Where files are to be written; what a killed command left there under
            temporary names is removed.

    Raises:
        FolderInUseError: If another command does not leave it within PATIENCE_S.
        RecordError: If no file can be written there.
    """
    descriptor = None
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            descriptor = _lock(folder)
            with tempfile.TemporaryFile(dir=folder) as file:
                file.write(bytes(ROOM))
        except (OSError, ValueError) as error:  # ValueError: a NUL in the name
            raise RecordError(
                f"{folder}: expected a folder to write files to: {said(error)}"
            ) from error
        remove_rests(folder)
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _lock(folder: Path) -> int | None:
    """Return what holds the lock until it is closed; None on a system without one."""
    if fcntl is None:
        return None
    descriptor = os.open(folder, os.O_RDONLY)
    began = time.monotonic()
    try:
        while not _is_locked_now(descriptor):
            if time.monotonic() - began > PATIENCE_S:
                raise FolderInUseError(
                    f"{folder}: another command is writing to this folder; wait for "
                    "it, or choose another --out"
                )
            time.sleep(POLL_S)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def _is_locked_now(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:  # Another error: a file system without locks.
        return error.errno != errno.EWOULDBLOCK
    return True


def remove_rests(folder: Path) -> None:
    """Remove what killed commands left under temporary names, figures included."""
    for place in (folder, folder / "figures"):
        with contextlib.suppress(OSError):
            for file in place.iterdir():
                if is_temporary(file.name):
                    file.unlink(missing_ok=True)


def is_temporary(name: str) -> bool:
    """Return whether a file's name is one that `replacing` gives."""
    return _TEMPORARY.fullmatch(name) is not None


def said(error: Exception) -> str:
    """Return what the system says of an error."""
    return getattr(error, "strerror", None) or str(error)
