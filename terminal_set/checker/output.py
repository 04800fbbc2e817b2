"""Text for a terminal: nothing from a file reaches it unescaped."""

from __future__ import annotations

import errno
from typing import TextIO


def write_line(stream: TextIO | None, text: str) -> None:
    """Write a line; escape what is not printable or not in the stream's encoding.

    Args:
        stream: Where to; None: a stream that was closed before the process began.
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
