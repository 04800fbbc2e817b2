"""First words of a command: that it is at work.

Loading libraries takes a second or two, and compiling at the first use ten; both before
any progress can be shown.
"""

import contextlib
import logging
import threading
from collections.abc import Iterator

from swarmstart.cases.commands.output import say

AT_WORK = "at work: loading and checking"
FIRST_SIGN_S = 0.6
"""A command that takes longer says so; quicker ones say nothing."""


class _Saying(logging.Handler):
    """A handler that says what the library logs, as the command line does."""

    def emit(self, record: logging.LogRecord) -> None:
        """Say a record."""
        say(record.getMessage())


@contextlib.contextmanager
def first_minute(*, quiet: bool) -> Iterator[None]:
    """Say after a moment that the command is at work, and when something is compiled.

    Args:
        quiet: Whether to stay silent.

    Yields:
        Nothing.
    """
    if quiet:
        yield
        return
    logger, handler = logging.getLogger("swarmstart.compile_time"), _Saying()
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
