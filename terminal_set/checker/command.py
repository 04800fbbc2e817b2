"""The command that checks a certificate: its options, its lines, its exit codes.

All text from files is escaped before it is printed.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import math
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NoReturn, TextIO

from swarmstart.terminal_set.checker.file_content import (
    CertificateFileError,
    DigestError,
)
from swarmstart.terminal_set.checker.findings import Finding, Verdict

PROVED, UNUSABLE, REFUSED, UNDECIDED, UNREADABLE, INTERRUPTED = 0, 2, 3, 4, 5, 130

Judged = tuple[Iterable[Finding], Callable[[Sequence[str]], str]]
"""Findings of a file; function: subjects only sampled -> verdict if all hold."""


def parsed(arguments: Sequence[str] | None, *, program: str) -> argparse.Namespace:
    """Return the options: `file`, `seconds` and `against`.

    Args:
        arguments: Arguments of the command line; None means those of the process.
        program: Name of the command.

    Raises:
        SystemExit: With code UNUSABLE, if they are invalid.
    """
    parser = _Parser(
        prog=program,
        description="Check a certificate of a terminal set or of a lower bound.",
        epilog="exit codes: 0 proven again, 2 unusable, 3 refused, 4 undecided, "
        "5 unreadable",
    )
    parser.add_argument("file", type=Path, help="the certificate (JSON)")
    parser.add_argument(
        "--seconds", type=_seconds, default=600.0, help="time for all of it [600]"
    )
    parser.add_argument(
        "--against", type=Path, metavar="NAME.c",
        help="C file of a controller, whose gain, set, reference, bounds and law must "
        "be those of the certificate [none]",
    )  # fmt: skip
    return parser.parse_args(arguments)


def checked(options: argparse.Namespace, judge: Callable[[Path], Judged]) -> int:
    """Check one file; print a line for each statement, and a verdict.

    Args:
        options: Options from `parsed`.
        judge: Function: path -> two results, namely the findings on that file, and a
            function that makes the verdict in words from the names of the statements
            that were only sampled.

    Returns:
        The exit code.
    """
    try:
        return _checked(options, judge)
    except KeyboardInterrupt:
        complain("interrupted")
        return INTERRUPTED
    except ModuleNotFoundError as error:
        complain(
            f"python-{error.name} is needed to check a certificate: pip install "
            f"python-{error.name}",
        )
        return UNUSABLE
    except OSError as error:
        complain(f"the report cannot be written: {error.strerror}")
        if sys.stdout is not None:
            # The rest of its buffer must not fail again when the process ends.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNREADABLE


def _checked(options: argparse.Namespace, judge: Callable[[Path], Judged]) -> int:
    file = options.file
    try:
        found, said = judge(file)
    except OSError as error:
        complain(f"{error.filename or file} cannot be read: {error.strerror}")
        return UNREADABLE
    except CertificateFileError as error:
        complain(f"{file} cannot be used: {error}")
        return UNUSABLE
    except DigestError as error:
        write_line(sys.stdout, f"refused: {error}")
        write_line(sys.stdout, "verdict: refused")
        return REFUSED
    verdicts, sampled = set(), []
    for finding in found:
        verdicts.add(finding.verdict)
        if finding.verdict is Verdict.SAMPLED:
            sampled.append(finding.subject)
        write_line(sys.stdout, f"{finding.verdict.value}: {finding.text}")
    if Verdict.REFUSED in verdicts:
        write_line(sys.stdout, "verdict: refused")
        return REFUSED
    if Verdict.UNDECIDED in verdicts:
        write_line(sys.stdout, f"verdict: undecided within {options.seconds:g} s")
        return UNDECIDED
    write_line(sys.stdout, f"verdict: {said(sampled)}")
    return PROVED


def complain(text: str) -> None:
    """Print a line on stderr, if that is possible."""
    with contextlib.suppress(OSError):
        write_line(sys.stderr, text)


def _seconds(text: str) -> float:
    seconds = float(text)
    if not 0.0 < seconds < math.inf:
        raise argparse.ArgumentTypeError(f"must be above 0, got {text}")
    return seconds


class _Parser(argparse.ArgumentParser):
    """A parser that escapes quoted text, such as the name of a second file."""

    def error(self, message: str) -> NoReturn:
        """Print usage and message, and exit."""
        self.print_usage(sys.stderr)
        complain(f"{self.prog}: error: {message}")
        raise SystemExit(UNUSABLE)


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
    # A control character in a file could change what the terminal shows.
    shown = "".join(char if char.isprintable() else ascii(char)[1:-1] for char in text)
    encoding = stream.encoding or "ascii"
    stream.write(shown.encode(encoding, "backslashreplace").decode(encoding) + "\n")
    stream.flush()
