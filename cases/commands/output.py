"""Output of a command: answers on standard output, else standard error; exit codes.

Characters that a terminal would obey are escaped, and those that it cannot show. A
stream that is closed or full is no reason for a traceback, and never for an error to be
said on the other one.
"""

import contextlib
import os
import sys
from collections.abc import Sequence
from typing import TextIO

from swarmstart.cases.format.document import printable
from swarmstart.errors import SwarmstartError

DONE, INTERNAL, INVALID, GATE, INFEASIBLE, FILE, INTERRUPTED = 0, 1, 2, 3, 4, 5, 130
"""Exit codes of the command line, as its help lists them."""


class OutputError(SwarmstartError):
    """An answer could not be written to standard output."""


def answer(text: str) -> None:
    """Print what a command was asked for.

    Raises:
        OutputError: If it cannot be written.
        BrokenPipeError: If its reader has gone.
    """
    try:
        if sys.stdout is None:
            raise ValueError("it is closed")
        _write(sys.stdout, text)
    except BrokenPipeError:
        silence(sys.stdout)
        raise
    except (OSError, ValueError) as error:
        silence(sys.stdout)
        raise _refused(error) from error


def finish() -> None:
    """Write what others have left in the streams; Python would do so too late.

    Raises:
        OutputError: If standard output does not take it.
    """
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except (OSError, ValueError) as error:
        silence(sys.stdout)
        if not isinstance(error, BrokenPipeError):
            raise _refused(error) from error
    if sys.stderr is not None:
        try:
            sys.stderr.flush()
        except (OSError, ValueError):
            silence(sys.stderr)


def tell(text: str) -> None:
    """Say something on standard error, if there is one."""
    if sys.stderr is None:
        return
    try:
        _write(sys.stderr, text)
    except (OSError, ValueError):
        silence(sys.stderr)


def say(text: str) -> None:
    """Say something on standard error in the program's name."""
    tell(f"swarmstart: {text}")


def table_lines(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Return rows as aligned lines; the last column is not padded."""
    if not rows:
        return []
    rows = [tuple(map(printable, row)) for row in rows]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]) - 1)]
    return [
        "  "
        + "  ".join(
            [cell.ljust(width) for cell, width in zip(row, widths, strict=False)]
            + [row[-1]]
        )
        for row in rows
    ]


def silence(stream: TextIO | None) -> None:
    """Send to nowhere what a stream still holds: Python would try again at its end."""
    if stream is None:
        return
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def occupy_closed_streams() -> None:
    """Open nothing in the place of streams that are closed.

    Otherwise the next file that is opened takes their number, and gets what libraries
    print.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


def _refused(error: Exception) -> OutputError:
    reason = getattr(error, "strerror", None) or str(error)
    return OutputError(f"standard output: expected to write to it: {reason}")


def _write(stream: TextIO, text: str) -> None:
    encoding = stream.encoding or "utf-8"
    shown = "\n".join(map(printable, text.split("\n")))
    stream.write(shown.encode(encoding, "backslashreplace").decode(encoding) + "\n")
    stream.flush()
