"""The interface of population evaluators, and the choice of machine code or CasADi.

The choice is `backend`: "llvm", "casadi", or "auto" (None means the same). "auto" takes
the environment's SWARMSTART_BACKEND if it is set, else machine code if that is
possible. If machine code is not possible, CasADi's map evaluates, and one warning says
why.
"""

import os
import warnings
from collections.abc import Callable, Sequence
from typing import Literal, Protocol, get_args

from swarmstart.arrays import Array
from swarmstart.heuristics import Pointers
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.compiled.casadi_map import CasadiMap
from swarmstart.ocp.compiled.engine import NoCompilerError, machine
from swarmstart.ocp.compiled.vectors.vector_ir import FORMATS
from swarmstart.tape import UnknownOperationError

Backend = Literal["auto", "llvm", "casadi"]
BACKENDS = get_args(Backend)
VARIABLE = "SWARMSTART_BACKEND"


class BoundEvaluator(Protocol):
    """An evaluator whose shared arguments are fixed."""

    def __call__(self, population: Array) -> Array:
        """Return all outputs in a new array, shape (rows of all outputs, size).

        Args:
            population: Shape (dim, size), one column an individual; not kept.
        """

    def attach(self, population: Array, outputs: Sequence[Array]) -> Pointers | None:
        """Bind to buffers, for a caller that is compiled itself.

        Args:
            population: Shape (dim, size), contiguous doubles.
            outputs: One for each output, rows * size doubles, contiguous.

        Returns:
            The addresses, valid as long as this object and the buffers live; None if
            it can be called from Python only.
        """


class BatchEvaluator(Protocol):
    """A `casadi.Function` applied to every individual of a population.

    The function's first argument differs per individual, the others are shared by all.
    """

    @property
    def backend(self) -> str:
        """Name of the backend, as recorded with a run."""

    def bind(self, shared: tuple[Array, ...]) -> BoundEvaluator:
        """Return population -> outputs, for fixed other arguments.

        Args:
            shared: The other arguments, flattened column by column; copied.
        """


class BackendWarning(UserWarning):
    """A function is evaluated by CasADi, which is slower, instead of machine code."""


def chosen_backend(backend: str | None = None) -> str:
    """Return the backend that will be tried first: "llvm" or "casadi".

    Args:
        backend: "llvm", "casadi", or "auto" or None, which read the environment.

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
    """Return machine code if it is chosen and possible, else CasADi's map.

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
    """Warn that CasADi's map is used, with the reason."""
    warnings.warn(
        f"populations are evaluated by CasADi, not by machine code: {reason}",
        BackendWarning,
        stacklevel=3,
    )


def require_precision(precision: str) -> None:
    """Validate the name of a precision.

    Raises:
        InvalidProblemError: If there is no such precision.
    """
    if precision not in FORMATS:
        raise InvalidProblemError(
            f"precision must be one of {', '.join(FORMATS)}, got {precision!r}"
        )
