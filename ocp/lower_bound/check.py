"""Check a certificate of a lower bound, without code of the program that wrote it.

    python -m swarmstart.ocp.lower_bound.check FILE [--seconds 600]

Everything that the bound rests on is proven again, by branch and bound with Taylor
models in place of the library's intervals, derivatives by their truncated arithmetic in
place of CasADi's, and the bound itself in exact fractions. The file may contain only
statements in the words of the format; one line for each says whether it was proven.
Nothing in the file is executed or printed unescaped.

Exit codes: 0 everything was proven again; 2 the file or the call is invalid; 3 refused:
a statement is false or the file was changed; 4 undecided in the time given; 5 the file
cannot be read; 130 interrupted.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from swarmstart.terminal_set.checker import checked, parsed
from swarmstart.terminal_set.checker.lower_bound.certificate_file import (
    Certificate,
    read_certificate,
)
from swarmstart.terminal_set.checker.lower_bound.statements import findings


def main(arguments: Sequence[str] | None = None) -> int:
    """Check one file; print a line for each statement, and a verdict.

    Args:
        arguments: Arguments of the command line; None means those of the process.

    Returns:
        The exit code.
    """
    options = parsed(
        arguments,
        program="python -m swarmstart.ocp.lower_bound.check",
        description="Check a certificate of a lower bound.",
    )
    return checked(
        options,
        read=read_certificate,
        judged=lambda certificate: findings(certificate, seconds=options.seconds),
        said=_said,
    )


def _said(certificate: Certificate, sampled: Sequence[str]) -> str:
    del sampled  # All of it is proven.
    bound, sense = certificate.bound, certificate.problem.sense
    if sense < 0.0:
        return f"proven again: no admissible answer is worth more than {-bound:.12g}"
    return f"proven again: no admissible answer costs less than {bound:.12g}"


if __name__ == "__main__":
    sys.exit(main())
