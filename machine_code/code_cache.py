"""Disk cache of machine code; loads only what the current user alone can write.

It keeps the evaluators of `ocp.compiled` and the kernels that the decorator `kernel`
compiles, under keys of everything that they are made from, so that no entry is ever out
of date.

Machine code written by another user must never be loaded. So the folder must be a real
folder that the user owns, with mode 0700, and a file a real file that the user owns and
no other user may write; anything else is refused. A file begins with the hash of its
key and code; a file that is damaged, or has another key, is rebuilt. Files are replaced
atomically, so processes that write at the same time do no harm. If nothing can be
stored (an unwritable or missing home folder), each process builds its code anew.

The files used least recently are removed when all of them together exceed LIMIT_BYTES.
"""

import contextlib
import hashlib
import os
import stat
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

LIMIT_BYTES = 256 * 2**20
"""Size of the cache above which files are removed."""
KEPT_PART = 0.75
"""Fraction of the limit to which the cache shrinks, so that this happens rarely."""
USE_NOTED_S = 3600.0
"""Least age of a file's time stamp at which a use renews it [s]."""

_TEMPORARY = ".new-"
_ABANDONED_S = 3600.0
"""Age at which a temporary file counts as left by a killed process [s]."""
_DIGEST_BYTES = hashlib.sha256().digest_size
_PRIVATE, _PRIVATE_FILE = 0o700, 0o600
_OTHERS_MAY_WRITE = 0 if os.name == "nt" else 0o022


@dataclass(frozen=True, kw_only=True, slots=True)
class Usage:
    """The state of the cache.

    Attributes:
        folder: Folder of the cache, whether it exists or not.
        files: Number of files in it.
        bytes: Total size of the files.
        refused: Reason why the folder is not used; None if it is usable.
    """

    folder: Path
    files: int
    bytes: int
    refused: str | None


def folder() -> Path:
    """Return the folder of the cache, whether it exists or not."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    if not os.path.isabs(base):  # To be ignored, says the XDG specification.
        base = os.path.expanduser("~/.cache")
    return Path(base, "swarmstart", "machine-code")


def load_code(key: str) -> bytes | None:
    """Return the code kept under a key; None if it is missing or not trusted.

    Args:
        key: Hexadecimal digits.
    """
    where = folder()
    if not _is_private(where):
        return None
    try:
        with open(where / key, "rb", opener=_open_own) as file:
            content = file.read()
            _note_use(file.fileno())
    except OSError:
        return None
    digest, code = content[:_DIGEST_BYTES], content[_DIGEST_BYTES:]
    return code if digest == _digest(key, code) else None


def store_code(key: str, code: bytes) -> None:
    """Store code under a key if the folder is safe; else do nothing.

    Args:
        key: Hexadecimal digits.
        code: The machine code.
    """
    where = folder()
    if not where.is_absolute():
        return
    with contextlib.suppress(OSError):
        _make_private(where)
        if _is_private(where):
            _replace(where / key, _digest(key, code) + code)
            _make_room(where)


def cache_refusal() -> str | None:
    """Return the reason why the cache's folder is not used; None if it is usable."""
    where = folder()
    if not where.is_absolute():
        return "the user has no home folder"
    if not os.path.lexists(where):
        return None if _can_be_made(where) else "it cannot be created"
    own = "it must be a folder of the user's own with mode 0700"
    return None if _is_private(where) else own


def cache_usage() -> Usage:
    """Return the folder, the number of files and the size of the cache."""
    where, refused = folder(), cache_refusal()
    kept = [] if refused else _files(where)
    return Usage(
        folder=where,
        files=len(kept),
        bytes=sum(status.st_size for _, status in kept),
        refused=refused,
    )


def clear_cache() -> int:
    """Remove all files of the cache, unless its folder is refused.

    Running processes keep the code that they have loaded.

    Returns:
        The number of files removed.

    Raises:
        OSError: If a file cannot be removed.
    """
    where = folder()
    if not _is_private(where):
        return 0
    files = _files(where)
    for path, _ in files:
        path.unlink(missing_ok=True)
    return len(files)


def _make_private(where: Path) -> None:
    """Create a folder and its parents for the user alone, whatever the umask."""
    missing = [p for p in (where, *where.parents) if not os.path.lexists(p)]
    for path in reversed(missing):
        with contextlib.suppress(FileExistsError):  # Another process was faster.
            path.mkdir(mode=_PRIVATE)
            path.chmod(_PRIVATE)  # The umask may have taken the owner's own bits.


def _can_be_made(where: Path) -> bool:
    """Return whether the nearest existing parent is a folder that can be written."""
    nearest = next(p for p in where.parents if os.path.lexists(p))
    return nearest.is_dir() and os.access(nearest, os.W_OK | os.X_OK)


def _replace(path: Path, content: bytes) -> None:
    """Write a file atomically, leaving no temporary file."""
    descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=_TEMPORARY)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
        os.chmod(temporary, _PRIVATE_FILE)
        os.replace(temporary, path)
    finally:
        Path(temporary).unlink(missing_ok=True)  # It is missing once it is renamed.


def _make_room(where: Path) -> None:
    """Remove files of killed processes; if too large, also the least used ones."""
    files, now = _files(where), time.time()
    for path, status in files:
        is_left = path.name.startswith(_TEMPORARY)
        if is_left and now - status.st_mtime > _ABANDONED_S:
            path.unlink(missing_ok=True)
    size = sum(status.st_size for _, status in files)
    if size <= LIMIT_BYTES:
        return
    for path, status in sorted(files, key=lambda file: file[1].st_mtime):
        if size <= KEPT_PART * LIMIT_BYTES:
            return
        path.unlink(missing_ok=True)
        size -= status.st_size


def _files(where: Path) -> list[tuple[Path, os.stat_result]]:
    """Return the files of a folder, skipping those that are removed meanwhile."""
    found = []
    with contextlib.suppress(OSError), os.scandir(where) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):
                status = entry.stat(follow_symlinks=False)
                if not stat.S_ISDIR(status.st_mode):
                    found.append((Path(entry.path), status))
    return found


def _note_use(descriptor: int) -> None:
    """Renew the time stamp of a used file, unless it is recent."""
    if time.time() - os.fstat(descriptor).st_mtime > USE_NOTED_S:
        with contextlib.suppress(OSError):
            os.utime(descriptor)


def _open_own(path: str, flags: int) -> int:
    """Open a file that the user owns and no other user may write."""
    # A link is refused, and a pipe must not block before its type is known.
    flags |= getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    descriptor = os.open(path, flags)
    status = os.fstat(descriptor)
    mode = stat.S_IMODE(status.st_mode)
    own = stat.S_ISREG(status.st_mode) and _is_mine(status)
    if not own or mode & _OTHERS_MAY_WRITE:
        os.close(descriptor)
        raise PermissionError(f"{path} is not the user's own file")
    return descriptor


def _digest(key: str, code: bytes) -> bytes:
    return hashlib.sha256(key.encode() + code).digest()


def _is_private(where: Path) -> bool:
    """Return whether a folder is real, owned by the user, and closed to others."""
    try:
        status = where.lstat()
    except OSError:
        return False
    # Windows has no such modes.
    private = stat.S_IMODE(status.st_mode) == _PRIVATE or os.name == "nt"
    return stat.S_ISDIR(status.st_mode) and _is_mine(status) and private


def _is_mine(status: os.stat_result) -> bool:
    return not hasattr(os, "geteuid") or status.st_uid == os.geteuid()
