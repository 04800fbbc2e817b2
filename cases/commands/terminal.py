"""The terminal: answers on standard output, messages and progress on standard error.

Control characters, and characters that the terminal cannot show, are escaped. A stream
that is closed or full never causes a traceback, and its messages are not printed on the
other stream. An error is printed as one message on standard error, and has an exit
code.

During long work, the first message says that the command is at work: loading libraries
takes a second or two, and compiling takes ten at the first use, before any step is
finished. A bar follows on a terminal, a line that is rewritten in a notebook, and a
plain line every few seconds elsewhere (a file, a pipe, CI). Nothing but that message is
printed within the first two seconds.
"""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import textwrap
import threading
import time as clock
from collections.abc import Iterator, Sequence
from numbers import Integral
from types import TracebackType
from typing import TYPE_CHECKING, NoReturn, Self, TextIO

from swarmstart.cases.format.document import printable
from swarmstart.errors import InvalidArgumentError, SwarmstartError

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress


DONE, INTERNAL, INVALID, GATE, INFEASIBLE, FILE, INTERRUPTED = 0, 1, 2, 3, 4, 5, 130
"""Exit codes of the command line, as its help lists them."""
WIDTH = 80
"""Characters of a line in a wrapped table."""
LEAST = 30
"""Characters that its last column has at least."""
MOST_FLAWS = 20
"""Errors of a scenario that are printed; further ones are counted."""
AT_WORK = "at work: loading"
FIRST_SIGN_S = 0.6
"""A command that takes longer says that it is at work."""
QUIET_S = 2.0  # Nothing is printed before, except the first sign.
LINE_EVERY_S = 5.0
REWRITTEN_EVERY_S = 0.5


class OutputError(SwarmstartError):
    """An answer could not be written to standard output."""


def answer(text: str) -> None:
    """Print the answer of a command on standard output.

    Raises:
        OutputError: If it cannot be written.
        BrokenPipeError: If the reader of standard output has gone.
    """
    try:
        if sys.stdout is None:
            # Python has None for a stream that was closed before it started.
            raise ValueError("it is closed")
        _write(sys.stdout, text)
    except BrokenPipeError:
        silence(sys.stdout)
        raise
    except (OSError, ValueError) as error:
        # OSError: a full disk, say; ValueError: a closed file object.
        silence(sys.stdout)
        raise _refused(error) from error


def finish() -> None:
    """Flush standard output and standard error.

    Python flushes them at its end, too, but reports a failure in its own words.

    Raises:
        OutputError: If standard output cannot be written.
    """
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except (OSError, ValueError) as error:
        silence(sys.stdout)
        # A reader that has gone, such as `head`, has read what it wanted.
        if not isinstance(error, BrokenPipeError):
            raise _refused(error) from error
    if sys.stderr is not None:
        try:
            sys.stderr.flush()
        except (OSError, ValueError):
            silence(sys.stderr)


def tell(text: str) -> None:
    """Print a text on standard error, if it is open."""
    if sys.stderr is None:
        return
    try:
        _write(sys.stderr, text)
    except (OSError, ValueError):
        silence(sys.stderr)


def say(text: str) -> None:
    """Print a message on standard error, after the program's name."""
    tell(f"swarmstart: {text}")


def reported(error: Exception) -> int:
    """Print an error as one message; return its exit code."""
    # Here, since the last of them imports NumPy, which help and lists do without.
    from swarmstart.cases.format.document import UnreadableFileError, YamlError
    from swarmstart.cases.format.flaws import InvalidScenarioError
    from swarmstart.cases.record.files import RecordError

    if isinstance(error, InvalidScenarioError):
        for flaw in error.flaws[:MOST_FLAWS]:
            _tell_with_frame(str(flaw), flaw.frame)
        if len(error.flaws) > MOST_FLAWS:
            say(f"and {len(error.flaws) - MOST_FLAWS} more errors")
        return INVALID
    if isinstance(error, YamlError):
        _tell_with_frame(str(error), error.frame)
        return INVALID
    if isinstance(error, SwarmstartError):
        say(str(error))
        of_file = isinstance(error, UnreadableFileError | RecordError | OutputError)
        return FILE if of_file else INVALID
    return _reported_of_system(error)


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


def wrapped_table(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Return rows as aligned lines whose last column is wrapped.

    Args:
        rows: Cells of each row; all rows have the same number of cells.
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
            # A table with long names is wider, since its last column must be readable.
            max(WIDTH, len(begin) + LEAST),
            initial_indent=begin,
            subsequent_indent=" " * len(begin),
            break_on_hyphens=False,
        )
    return lines


@contextlib.contextmanager
def first_sign(*, quiet: bool) -> Iterator[None]:
    """Context that says after a moment that the command is at work.

    It also prints the name of each thing that is compiled meanwhile. If `quiet` is
    true, it prints nothing.
    """
    if quiet:
        yield
        return
    logger, handler = (
        logging.getLogger("swarmstart.machine_code.clocks"),
        _Saying(),
    )
    # The library logs what it compiles at INFO, which no handler prints by itself.
    before = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    sign = threading.Timer(FIRST_SIGN_S, say, [AT_WORK])
    # A pending sign must not keep the process alive.
    sign.daemon = True
    sign.start()
    try:
        yield
    finally:
        sign.cancel()
        logger.removeHandler(handler)
        logger.setLevel(before)


def _require(name: str, value: object, kind: type, allowed: str) -> None:
    """Raise unless a value is of a type; `arguments` would import NumPy here."""
    if not isinstance(value, kind) or (kind is Integral and isinstance(value, bool)):
        raise InvalidArgumentError(name, value, allowed)


class Progress:
    """A context in which `update` may be called after every step.

    `with Progress("swing-up") as shown: solve(..., progress=shown.update)`.
    """

    def __init__(
        self,
        title: str,
        *,
        quiet: bool = False,
        of: str = "step",
        waits: bool = False,
    ) -> None:
        """Prepare; nothing is shown yet.

        Args:
            title: Name of the work.
            quiet: Whether to stay silent.
            of: Name of what is counted.
            waits: Whether the last update is shown two seconds after the beginning,
                even if no other one follows.

        Raises:
            InvalidArgumentError: If one is of another type.
        """
        _require("title", title, str, "text")
        _require("quiet", quiet, bool, "True or False")
        _require("of", of, str, "text")
        _require("waits", waits, bool, "True or False")
        self._title, self._quiet, self._of = title, quiet, of
        self._began = self._said = clock.monotonic()
        # The first step compiles, so the pace is taken from its end: (time, steps).
        self._pace_from: tuple[float, int] | None = None
        self._bar: RichProgress | None = None
        self._last: tuple[int, int, str] | None = None
        self._width = 0
        self._timer: threading.Timer | None = None
        if waits and not quiet:
            self._timer = threading.Timer(QUIET_S, self._show_last)
            # A pending one must not keep the process alive, nor from being copied.
            self._timer.daemon = True
            self._timer.name = "swarmstart-progress"
        # The timer draws in a thread of its own.
        self._lock, self._is_over = threading.Lock(), False
        self._hiding = contextlib.ExitStack()

    def __reduce__(self) -> NoReturn:
        """Raise: it is drawn on the terminal of one process.

        Raises:
            InvalidArgumentError: Always.
        """
        raise InvalidArgumentError(
            "progress", self, "True, False or a function that can be pickled"
        )

    def __enter__(self) -> Self:
        """Begin to count the time; calls within show no progress of their own."""
        from swarmstart.ocp.common import hidden

        self._hiding.enter_context(hidden())
        if self._timer is not None:
            self._timer.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Remove the bar or the line."""
        self._hiding.close()
        if self._timer is not None:
            self._timer.cancel()
        with self._lock:
            self._is_over = True
            if self._bar is not None:
                self._bar.stop()
            if self._width:
                self._rewrite("")

    def update(self, done: int, total: int, what: str) -> None:
        """Show how far the work is.

        Args:
            done: Number of finished steps.
            total: Number of all steps; 0 if it is not known.
            what: The part of the work that is being done.

        Raises:
            InvalidArgumentError: If an argument is of another type, or a number is
                negative.
        """
        for name, count in (("done", done), ("total", total)):
            _require(name, count, Integral, "an integer of at least 0")
            if count < 0:
                raise InvalidArgumentError(name, count, "an integer of at least 0")
        _require("what", what, str, "text")
        now = clock.monotonic()
        if self._pace_from is None and done:
            self._pace_from = now, done
        self._last = done, total, what
        if self._quiet or now - self._began < QUIET_S:
            return
        with self._lock:
            self._show(now, done, total, what)

    def _show_last(self) -> None:
        """Show the last update, if there was one and the work goes on."""
        with self._lock:
            if self._last is not None and not self._is_over:
                self._show(clock.monotonic(), *self._last)

    def _show(self, now: float, done: int, total: int, what: str) -> None:
        from swarmstart.ocp.common import is_notebook

        if fancy():
            self._draw(done, total, what)
        elif is_notebook():
            if now - self._said >= REWRITTEN_EVERY_S or not self._width:
                self._said = now
                share = f", {100 * done // total} % of {total}" if total else ""
                self._rewrite(f"{self._title}: {what}{share}")
        elif now - self._said >= LINE_EVERY_S or self._said == self._began:
            # The first line comes at once after QUIET_S.
            self._said = now
            step = f", {self._of} {done} of {total}" if done and total else ""
            tell(f"{self._title}: {what}{step}{self._left(now, done, total)}")

    def _draw(self, done: int, total: int, what: str) -> None:
        if self._bar is None:
            # Only a terminal shows a bar, and rich takes time to import.
            from rich.console import Console
            from rich.progress import (
                BarColumn,
                Progress,
                TextColumn,
                TimeRemainingColumn,
            )

            self._bar = Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.fields[counted]}"),
                TimeRemainingColumn(),
                console=Console(stderr=True),
                transient=True,
            )
            self._bar.add_task(f"{self._title}: {what}", total=None, counted="")
            self._bar.start()
        # By itself `update` would keep the total of work that is done.
        self._bar.tasks[0].total = total or None
        self._bar.update(
            self._bar.task_ids[0],
            completed=done,
            counted=f"{done}/{total}" if total else "",
            description=f"{self._title}: {what}",
        )

    def _rewrite(self, text: str) -> None:
        """Write a line over the last one; an empty one erases it."""
        shown, width = printable(text), self._width
        self._width = len(shown)
        with contextlib.suppress(OSError, ValueError):
            # Twice back: spaces that are left would move what follows.
            sys.stderr.write(f"\r{shown.ljust(width)}" + ("" if shown else "\r"))
            sys.stderr.flush()

    def _left(self, now: float, done: int, total: int) -> str:
        """Return the time left in words; empty if it cannot be estimated."""
        since, first = self._pace_from or (now, done)
        if done <= first or done >= total:
            return ""
        return f", about {(now - since) / (done - first) * (total - done):.0f} s left"


def fancy() -> bool:
    """Return whether standard error is a terminal on which a bar can be drawn."""
    return sys.stderr is not None and sys.stderr.isatty() and "CI" not in os.environ


def silence(stream: TextIO | None) -> None:
    """Discard the unwritten text of a stream, which Python would write at its end."""
    if stream is None:
        return
    with contextlib.suppress(OSError, ValueError):
        # The descriptor itself leads nowhere then, also for what Python has buffered.
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def occupy_closed_streams() -> None:
    """Open the null device in the place of each closed stream.

    Otherwise the next file that is opened gets the number of that stream, and output of
    libraries is written into the file.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # The system gives the lowest free number, which is this one.
            os.open(os.devnull, os.O_RDWR)


def _refused(error: Exception) -> OutputError:
    reason = getattr(error, "strerror", None) or str(error)
    return OutputError(f"standard output: expected to write to it: {reason}")


def _write(stream: TextIO, text: str) -> None:
    encoding = stream.encoding or "utf-8"
    # Line breaks are ours; other control characters could come from a file.
    shown = "\n".join(map(printable, text.split("\n")))
    stream.write(shown.encode(encoding, "backslashreplace").decode(encoding) + "\n")
    # Now, so that a full disk is noticed by the command and not at its end.
    stream.flush()


def _reported_of_system(error: Exception) -> int:
    """Report an error from outside this package and return its exit code."""
    if isinstance(error, OSError):
        say(f"expected to read and write files, found: {error}")
        return FILE
    if isinstance(error, MemoryError):
        say(f"expected enough memory, found too little: {error}")
        return INVALID
    say(f"internal error: {type(error).__name__}: {error} (--debug shows where)")
    return INTERNAL


def _tell_with_frame(text: str, frame: str) -> None:
    tell("\n".join(filter(None, (text, frame))))


class _Saying(logging.Handler):
    """A handler that prints log records of the library as the command line does."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a message of the library's log."""
        say(record.getMessage())
