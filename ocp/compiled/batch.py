"""Any CasADi function, applied to a whole population at once.

    evaluate = compile_batch(function)
    y = evaluate(x, p)        x (rows, n): differs per individual; p (rows,): shared

The way in for whoever wants nothing of this package but the evaluator.
"""

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.heuristics import Pointers
from swarmstart.ocp.compiled.backend import chosen_backend, warn_of_casadi
from swarmstart.ocp.compiled.engine import NoCompilerError
from swarmstart.ocp.compiled.simd import SimdBatch, addresses, compile_flat
from swarmstart.ocp.compiled.tape import UnknownOperationError
from swarmstart.ocp.errors import InvalidProblemError

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Prepared:
    """An evaluator bound to fixed buffers: fill, call, read; nothing is allocated.

    Attributes:
        arguments: To be filled in place; shapes as given to `prepare`.
        outputs: To be read after the call, each (rows, n).
        pointers: Addresses of the function and of its two arguments, for a caller that
            is compiled itself: void f(double **in, double **out, int64 n).
        size: n, the third argument.
    """

    arguments: tuple[Array, ...]
    outputs: tuple[Array, ...]
    pointers: Pointers
    size: int
    _kernel: SimdBatch
    _tables: tuple[ctypes.Array[ctypes.c_void_p], ctypes.Array[ctypes.c_void_p]]

    def __call__(self) -> None:
        """Evaluate what is in the arguments into the outputs."""
        self._kernel.call(*self._tables, self.size)


class BatchFunction:
    """A function of populations; made by `compile_batch`.

    Which arguments differ per individual is seen at the call; each combination is
    compiled once.

    Attributes:
        backend: "llvm" or "casadi".
    """

    def __init__(self, function: ca.Function, *, backend: str | None = None) -> None:
        """Take a function; see `compile_batch`."""
        self._function = function
        self._kernels: dict[tuple[bool, ...], SimdBatch] = {}
        self.backend = chosen_backend(backend)
        if self.backend == "llvm":
            try:
                self._function = _expanded(function)
                first = tuple(i == 0 for i in range(function.n_in()))
                self._kernels[first] = compile_flat(self._function, first)
            except (NoCompilerError, UnknownOperationError) as error:
                warn_of_casadi(str(error))
                self.backend = "casadi"

    def __call__(self, *arguments: ArrayLike) -> Array | tuple[Array, ...]:
        """Evaluate the function for n individuals.

        Args:
            arguments: In the function's order, each (rows, n), or (rows,) where all
                individuals share it; rows counts a matrix column by column.

        Returns:
            (rows, n) for one output, a tuple of these for several.

        Raises:
            InvalidProblemError: If numbers or shapes of the arguments do not fit.
        """
        arrays, differs, size = self._checked(arguments)
        if self.backend == "llvm":
            outputs = self._kernel(differs).evaluate(arrays)
        else:
            outputs = self._mapped(arrays, differs, size)
        return outputs[0] if len(outputs) == 1 else tuple(outputs)

    def prepare(self, *arguments: ArrayLike) -> Prepared:
        """Return the function bound to copies of its arguments, for many calls.

        Args:
            arguments: As in a call; n at least the number of lanes (8 at the most).

        Raises:
            InvalidProblemError: If they do not fit, or CasADi evaluates.
        """
        if self.backend != "llvm":
            raise InvalidProblemError("prepare needs machine code, got backend casadi")
        arrays, differs, size = self._checked(arguments)
        kernel = self._kernel(differs)
        if size < kernel.lanes:
            raise InvalidProblemError(
                f"prepare needs at least {kernel.lanes} individuals, got {size}"
            )
        own = tuple(np.array(a, dtype=np.float64, order="C") for a in arrays)
        outputs = tuple(np.empty((rows, size)) for rows in kernel.shape.outputs)
        tables = addresses(own), addresses(outputs)
        return Prepared(
            arguments=own,
            outputs=outputs,
            pointers=Pointers(kernel.address, *map(ctypes.addressof, tables)),
            size=size,
            _kernel=kernel,
            _tables=tables,
        )

    def _kernel(self, differs: tuple[bool, ...]) -> SimdBatch:
        if differs not in self._kernels:
            self._kernels[differs] = compile_flat(self._function, differs)
        return self._kernels[differs]

    def _checked(
        self, arguments: Sequence[ArrayLike]
    ) -> tuple[list[Array], tuple[bool, ...], int]:
        """Return the arguments as arrays, which differ per individual, and n."""
        f = self._function
        if len(arguments) != f.n_in():
            raise InvalidProblemError(
                f"{f.name()} takes {f.n_in()} arguments, got {len(arguments)}"
            )
        arrays = [np.asarray(a, dtype=np.float64) for a in arguments]
        sizes = {a.shape[1] for a in arrays if a.ndim == 2}  # noqa: PLR2004
        if len(sizes) != 1:
            raise InvalidProblemError(
                "expected one number of individuals n in the arguments (rows, n), "
                f"got {sorted(sizes) or 'none of that shape'}"
            )
        for number, array in enumerate(arrays):
            rows = f.numel_in(number)
            if array.ndim not in (1, 2) or array.shape[0] != rows:
                raise InvalidProblemError(
                    f"argument {number} of {f.name()} must have shape ({rows}, n) or "
                    f"({rows},), got {array.shape}"
                )
        return arrays, tuple(a.ndim == 2 for a in arrays), sizes.pop()  # noqa: PLR2004

    def _mapped(
        self, arrays: list[Array], differs: tuple[bool, ...], size: int
    ) -> list[Array]:
        """Evaluate by CasADi's map: individuals side by side, in matrices."""
        f = self._function
        if size == 0:
            return [np.empty((f.numel_out(i), 0)) for i in range(f.n_out())]
        given = []
        for number, array in enumerate(arrays):
            own = array if differs[number] else np.repeat(array[:, None], size, axis=1)
            rows, columns = f.size_in(number)
            given.append(np.reshape(own, (rows, columns * size), order="F"))
        answers = f.map(size).call(given)
        return [
            np.reshape(np.array(ca.DM(a)), (f.numel_out(i), size), order="F")
            for i, a in enumerate(answers)
        ]


def compile_batch(
    function: ca.Function, *, backend: str | None = None
) -> BatchFunction:
    """Return a function of whole populations, in machine code where possible.

    Args:
        function: Any `casadi.Function` that expands to SX; where it does not, or has an
            operation that is not compiled, CasADi's map serves, and a warning says so.
        backend: "auto", "llvm" or "casadi"; None asks SWARMSTART_BACKEND, then auto.

    Returns:
        (arrays (rows, n), or (rows,) where shared) -> (rows, n), or a tuple of these.

    Raises:
        InvalidProblemError: If the function has no argument, or the backend is unknown.
    """
    if function.n_in() == 0:
        raise InvalidProblemError(f"{function.name()} has no argument to vary")
    return BatchFunction(function, backend=backend)


def _expanded(function: ca.Function) -> ca.Function:
    """Return a function as SX.

    Raises:
        UnknownOperationError: If it cannot be expanded.
    """
    if function.is_a("SXFunction"):
        return function
    try:
        return function.expand()
    except RuntimeError as error:
        raise UnknownOperationError(
            f"{function.name()} does not expand to SX"
        ) from error
