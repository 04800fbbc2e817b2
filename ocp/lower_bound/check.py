"""Check a certificate of a lower bound, without code of the program that wrote it.

    python -m swarmstart.ocp.lower_bound.check FILE [--seconds 600]

This is `python -m swarmstart.terminal_set.check`, which judges certificates of every
kind. Of a lower bound everything is proven again: derivatives come from arithmetic on
truncated Taylor series, not from CasADi, and the bound itself is computed in exact
fractions.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from swarmstart.terminal_set import check


def main(arguments: Sequence[str] | None = None) -> int:
    """Check one file; print a line for each statement, and a verdict.

    Args:
        arguments: Arguments of the command line; None means those of the process.

    Returns:
        The exit code.
    """
    return check.main(arguments, program="python -m swarmstart.ocp.lower_bound.check")


if __name__ == "__main__":
    sys.exit(main())
