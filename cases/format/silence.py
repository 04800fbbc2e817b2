"""Silence for libraries that print unwanted output, qpOASES and others."""

import contextlib
import ctypes
import io
import os
import sys
from collections.abc import Iterator


@contextlib.contextmanager
def silenced(*, is_needed: bool = True) -> Iterator[None]:
    """Discard all printed output, also that of C and C++ libraries.

    Standard output of the whole process is replaced, so only one thread may solve.

    Args:
        is_needed: Whether to do anything at all.

    Yields:
        Nothing.
    """
    if not is_needed:
        yield
        return
    _flush()
    saved, null = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(null, 1)
        with contextlib.redirect_stdout(io.StringIO()):
            yield
    finally:
        _flush()  # Else output in a buffer of C would be printed later.
        os.dup2(saved, 1)
        os.close(saved)
        os.close(null)


def _flush() -> None:
    with contextlib.suppress(AttributeError, OSError, ValueError):
        sys.stdout.flush()
    with contextlib.suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).fflush(None)
