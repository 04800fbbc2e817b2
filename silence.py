"""Silence of libraries in C that print where a program's own output belongs.

qpOASES, JSBSim and others print to standard output.
"""

import contextlib
import ctypes
import io
import os
import sys
from collections.abc import Iterator


@contextlib.contextmanager
def silenced(*, is_needed: bool = True) -> Iterator[None]:
    """Discard all printed output, also that of C and C++ libraries.

    Standard output of the whole process is replaced, so only one thread may solve. If
    `is_needed` is False, nothing is done.
    """
    if not is_needed:
        yield
        return
    # What was printed before must still appear.
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
    # There may be no standard output (None), or a closed one (ValueError).
    with contextlib.suppress(AttributeError, OSError, ValueError):
        sys.stdout.flush()
    with contextlib.suppress(AttributeError, OSError, TypeError):
        # All open streams of C; on Windows there is no CDLL(None).
        ctypes.CDLL(None).fflush(None)
