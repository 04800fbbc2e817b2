"""Machine code kept on disk, where nobody but its owner can have written it.

Loading code that somebody else could have written is the risk to close. So the folder
must be a real folder of the user's own with mode 0700, a file a real file of the user's
own that no other may write; what is not is refused. A file that is damaged is rebuilt.
Files are replaced atomically, so two processes that build at once do no harm; where
nothing can be kept (an unwritable home), code is built anew each time.
"""

import hashlib
import os
import stat
import tempfile
from pathlib import Path

_DIGEST_BYTES = hashlib.sha256().digest_size
_PRIVATE = 0o700
_OTHERS_MAY_WRITE = 0o022


def folder() -> Path:
    """Return the folder of the cache, whether it exists or not."""
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "swarmstart" / "machine-code"


def load(key: str) -> bytes | None:
    """Return the code kept under a key; None where there is none to trust.

    Args:
        key: Hexadecimal digits.
    """
    where = folder()
    if not _is_private(where):
        return None
    try:
        descriptor = os.open(where / key, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
    except OSError:
        return None
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode) or not _is_mine(status):
            return None
        if stat.S_IMODE(status.st_mode) & _OTHERS_MAY_WRITE:
            return None
        content = file.read()
    digest, code = content[:_DIGEST_BYTES], content[_DIGEST_BYTES:]
    return code if hashlib.sha256(code).digest() == digest else None


def store(key: str, code: bytes) -> None:
    """Keep code under a key, if that can be done safely; say nothing if not.

    Args:
        key: Hexadecimal digits.
        code: The machine code.
    """
    where = folder()
    temporary = ""
    try:
        where.mkdir(mode=_PRIVATE, parents=True, exist_ok=True)
        if not _is_private(where):
            return
        descriptor, temporary = tempfile.mkstemp(dir=where, prefix=".new-")
        with os.fdopen(descriptor, "wb") as file:
            file.write(hashlib.sha256(code).digest() + code)
        os.replace(temporary, where / key)
    except OSError:
        if temporary:
            Path(temporary).unlink(missing_ok=True)


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
