"""Progress of long work, on standard error.

The first message says that the command is at work: loading libraries takes a second or
two, and compiling takes ten at the first use, before any step is finished. A bar
follows on a terminal, and a plain line every few seconds elsewhere (a notebook, a file,
a pipe, CI). Nothing is printed within the first two seconds.
"""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import threading
import time as clock
from collections.abc import Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Self

from swarmstart.cases.commands.terminal.output import say, tell

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress

AT_WORK = "at work: loading and checking"
FIRST_SIGN_S = 0.6
"""A command that takes longer says that it is at work."""
QUIET_S = 2.0
LINE_EVERY_S = 5.0


def fancy() -> bool:
    """Return whether standard error is a terminal that may be drawn on."""
    return sys.stderr is not None and sys.stderr.isatty() and "CI" not in os.environ


class _Saying(logging.Handler):
    """A handler that prints log records of the library as the command line does."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        say(record.getMessage())


@contextlib.contextmanager
def first_sign(*, quiet: bool) -> Iterator[None]:
    """Print after a moment that the command is at work, and when it compiles something.

    Args:
        quiet: Whether to stay silent.

    Yields:
        Nothing.
    """
    if quiet:
        yield
        return
    logger, handler = (
        logging.getLogger("swarmstart.machine_code.compile_time"),
        _Saying(),
    )
    before = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    sign = threading.Timer(FIRST_SIGN_S, say, [AT_WORK])
    sign.daemon = True
    sign.start()
    try:
        yield
    finally:
        sign.cancel()
        logger.removeHandler(handler)
        logger.setLevel(before)


class Progress:
    """A context in which `update` may be called after every step.

    `with Progress("swing-up") as shown: solve(..., progress=shown.update)`.
    """

    def __init__(self, title: str, *, quiet: bool = False) -> None:
        """Prepare; nothing is shown yet.

        Args:
            title: Name of the work.
            quiet: Whether to stay silent.
        """
        self._title, self._quiet = title, quiet
        self._began = self._said = clock.monotonic()
        # The first step compiles, so the pace is taken from its end: (time, steps).
        self._pace_from: tuple[float, int] | None = None
        self._bar: RichProgress | None = None

    def __enter__(self) -> Self:
        """Begin to count the time."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.stop()

    def update(self, done: int, total: int, what: str) -> None:
        """Show how far the work is.

        Args:
            done: Steps finished.
            total: Steps in all; 0 if their number is unknown.
            what: The part of the work that is being done.
        """
        now = clock.monotonic()
        if self._pace_from is None and done:
            self._pace_from = now, done
        if self._quiet or now - self._began < QUIET_S:
            return
        if fancy():
            self._draw(done, total, what)
        elif now - self._said >= LINE_EVERY_S or self._said == self._began:
            self._said = now
            step = f", step {done} of {total}" if total else ""
            tell(f"{self._title}: {what}{step}{self._left(now, done, total)}")

    def _draw(self, done: int, total: int, what: str) -> None:
        if self._bar is None:
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
            self._bar.add_task(self._title, total=total or None, counted="")
            self._bar.start()
        self._bar.update(
            self._bar.task_ids[0],
            completed=done,
            total=total or None,
            counted=f"{done}/{total}" if total else "",
            description=f"{self._title}: {what}",
        )

    def _left(self, now: float, done: int, total: int) -> str:
        """Return the time left in words; empty if it cannot be estimated."""
        since, first = self._pace_from or (now, done)
        if done <= first or done >= total:
            return ""
        return f", about {(now - since) / (done - first) * (total - done):.0f} s left"
