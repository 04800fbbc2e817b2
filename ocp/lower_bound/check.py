"""Check a certificate of a lower bound, sharing no code with what wrote it.

    python -m swarmstart.ocp.lower_bound.check FILE [--seconds 600]

Everything that the bound rests on is proven again, by branch and bound with Taylor
models in place of the library's intervals, derivatives by their truncated arithmetic in
place of CasADi's, and the bound itself in exact fractions. Of the file's statements
only those in the words of the format are taken: the lines printed say what each came
to. Nothing of the file is run, and nothing of it is printed unescaped.

Exit codes: 0 all of it was proven again; 2 the file or the call cannot be used; 3
refused: a statement is false or the file was changed; 4 undecided in the time given; 5
the file cannot be read; 130 interrupted.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from swarmstart.ocp.lower_bound.checker.certificate_file import (
    Certificate,
    read_certificate,
)
from swarmstart.ocp.lower_bound.checker.statements import findings
from swarmstart.terminal_set.checker.file_content import (
    CertificateFileError,
    DigestError,
)
from swarmstart.terminal_set.checker.findings import Verdict
from swarmstart.terminal_set.checker.output import write_line

PROVED, UNUSABLE, REFUSED, UNDECIDED, UNREADABLE, INTERRUPTED = 0, 2, 3, 4, 5, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Check one file, print a line a statement and a verdict.

    Args:
        arguments: Of the command line; None: those of the process.

    Returns:
        The exit code.
    """
    options = _parser().parse_args(arguments)
    try:
        return _check(options.file, options.seconds)
    except KeyboardInterrupt:
        _complain("interrupted")
        return INTERRUPTED
    except OSError as error:
        _complain(f"the report cannot be written: {error.strerror}")
        if sys.stdout is not None:
            # What is left in its buffer must not fail again when the process ends.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNREADABLE


def _check(file: Path, seconds: float) -> int:
    try:
        certificate = read_certificate(file)
    except OSError as error:
        _complain(f"{file} cannot be read: {error.strerror}")
        return UNREADABLE
    except CertificateFileError as error:
        _complain(f"{file} cannot be used: {error}")
        return UNUSABLE
    except DigestError as error:
        write_line(sys.stdout, f"refused: {error}")
        write_line(sys.stdout, "verdict: refused")
        return REFUSED
    verdicts = set()
    for finding in findings(certificate, seconds=seconds):
        verdicts.add(finding.verdict)
        write_line(sys.stdout, f"{finding.verdict.value}: {finding.text}")
    if Verdict.REFUSED in verdicts:
        write_line(sys.stdout, "verdict: refused")
        return REFUSED
    if Verdict.UNDECIDED in verdicts:
        write_line(sys.stdout, f"verdict: undecided within {seconds:g} s")
        return UNDECIDED
    write_line(sys.stdout, f"verdict: proven again: {_said(certificate)}")
    return PROVED


def _said(certificate: Certificate) -> str:
    bound, sense = certificate.bound, certificate.problem.sense
    if sense < 0.0:
        return f"no admissible answer is worth more than {-bound:.12g}"
    return f"no admissible answer costs less than {bound:.12g}"


def _complain(text: str) -> None:
    with contextlib.suppress(OSError):
        write_line(sys.stderr, text)


def _seconds(text: str) -> float:
    seconds = float(text)
    if not 0.0 < seconds < math.inf:
        raise argparse.ArgumentTypeError(f"must be above 0, got {text}")
    return seconds


class _Parser(argparse.ArgumentParser):
    """A parser that escapes what it quotes, such as the name of a second file."""

    def error(self, message: str) -> NoReturn:
        """Print usage and message, and exit."""
        self.print_usage(sys.stderr)
        _complain(f"{self.prog}: error: {message}")
        raise SystemExit(UNUSABLE)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="python -m swarmstart.ocp.lower_bound.check",
        description="Check a certificate of a lower bound.",
        epilog="exit codes: 0 proven again, 2 unusable, 3 refused, 4 undecided, "
        "5 unreadable",
    )
    parser.add_argument("file", type=Path, help="the certificate (JSON)")
    parser.add_argument(
        "--seconds", type=_seconds, default=600.0, help="time for all of it [600]"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
