"""Output of a command: answers on standard output, the rest on standard error.

Control characters are escaped, and those that the terminal cannot show. A stream that
is closed or full never causes a traceback, and no message changes to the other stream.
"""

import contextlib
import os
import sys
import textwrap
from collections.abc import Sequence
from typing import TextIO

from swarmstart.cases.format.document import printable
from swarmstart.errors import SwarmstartError

DONE, INTERNAL, INVALID, GATE, INFEASIBLE, FILE, INTERRUPTED = 0, 1, 2, 3, 4, 5, 130
"""Exit codes of the command line, as its help lists them."""
WIDTH = 80
"""Characters of a line in a wrapped table."""
LEAST = 30
"""Characters that its last column has at least."""


class OutputError(SwarmstartError):
    """An answer could not be written to standard output."""


def answer(text: str) -> None:
    """Print the answer of a command on standard output.

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
    """Flush both streams now: at its end Python would report a failure as its own.

    Raises:
        OutputError: If standard output cannot be written.
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
    """Print a text on standard error, if there is one."""
    if sys.stderr is None:
        return
    try:
        _write(sys.stderr, text)
    except (OSError, ValueError):
        silence(sys.stderr)


def say(text: str) -> None:
    """Print a message on standard error, after the program's name."""
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


def wrapped_table(rows: Sequence[tuple[str, ...]], *, width: int = WIDTH) -> list[str]:
    """Return rows as aligned lines whose last column is wrapped.

    Args:
        rows: The cells, of each row as many.
        width: Characters of a line; more if the other columns leave too few.
    """
    if not rows:
        return []
    rows = [tuple(map(printable, row)) for row in rows]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]) - 1)]
    lines = []
    for row in rows:
        cells = [cell.ljust(w) for cell, w in zip(row, widths, strict=False)]
        begin = "  " + "".join(f"{cell}  " for cell in cells)
        lines += textwrap.wrap(
            row[-1] or "-",
            max(width, len(begin) + LEAST),
            initial_indent=begin,
            subsequent_indent=" " * len(begin),
            break_on_hyphens=False,
        )
    return lines


def silence(stream: TextIO | None) -> None:
    """Discard what a stream still holds: Python would write it again at its end."""
    if stream is None:
        return
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def occupy_closed_streams() -> None:
    """Open the null device in the place of each closed stream.

    Otherwise the next file that is opened gets the number of that stream, and what
    libraries print is written into the file.
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
