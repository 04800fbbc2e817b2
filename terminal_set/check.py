"""Check a certificate, without code of the program that wrote it.

    python -m swarmstart.terminal_set.check FILE [--seconds 600] [--against NAME.c]

The file is a certificate of a terminal set, of a lower bound, or of a swarm's flight.
Everything that it labels "proven" is proven again, by branch and bound with Taylor
models, or by separating planes; all else that the certificate of a terminal set states
is only sampled. There is one exception: for a held input the integrator's error is only
sampled. The library proves it, and this program does not. Matrices and the drift of a
terminal set's reference are computed in the ball arithmetic of python-flint; the value
of a lower bound is computed in exact fractions. The format has a fixed text for each
statement, and the file may contain no others; one line for each statement says whether
it was proven. Nothing in the file is executed or printed unescaped.

The last line names what was only sampled.

With --against, the constants and the law of a controller in C must be those of the
certificate of its terminal set, bit by bit (checker/c_text.py).

Exit codes: 0 all that is not sampled was proven again, and no sample refutes the rest;
2 the file or the call is invalid; 3 refused: a statement is false or the file was
changed; 4 undecided in the time given; 5 the file cannot be read, or the report cannot
be written; 130 interrupted.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from swarmstart.terminal_set.checker import certificate_file
from swarmstart.terminal_set.checker.c_text import compared
from swarmstart.terminal_set.checker.certificate_file import Certificate
from swarmstart.terminal_set.checker.command import Judged, checked, parsed
from swarmstart.terminal_set.checker.file_content import (
    LOWER_BOUND,
    SWARM_FLIGHT,
    CertificateFileError,
    read_content,
)
from swarmstart.terminal_set.checker.findings import (
    Deadline,
    Finding,
    TimeIsUpError,
    Verdict,
)
from swarmstart.terminal_set.checker.lower_bound import certificate_file as bound_file

PRECISION = 64  # bits; what floats give, and a little for differences near 0


def main(
    arguments: Sequence[str] | None = None,
    *,
    program: str = "python -m swarmstart.terminal_set.check",
) -> int:
    """Check one file; print a line for each statement, and a verdict.

    Args:
        arguments: Arguments of the command line; None means those of the process.
        program: Name of the command.

    Returns:
        The exit code.
    """
    options = parsed(arguments, program=program)
    return checked(
        options, lambda file: _judged(file, options.seconds, options.against)
    )


def _judged(file: Path, seconds: float, against: Path | None) -> Judged:
    content = read_content(file)
    if against is not None and content["format"] in (LOWER_BOUND, SWARM_FLIGHT):
        raise CertificateFileError(
            "--against is for the certificate of a terminal set, found a "
            f"{content['format']}"
        )
    # What a kind needs is imported here: it may be missing.
    if content["format"] == LOWER_BOUND:
        from swarmstart.terminal_set.checker.lower_bound import statements

        bound = bound_file.certificate_of(content)
        return statements.findings(
            bound, seconds=seconds
        ), lambda _: statements.verdict(bound)
    if content["format"] == SWARM_FLIGHT:
        from swarmstart.terminal_set.checker.swarm import certificate_file as swarm_file
        from swarmstart.terminal_set.checker.swarm import statements as of_swarms

        flight = swarm_file.certificate_of(content)
        return of_swarms.findings(flight, seconds=seconds), lambda _: of_swarms.verdict(
            flight
        )
    import flint  # noqa: F401

    certificate = certificate_file.certificate_of(content)
    found = _in_balls(certificate, seconds)
    if against is not None:
        # Before any line is printed: the C file may be unusable.
        found = _both(list(compared(certificate, against)), found)
    return found, lambda sampled: _said(certificate, sampled)


def _both(first: list[Finding], rest: Iterator[Finding]) -> Iterator[Finding]:
    """Yield the comparison with a C file, and all other findings if that succeeds."""
    yield from first
    if all(one.verdict is Verdict.PROVED for one in first):
        yield from rest


def _in_balls(certificate: Certificate, seconds: float) -> Iterator[Finding]:
    from flint import ctx

    with ctx.workprec(PRECISION):  # It is one setting of the whole process.
        yield from findings(certificate, seconds=seconds)


def _said(certificate: Certificate, sampled: Sequence[str]) -> str:
    if certificate.dt is None:
        return "everything stated was proven again"
    left = f"only sampled: {' and '.join(sampled)}" if sampled else ""
    if certificate.integrator is None:
        left = "nothing is stated of the integrator's error" + f"; {left}" * bool(left)
    return f"proven again for the Runge-Kutta map; {left}"


def findings(certificate: Certificate, *, seconds: float) -> Iterator[Finding]:
    """Judge a certificate, statement by statement, the quick ones first.

    It stops if P or Q_m is refused, since all other statements depend on them. The long
    proofs are left out if any quick statement is refused.

    Args:
        certificate: The statements of the file.
        seconds: Time for all statements [s].

    Yields:
        A finding for each statement.
    """
    try:
        yield from _findings(certificate, Deadline.after(seconds))
    except TimeIsUpError:
        text = "the rest: time was up before it could be judged"
        yield Finding(Verdict.UNDECIDED, text)


def _findings(certificate: Certificate, deadline: Deadline) -> Iterator[Finding]:
    from swarmstart.terminal_set.checker.ellipsoid_statements import check_matrices

    matrices = check_matrices(certificate)
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
    from swarmstart.terminal_set.checker import falsification
    from swarmstart.terminal_set.checker.ellipsoid_statements import check_bounds
    from swarmstart.terminal_set.checker.motion import check_drift

    yield check_drift(certificate, deadline)
    yield from check_bounds(certificate)
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
            # If it is labelled proven, the proof's line replaces that of samples.
            if sampled.verdict is Verdict.REFUSED or not certificate.growth_proven:
                yield sampled


def _proofs(certificate: Certificate, deadline: Deadline) -> Iterator[Finding]:
    from swarmstart.terminal_set.checker import ellipsoid_statements as statements
    from swarmstart.terminal_set.checker.search import finding_of

    level = f"0 < V(e) <= {certificate.alpha:.6g}"
    kind = "" if certificate.dt is None else f" over a hold of {certificate.dt:g} s"
    start = time.monotonic()
    task = statements.decrease_task(certificate, deadline)
    outcome = statements.prove_on_set(task, deadline)
    yield finding_of(outcome, f"V decreases{kind} on {level}", start, "e")
    if certificate.growth_proven:
        start = time.monotonic()
        task = statements.growth_task(certificate, deadline)
        outcome = statements.prove_on_set(task, deadline)
        growth = f"V stays below {certificate.growth:.6g} V(e) between samples"
        yield finding_of(outcome, f"{growth} on {level}", start, "e")


if __name__ == "__main__":
    sys.exit(main())
