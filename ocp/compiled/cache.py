"""Machine code kept on disk, where nobody but its owner can have written it.

Loading code that somebody else could have written is the risk to close. So the folder
must be a real folder of the user's own with mode 0700, a file a real file of the user's
own that no other may write; what is not is refused. A file begins with the hash of its
key and code; one that is damaged, or another's, is rebuilt. Files are replaced
atomically, so two processes that build at once do no harm; where nothing can be kept
(an unwritable home, or none), code is built anew each time.
"""

import contextlib
import hashlib
import os
import stat
import tempfile
from pathlib import Path

_DIGEST_BYTES = hashlib.sha256().digest_size
_PRIVATE = 0o700
_OTHERS_MAY_WRITE = 0 if os.name == "nt" else 0o022


def folder() -> Path:
    """Return the folder of the cache, whether it exists or not."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    if not os.path.isabs(base):  # To be ignored, says the XDG specification.
        base = os.path.expanduser("~/.cache")
    return Path(base, "swarmstart", "machine-code")


def load(key: str) -> bytes | None:
    """Return the code kept under a key; None where there is none to trust.

    Args:
        key: Hexadecimal digits.
    """
    where = folder()
    if not _is_private(where):
        return None
    try:
        with open(where / key, "rb", opener=_open_own) as file:
            content = file.read()
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
        where.mkdir(mode=_PRIVATE, parents=True, exist_ok=True)
        if _is_private(where):
            _replace(where / key, _digest(key, code) + code)


def _replace(path: Path, content: bytes) -> None:
    """Write a file in one step, leaving nothing else behind."""
    descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=".new-")
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
        os.replace(temporary, path)
    finally:
        Path(temporary).unlink(missing_ok=True)


def _open_own(path: str, flags: int) -> int:
    """Open a file that is the user's own, and that no other may write."""
    descriptor = os.open(path, flags | getattr(os, "O_NOFOLLOW", 0))
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
