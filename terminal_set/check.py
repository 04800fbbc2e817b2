"""Check a certificate of a terminal set, sharing no code with what wrote it.

    python -m swarmstart.terminal_set.check FILE [--seconds 600]

Everything a certificate labels proven is proven again by branch and bound in the ball
arithmetic of python-flint; what it labels measured is sampled. Of the file's statements
only those in the words of the format are taken: the lines printed say what each came
to. Nothing of the file is printed unescaped.

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
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from swarmstart.terminal_set.checker.certificate_file import (
    Certificate,
    read_certificate,
)
from swarmstart.terminal_set.checker.deadline import Deadline, TimeIsUpError
from swarmstart.terminal_set.checker.file_content import (
    CertificateFileError,
    DigestError,
)
from swarmstart.terminal_set.checker.findings import Finding, Verdict
from swarmstart.terminal_set.checker.output import write_line

if TYPE_CHECKING:
    from swarmstart.terminal_set.checker.decrease import Outcome

PROVED, UNUSABLE, REFUSED, UNDECIDED, UNREADABLE, INTERRUPTED = 0, 2, 3, 4, 5, 130
PRECISION = 64  # bits; what floats give, and a little for differences near 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Check one file, print a line a statement and a verdict.

    Args:
        arguments: Of the command line; None: those of the process.

    Returns:
        The exit code.
    """
    options = _parser().parse_args(arguments)
    try:
        import flint
    except ImportError:
        _complain(
            "python-flint is needed to check a certificate: "
            "pip install 'swarmstart[test]'",
        )
        return UNUSABLE
    before = flint.ctx.prec
    flint.ctx.prec = PRECISION
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
    finally:
        flint.ctx.prec = before


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
    write_line(sys.stdout, "verdict: everything labelled proven was proven again")
    return PROVED


def findings(certificate: Certificate, *, seconds: float) -> Iterator[Finding]:
    """Judge a certificate, statement by statement, the quick ones first.

    Stops where a refusal leaves nothing to stand on.

    Args:
        certificate: What the file states.
        seconds: Time for all of it [s].

    Yields:
        One finding a statement.
    """
    try:
        yield from _findings(certificate, Deadline.after(seconds))
    except TimeIsUpError:
        text = "the rest: time was up before it could be judged"
        yield Finding(Verdict.UNDECIDED, text)


def _findings(certificate: Certificate, deadline: Deadline) -> Iterator[Finding]:
    from swarmstart.terminal_set.checker import closed_form

    matrices = closed_form.check_matrices(certificate)
    yield from matrices
    if any(finding.verdict is Verdict.REFUSED for finding in matrices):
        return
    refused = False
    for finding in _quick_findings(certificate, deadline):
        refused = refused or finding.verdict is Verdict.REFUSED
        yield finding
    if not refused:
        yield from _proofs(certificate, deadline)


def _quick_findings(certificate: Certificate, deadline: Deadline) -> Iterator[Finding]:
    from swarmstart.terminal_set.checker import closed_form, drift, falsification

    yield drift.check_drift(certificate, deadline)
    yield from closed_form.check_bounds(certificate)
    yield falsification.check_refuted(certificate, deadline)
    failed = falsification.find_counterexample(certificate, deadline)
    if failed is not None:
        yield failed
    if certificate.dt is not None:
        yield falsification.check_integrator(certificate, deadline)
        if certificate.growth is None:
            yield Finding(Verdict.SKIPPED, "nothing is stated between samples")
        else:
            sampled = falsification.check_growth_by_samples(certificate, deadline)
            # Where it is labelled proven, the proof's line replaces that of samples.
            if sampled.verdict is Verdict.REFUSED or not certificate.growth_proven:
                yield sampled


def _proofs(certificate: Certificate, deadline: Deadline) -> Iterator[Finding]:
    from swarmstart.terminal_set.checker import ellipsoid_statements as statements

    level = f"0 < V(e) <= {certificate.alpha:.6g}"
    kind = "" if certificate.dt is None else f" over a hold of {certificate.dt:g} s"
    start = time.monotonic()
    outcome = statements.prove_decrease(certificate, deadline)
    yield _judged(outcome, f"V decreases{kind} on {level}", start)
    if certificate.growth_proven:
        start = time.monotonic()
        outcome = statements.prove_growth(certificate, deadline)
        growth = f"V stays below {certificate.growth:.6g} V(e) between samples"
        yield _judged(outcome, f"{growth} on {level}", start)


def _judged(outcome: Outcome, text: str, start: float) -> Finding:
    effort = f"{outcome.boxes} boxes, {time.monotonic() - start:.2f} s"
    if outcome.proven:
        return Finding(Verdict.PROVED, f"{text} ({effort})")
    if outcome.counterexample is not None:
        e = ", ".join(f"{entry:.6g}" for entry in outcome.counterexample)
        return Finding(Verdict.REFUSED, f"it is false that {text}: e = ({e})")
    return Finding(Verdict.UNDECIDED, f"{text} ({effort}; {outcome.remark})")


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
        prog="python -m swarmstart.terminal_set.check",
        description="Check a certificate of a terminal set.",
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
