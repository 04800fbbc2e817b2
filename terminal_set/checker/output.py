"""Output to a terminal, with all text from files escaped."""

from __future__ import annotations

import errno
from typing import TextIO


def write_line(stream: TextIO | None, text: str) -> None:
    """Write a line; escape characters that the stream cannot print.

    Args:
        stream: The stream; None if it was closed before the process began.
        text: The line without its end.

    Raises:
        OSError: If it cannot be written.
    """
    if stream is None:
        raise OSError(errno.EBADF, "the stream is closed")
    shown = "".join(char if char.isprintable() else ascii(char)[1:-1] for char in text)
    encoding = stream.encoding or "ascii"
    stream.write(shown.encode(encoding, "backslashreplace").decode(encoding) + "\n")
    stream.flush()
