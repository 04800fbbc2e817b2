"""NLP solvers of other packages: the options that a file may set, and their silence.

A file is data. An option of a solver could name a library to load (hsllib), a file to
write (output_file) or a compiler to run (jit), so those are refused, and so is text
that could be the path of a plug-in or a library. A file may set none of the options
that reach beyond the solve.

Some libraries print unwanted output, qpOASES and others; they are silenced.
"""

import contextlib
import ctypes
import io
import os
import re
import sys
from collections.abc import Iterator, Mapping
from typing import Any

_BEYOND = (
    *("hsllib", "pardisolib", "output_file", "option_file", "jit", "compiler"),
    *("dump", "external", "custom_jacobian", "cache"),
)
"""Beginnings of options that name files or run programs."""
_WORD = re.compile(r"[A-Za-z0-9_.,+ -]{0,100}")


def reaches_beyond(name: str, value: Any) -> bool:
    """Return whether an option could name a file or run a program.

    Args:
        name: Name of the option, perhaps with a prefix such as "ipopt.".
        value: Its value.

    Example:
        >>> reaches_beyond("ipopt.hsllib", "mine.so"), reaches_beyond("mu_init", 0.1)
        (True, False)
    """
    # Every part, since a prefix such as "ipopt." may be there; IPOPT ignores case.
    if any(part.casefold().startswith(_BEYOND) for part in name.split(".")):
        return True
    return isinstance(value, str) and not _WORD.fullmatch(value)


def refused(options: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield name and error of each option that a user's file may not set."""
    for name, value in options.items():
        if reaches_beyond(name, value):
            yield (
                name,
                "expected an option that neither names a file nor runs a program, "
                f"found {name}",
            )


@contextlib.contextmanager
def silenced(*, is_needed: bool = True) -> Iterator[None]:
    """Discard all printed output, also that of C and C++ libraries.

    Standard output of the whole process is replaced, so only one thread may solve.
    Nothing is done unless `is_needed`.
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
