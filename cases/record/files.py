"""Files written whole or not at all, in folders that one command at a time writes to.

A file is written under a temporary name, synced and renamed. A signal waits until that
is done. Temporary files of a killed command are removed by the next command that writes
to the folder.
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
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from swarmstart.errors import SwarmstartError
from swarmstart.heuristics.running import put_off

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

PATIENCE_S = 3.0
"""Time to wait for a folder: workers of a killed command need a moment to end [s]."""
POLL_S = 0.05
ROOM = 4096
"""Free space that a folder needs before any work is done [B]."""
# As `replacing` names them. Writers of animations know the format by the ending,
# which follows therefore after .tmp.
_TEMPORARY = re.compile(
    r"\.[^.].*\.(csv|gif|html|json|mp4|npz|parquet|png|py|yaml)\.[0-9]+\.tmp(\.gif|\.mp4)?"
)


class RecordError(SwarmstartError):
    """A file of a record could not be written or read."""


class ForeignFileError(SwarmstartError):
    """A file to be written exists already and is not from this package."""


class FolderInUseError(RecordError):
    """Another command writes to the folder."""


@contextlib.contextmanager
def replacing(path: Path, *, suffix: str = "") -> Iterator[Path]:
    """Yield the name of a temporary file to be written, which then replaces `path`.

    Args:
        path: The file to be replaced; its folder is made if it is missing.
        suffix: Text in which the temporary name must end.

    Raises:
        RecordError: If the file cannot be written; the old one is left.
    """
    # In the same folder, since a file is renamed in one step only within one disk.
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
        write: Function that writes the content.
        sync: Whether the content reaches the disk before the file is renamed. Without
            it a crash of the machine (not of the program) can leave an empty or broken
            file.

    Raises:
        RecordError: If the file cannot be written; the old one is left.
    """
    with put_off(), replacing(path) as temporary, temporary.open("wb") as file:
        write(file)
        # fsync concerns what the system has, not Python's buffer.
        file.flush()
        if sync:
            os.fsync(file.fileno())


def write_text(path: Path, text: str, *, sync: bool = True) -> None:
    """Write a text file atomically, in UTF-8; see `write_atomically`."""
    write_bytes(path, text.encode("utf-8"), sync=sync)


def write_bytes(path: Path, content: bytes, *, sync: bool = True) -> None:
    """Write bytes atomically; see `write_atomically`."""
    write_atomically(path, lambda file: file.write(content), sync=sync)


class ExistingFileError(RecordError):
    """A file exists already and would be replaced."""


def require_new(files: Iterable[Path], way: str) -> None:
    """Raise if a file exists, also as a link whose target is missing.

    Args:
        files: The files.
        way: Advice on what to do instead, as the end of the message.

    Raises:
        ExistingFileError: If one of the files exists.
    """
    for file in files:
        # exists() is false for a link whose target is missing.
        if file.exists() or file.is_symlink():
            raise ExistingFileError(f"{file}: expected a new file, found one; {way}")


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file atomically; numbers that are not finite become null."""
    write_text(path, to_json(content, indent=2) + "\n")


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write an .npz file atomically."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    write_atomically(path, lambda file: file.write(buffer.getvalue()))


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of an .npz file; nothing is unpickled.

    The file is closed even after an error, which np.load does not ensure.

    Raises:
        ValueError: If the file claims to have more numbers than its size allows.
    """
    with path.open("rb") as file, zipfile.ZipFile(file) as members:
        claimed = sum(_claimed(members, name) for name in members.namelist())
        room = path.stat().st_size  # Records are not compressed.
        if claimed > room:
            raise ValueError(f"arrays of {claimed:,} bytes in a file of {room:,} bytes")
        file.seek(0)
        with np.load(file, allow_pickle=False) as opened:
            return dict(opened)


def _claimed(members: zipfile.ZipFile, name: str) -> int:
    """Return the bytes of an array, from its header: NumPy would allocate them."""
    with members.open(name) as member:
        version = np.lib.format.read_magic(member)
        read = (
            np.lib.format.read_array_header_1_0
            if version == (1, 0)
            else np.lib.format.read_array_header_2_0
        )
        shape, _, dtype = read(member)
        return math.prod(shape) * int(dtype.itemsize)


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
        is_ours: Function of the text that returns whether this package has written it.
        what: Expected content of the file, for the message.

    Raises:
        ForeignFileError: If another program has written the file.
        RecordError: If the file cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return
    except UnicodeDecodeError:
        # No text, so not written by this package.
        text = ""
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise RecordError(f"{path}: expected {what}: {said(error)}") from error
    if not is_ours(text):
        raise ForeignFileError(
            f"{path}: expected {what}, found another file; choose another --out"
        )


def is_record(text: str, name: str) -> bool:
    """Return whether a text is the JSON of a record with that name."""
    try:
        return bool(json.loads(text)["record"] == name)
    except (ValueError, LookupError, TypeError):
        return False


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make a folder, and keep other commands out of it while in the context.

    The lock is one of the system on the folder itself (flock): it ends with the process
    and leaves no file. On systems and file systems without such locks, other commands
    are not kept out. Temporary files of killed commands are removed.

    Raises:
        FolderInUseError: If another command still uses the folder after PATIENCE_S.
        RecordError: If no file can be written to the folder.
    """
    descriptor = None
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            descriptor = _lock(folder)
            with tempfile.TemporaryFile(dir=folder) as file:
                # An empty file fits on a full disk: only a write shows the room.
                file.write(bytes(ROOM))
        except (OSError, ValueError) as error:  # ValueError: a NUL in the name
            raise RecordError(
                f"{folder}: expected a folder to write files to: {said(error)}"
            ) from error
        remove_rests(folder)
        yield
    finally:
        if descriptor is not None:
            # This releases the lock.
            os.close(descriptor)


def _lock(folder: Path) -> int | None:
    """Return the descriptor that holds the lock; None on a system without locks."""
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
        # Also on Ctrl-C while waiting, which must leave no descriptor open.
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
    """Remove temporary files of killed commands, also those of figures."""
    for place in (folder, folder / "figures"):
        with contextlib.suppress(OSError):
            for file in place.iterdir():
                if is_temporary(file.name):
                    file.unlink(missing_ok=True)


def is_temporary(name: str) -> bool:
    """Return whether a file's name is a temporary one of `replacing`."""
    return _TEMPORARY.fullmatch(name) is not None


def said(error: Exception) -> str:
    """Return the message that the system gives for an error."""
    return getattr(error, "strerror", None) or str(error)
