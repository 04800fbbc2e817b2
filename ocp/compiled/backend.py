"""Which evaluator serves a problem: machine code, or CasADi where that cannot.

The choice is `backend`: "llvm", "casadi", or "auto" (None means the same): what the
environment's SWARMSTART_BACKEND says, else machine code where possible. Where machine
code cannot serve, CasADi's map evaluates, and a warning says once which and why.
"""

import os
import warnings
from collections.abc import Callable
from typing import Literal, get_args

from swarmstart.ocp.compiled.casadi_map import CasadiMap
from swarmstart.ocp.compiled.engine import NoCompilerError, machine
from swarmstart.ocp.compiled.formats import FORMATS
from swarmstart.ocp.compiled.interface import BatchEvaluator
from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.tape import UnknownOperationError

Backend = Literal["auto", "llvm", "casadi"]
BACKENDS = get_args(Backend)
VARIABLE = "SWARMSTART_BACKEND"


class BackendWarning(UserWarning):
    """CasADi evaluates, slower, what was to be compiled."""


def chosen_backend(backend: str | None = None) -> str:
    """Return "llvm" or "casadi": what will be tried first here.

    Args:
        backend: "llvm", "casadi", or "auto" or None, which ask the environment.

    Raises:
        InvalidProblemError: If it is none of these.
    """
    asked = backend or "auto"
    if asked == "auto":
        asked = os.environ.get(VARIABLE) or "auto"
    if asked not in BACKENDS:
        raise InvalidProblemError(
            f"backend (or {VARIABLE}) must be one of {', '.join(BACKENDS)}, "
            f"got {asked!r}"
        )
    if asked == "casadi":
        return asked
    try:
        machine()
    except NoCompilerError as error:
        warn_of_casadi(str(error))
        return "casadi"
    return "llvm"


def evaluator(
    compiled: Callable[[], BatchEvaluator],
    mapped: Callable[[], CasadiMap],
    backend: str | None = None,
) -> BatchEvaluator:
    """Return machine code where it is asked for and possible, else CasADi's map.

    Args:
        compiled: Makes the machine code.
        mapped: Makes the map.
        backend: As in `chosen_backend`.
    """
    if chosen_backend(backend) == "casadi":
        return mapped()
    try:
        return compiled()
    except (NoCompilerError, UnknownOperationError) as error:
        warn_of_casadi(str(error))
        return mapped()


def warn_of_casadi(reason: str) -> None:
    """Say which evaluator serves, and why it is not machine code."""
    warnings.warn(
        f"populations are evaluated by CasADi, not by machine code: {reason}",
        BackendWarning,
        stacklevel=3,
    )


def require_precision(precision: str) -> None:
    """Refuse what is no precision.

    Raises:
        InvalidProblemError: With what is allowed.
    """
    if precision not in FORMATS:
        raise InvalidProblemError(
            f"precision must be one of {', '.join(FORMATS)}, got {precision!r}"
        )
