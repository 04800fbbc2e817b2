"""The command line as a process: signals, streams, errors and exit codes.

The exit codes are in `terminal`, the parser of all commands is in `parser`. Everything
heavy is imported by the command that needs it.
"""

import argparse
import atexit
import gc
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from pkgutil import resolve_name
from types import FrameType
from typing import Any

from swarmstart.cases.commands.front.parser import parser, subcommands
from swarmstart.cases.commands.terminal import (
    DONE,
    INTERRUPTED,
    OutputError,
    finish,
    first_sign,
    occupy_closed_streams,
    reported,
    say,
)

logger = logging.getLogger(__name__)

GARBAGE_THRESHOLD = 50_000
"""New objects between two looks for garbage; Python's 700 take 0.2 s of imports."""

__all__ = ["main", "parser", "program", "subcommands"]


def program() -> int:
    """Run the command line of this process; return the exit code.

    Signals that arrive after the command has finished are ignored.
    """
    occupy_closed_streams()
    gc.set_threshold(GARBAGE_THRESHOLD)
    try:
        code = _interruptible(None, afterwards=lambda _: signal.SIG_IGN)
    except SystemExit as leaving:  # from argparse
        code = int(leaving.code or DONE)
    try:
        finish()
    except OutputError as error:
        return reported(error)
    if code == INTERRUPTED:
        # An interrupt within exec() of a text (an import, a dataclass) is remembered by
        # Python, which would end the process by SIGINT in place of this code.
        atexit._run_exitfuncs()
        os._exit(code)
    gc.freeze()  # Python looks for garbage once more at its end: 0.2 s for nothing.
    return code


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Args:
        arguments: The command line without the program's name; None means sys.argv's.

    Returns:
        The exit code.
    """
    before = {number: signal.getsignal(number) for number in _requests()}
    return _interruptible(arguments, afterwards=before.__getitem__)


def _interruptible(
    arguments: Sequence[str] | None, *, afterwards: Callable[[int], Any]
) -> int:
    """Run a command that signals interrupt; afterwards they are handled otherwise."""
    asked_to_stop: list[int] = []
    is_over = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        if not is_over:
            asked_to_stop.append(number)
            raise KeyboardInterrupt

    numbers = _requests()
    try:
        for number in numbers:
            signal.signal(number, interrupt)
        return _carried_out(arguments, asked_to_stop)
    except KeyboardInterrupt:  # A second one, while something is said of the first.
        return INTERRUPTED
    finally:
        is_over = True
        for number in numbers:
            signal.signal(number, afterwards(number))


def _requests() -> list[int]:
    """Return the signals that ask to stop, without those that are to be ignored."""
    if threading.current_thread() is not threading.main_thread():
        return []  # Python delivers none there.
    names = ("SIGINT", "SIGTERM", "SIGHUP")
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    return [n for n in numbers if signal.getsignal(n) not in (signal.SIG_IGN, None)]


def _carried_out(arguments: Sequence[str] | None, asked_to_stop: list[int]) -> int:
    """Run a command; return the exit code, however it ends."""
    try:
        options = _parsed(arguments)
        with first_sign(quiet=options.debug or getattr(options, "quiet", False)):
            command: Callable[[argparse.Namespace], int]
            command = resolve_name(options.command)  # Imports what the command needs.
            return command(options)
    except KeyboardInterrupt as interrupt:
        say(f"interrupted{': ' if interrupt.args else ''}{interrupt}")
        return INTERRUPTED
    except BrokenPipeError:  # The reader of our output has gone.
        return DONE
    except Exception as error:
        logger.debug("", exc_info=True)
        if asked_to_stop:  # What the interrupt became on its way.
            say("interrupted")
            return INTERRUPTED
        return reported(error)


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the options; unknown words are reported by the command's own parser."""
    options, unknown = parser().parse_known_args(arguments)
    options.words = list(sys.argv[1:] if arguments is None else arguments)
    if unknown:
        options.parser.refuse(unknown)
    if options.debug:
        logging.basicConfig(level=logging.INFO, format="%(name)s: %(message)s")
        logging.getLogger("swarmstart").setLevel(logging.DEBUG)
    return options
