"""Disk cache of machine code; loads only what the current user alone can write.

The evaluators of `ocp.compiled` and the kernels of `kernel` are kept here, under keys
that name all they are made from, so nothing in it is ever out of date.

Loading code that somebody else could have written is the risk to close. So the folder
must be a real folder of the user's own with mode 0700, a file a real file of the user's
own that no other may write; anything else is refused. A file begins with the hash of
its key and code; one that is damaged, or another's, is rebuilt. Files are replaced
atomically, so two processes that build at once do no harm; if nothing can be kept
(an unwritable home, or none), code is built anew in each process.

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
"""Part of the limit that is left when files are removed, so that it is done rarely."""
USE_NOTED_S = 3600.0
"""Age of a file's time stamp from which a use renews it [s]."""

_TEMPORARY = ".new-"
_ABANDONED_S = 3600.0
"""Age from which a temporary file is the rest of a process that was killed [s]."""
_DIGEST_BYTES = hashlib.sha256().digest_size
_PRIVATE, _PRIVATE_FILE = 0o700, 0o600
_OTHERS_MAY_WRITE = 0 if os.name == "nt" else 0o022


@dataclass(frozen=True, kw_only=True, slots=True)
class Usage:
    """The state of the cache.

    Attributes:
        folder: Its folder, whether it exists or not.
        files: Number of files in it.
        bytes: Their size.
        refused: See `refusal`.
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


def load(key: str) -> bytes | None:
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


def store(key: str, code: bytes) -> None:
    """Keep code under a key, if that can be done safely; say nothing if not.

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


def refusal() -> str | None:
    """Return why the folder of the cache is not used; None if it is, or can be made."""
    where = folder()
    if not where.is_absolute():
        return "the user has no home folder"
    if not os.path.lexists(where):
        return None if _can_be_made(where) else "it cannot be created"
    own = "it must be a folder of the user's own with mode 0700"
    return None if _is_private(where) else own


def usage() -> Usage:
    """Return where the cache is, and how large."""
    where, refused = folder(), refusal()
    kept = [] if refused else _files(where)
    return Usage(
        folder=where,
        files=len(kept),
        bytes=sum(status.st_size for _, status in kept),
        refused=refused,
    )


def clear() -> int:
    """Remove all files of the cache, and none in a folder that is not used.

    Processes that run keep the code they have loaded.

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
        with contextlib.suppress(FileExistsError):
            path.mkdir(mode=_PRIVATE)
            path.chmod(_PRIVATE)  # The umask may have taken the owner's own bits.


def _can_be_made(where: Path) -> bool:
    """Return whether the nearest existing parent is a folder that can be written."""
    nearest = next(p for p in where.parents if os.path.lexists(p))
    return nearest.is_dir() and os.access(nearest, os.W_OK | os.X_OK)


def _replace(path: Path, content: bytes) -> None:
    """Write a file in one step, leaving nothing else behind."""
    descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=_TEMPORARY)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
        os.chmod(temporary, _PRIVATE_FILE)
        os.replace(temporary, path)
    finally:
        Path(temporary).unlink(missing_ok=True)


def _make_room(where: Path) -> None:
    """Remove what processes that were killed left; if too large, the least used."""
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
    """Return the files of a folder, without those that vanish meanwhile."""
    found = []
    with contextlib.suppress(OSError), os.scandir(where) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):
                status = entry.stat(follow_symlinks=False)
                if not stat.S_ISDIR(status.st_mode):
                    found.append((Path(entry.path), status))
    return found


def _note_use(descriptor: int) -> None:
    """Renew the time stamp of a file that is used, but not at every use."""
    if time.time() - os.fstat(descriptor).st_mtime > USE_NOTED_S:
        with contextlib.suppress(OSError):
            os.utime(descriptor)


def _open_own(path: str, flags: int) -> int:
    """Open a file that is the user's own, and that no other may write."""
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
    """Return whether a folder is real, the user's own, and closed to all others."""
    try:
        status = where.lstat()
    except OSError:
        return False
    private = stat.S_IMODE(status.st_mode) == _PRIVATE or os.name == "nt"
    return stat.S_ISDIR(status.st_mode) and _is_mine(status) and private


def _is_mine(status: os.stat_result) -> bool:
    return not hasattr(os, "geteuid") or status.st_uid == os.geteuid()
