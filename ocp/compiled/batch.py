"""Any CasADi function, applied to a whole population at once.

    evaluate = compile_batch(function)
    y = evaluate(x, p)        x (rows, n): differs per individual; p (rows,): shared

Entry point for users who only need the evaluator.
"""

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    FLAG,
    a_count,
    checked,
    choice,
    of_kind,
    optional,
    reals,
    text,
)
from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.pickling import Called
from swarmstart.ocp.compiled.backend import (
    MappedBuffers,
    chosen_backend,
    mapped_buffers,
    warn_of_casadi,
)
from swarmstart.ocp.compiled.engine import NoCompilerError
from swarmstart.ocp.compiled.simd import (
    InPlace,
    Prepared,
    Shapes,
    SimdBatch,
    compile_flat,
    split,
)
from swarmstart.ocp.compiled.vectors.vector_ir import FORMATS, Precision
from swarmstart.tape import UnknownOperationError, expanded

_OPTIONS = {
    "function": of_kind(ca.Function, "a casadi.Function"),
    "backend": optional(text()),
    "precision": choice(FORMATS),
    "threads": a_count(least=1),
}


@checked(refused, **_OPTIONS)
class BatchFunction(Called):
    """A function of populations; made by `compile_batch`.

    The shapes at a call show which arguments differ per individual; each combination
    is compiled once. Buffers are reused, so one object must not be called from two
    threads at once.

    Attributes:
        backend: "llvm" or "casadi".
    """

    def __init__(
        self,
        function: ca.Function,
        *,
        backend: str | None = None,
        precision: Precision = "double",
        threads: int = 1,
    ) -> None:
        """Prepare the evaluation of a function; see `compile_batch`."""
        self._function, self._precision, self._threads = function, precision, threads
        self._rows = tuple(map(function.numel_out, range(function.n_out())))
        self._kernels: dict[tuple[bool, ...], SimdBatch] = {}
        self._small: dict[Shapes, Prepared] = {}
        self._large: dict[Shapes, InPlace] = {}
        self._maps: dict[tuple[tuple[bool, ...], int], MappedBuffers] = {}
        self.backend = chosen_backend(backend)
        if self.backend == "llvm":
            try:
                self._function = expanded(function)
                # Most calls vary the first argument only. It is compiled here, so that
                # a function that cannot be compiled shows at once.
                first = tuple(i == 0 for i in range(function.n_in()))
                self._kernel(first)
            except (NoCompilerError, UnknownOperationError) as error:
                warn_of_casadi(str(error))
                self.backend = "casadi"

    def __call__(self, *arguments: ArrayLike) -> Array | tuple[Array, ...]:
        """Evaluate the function for n individuals.

        Args:
            arguments: In the function's order, each (rows, n), or (rows,) if all
                individuals share it; a matrix is flattened column by column.

        Returns:
            (rows, n) for one output, a tuple of these for several.

        Raises:
            InvalidProblemError: If number or shapes of the arguments do not fit.
        """
        arrays = _numbers(arguments)
        shapes = tuple([a.shape for a in arrays])
        small, large = self._small.get(shapes), self._large.get(shapes)
        if large is not None:
            outputs = split(large(arrays), self._rows)
        elif small is not None:
            for buffer, given in zip(small.arguments, arrays, strict=True):
                buffer[...] = given
            small.run()
            # The next call writes into the same buffers.
            outputs = small.split(small.results.copy())
        else:
            outputs = self._evaluate(arrays, shapes)
        return outputs[0] if len(outputs) == 1 else outputs

    def _evaluate(self, arrays: list[Array], shapes: Shapes) -> tuple[Array, ...]:
        """Evaluate arguments that are large or have new shapes."""
        differs, size = self._checked(arrays)
        if self.backend == "casadi":
            return self._mapped(arrays, differs, size)
        kernel = self._kernel(differs)
        if kernel.is_small(arrays):
            self._small[shapes] = kernel.prepare(size)
        else:
            self._large[shapes] = InPlace(kernel, size)
        return kernel.evaluate(arrays)

    def prepare(self, *arguments: ArrayLike) -> Prepared:
        """Return the function bound to copies of its arguments, for many calls.

        Args:
            arguments: Arguments as in a call.

        Raises:
            InvalidProblemError: If the arguments do not fit, or the backend is CasADi.
        """
        if self.backend != "llvm":
            raise InvalidProblemError("prepare needs machine code, got backend casadi")
        arrays = _numbers(arguments)
        differs, size = self._checked(arrays)
        prepared = self._kernel(differs).prepare(size)
        for buffer, given in zip(prepared.arguments, arrays, strict=True):
            buffer[...] = given
        return prepared

    def _kernel(self, differs: tuple[bool, ...]) -> SimdBatch:
        if differs not in self._kernels:
            self._kernels[differs] = compile_flat(
                self._function,
                differs,
                precision=self._precision,
                threads=self._threads,
            )
        return self._kernels[differs]

    def _checked(self, arrays: Sequence[Array]) -> tuple[tuple[bool, ...], int]:
        """Return which arguments differ per individual, and n."""
        f = self._function
        if len(arrays) != f.n_in():
            raise InvalidProblemError(
                f"{f.name()} takes {f.n_in()} arguments, got {len(arrays)}"
            )
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
        return tuple(a.ndim == 2 for a in arrays), sizes.pop()  # noqa: PLR2004

    def _mapped(
        self, arrays: list[Array], differs: tuple[bool, ...], size: int
    ) -> tuple[Array, ...]:
        """Evaluate by CasADi's map: individuals side by side, in matrices."""
        # CasADi cannot map a function 0 times.
        if size == 0:
            return tuple(np.empty((rows, 0)) for rows in self._rows)
        buffers = self._maps.get((differs, size))
        if buffers is None:
            shared = [i for i, own in enumerate(differs) if not own]
            buffers = mapped_buffers(densified(self._function), size, shared)
            self._maps[differs, size] = buffers
        for buffer, array in zip(buffers.arguments, arrays, strict=True):
            np.copyto(buffer, array.T)
        buffers.run()
        return tuple(result.T.copy() for result in buffers.results)


def densified(function: ca.Function) -> ca.Function:
    """Return a function whose arguments and outputs are dense."""
    given = [ca.MX.sym(f"a{i}", *function.size_in(i)) for i in range(function.n_in())]
    outputs = map(ca.densify, function.call(given))
    return ca.Function(function.name(), given, [*outputs])


def _numbers(arguments: Sequence[ArrayLike]) -> list[Array]:
    """Return arguments as arrays; real numbers only, as the buffers hold no others."""
    try:
        arrays = [np.asarray(a) for a in arguments]
    except ValueError as error:
        raise refused("arguments", arguments, reals().allowed) from error
    for array in arrays:
        if array.dtype.kind not in "biuf":
            raise refused("arguments", array, reals().allowed)
    return arrays


@checked(refused, **_OPTIONS, gradient=FLAG)
def compile_batch(
    function: ca.Function,
    *,
    backend: str | None = None,
    precision: Precision = "double",
    threads: int = 1,
    gradient: bool = False,
) -> BatchFunction:
    """Return a function of whole populations, in machine code where possible.

    Args:
        function: Any `casadi.Function` that expands to SX; if it does not, or has an
            operation that is not compiled, CasADi's map serves, and a warning says so.
        backend: "auto", "llvm" or "casadi"; None means SWARMSTART_BACKEND if it is set,
            else "auto".
        precision: "double", or "single", which computes with half the digits in less
            than half the time; arguments and outputs are doubles in both cases. CasADi
            always computes in double precision.
        threads: Largest number of threads over which machine code spreads a population;
            a thread pays from about 256 individuals on. The results have the same bits
            for any number of threads. CasADi's map uses one thread.
        gradient: Whether to add an output: the gradient of the first output, which must
            be a number, by the first argument, shape (rows, n). It is computed in
            reverse mode.

    Returns:
        A function of arrays (rows, n), or (rows,) if shared, that returns an array
        (rows, n), or a tuple of them for several outputs.

    Raises:
        InvalidProblemError: If the function has no argument, the backend or the
            precision is unknown, threads is not a positive integer, or the gradient
            does not exist.

    Example:
        >>> import casadi as ca
        >>> import numpy as np
        >>> import swarmstart as ss
        >>> x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
        >>> f = ca.Function("f", [x, p], [p * ca.sumsqr(x)])
        >>> evaluate = ss.compile_batch(f)
        >>> evaluate(np.array([[0.0, 1.0, 2.0], [0.0, 1.0, 1.0]]), [10.0]).tolist()
        [[0.0, 20.0, 50.0]]
    """
    if function.n_in() == 0:
        raise InvalidProblemError(f"{function.name()} has no argument to vary")
    if gradient:
        function = with_gradient(function)
    return BatchFunction(
        function, backend=backend, precision=precision, threads=threads
    )


def with_gradient(function: ca.Function) -> ca.Function:
    """Return a function with one more output: the gradient of its first output.

    Args:
        function: A function of SX or MX. Its first output, a scalar, is differentiated
            by its first argument.

    Raises:
        InvalidProblemError: If the first output is no scalar, or CasADi cannot
            differentiate the function.
    """
    size = function.size_out(0) if function.n_out() else (0, 0)
    if size != (1, 1):
        raise InvalidProblemError(
            f"a gradient is of a number: the first output of {function.name()} has "
            f"shape {size}"
        )
    kind: Any = ca.SX
    try:
        function = expanded(function)
    except UnknownOperationError:
        kind = ca.MX  # It is not compiled then, but has a gradient.
    inputs = [
        kind.sym(function.name_in(i), function.sparsity_in(i))
        for i in range(function.n_in())
    ]
    outputs = function.call(inputs)
    try:
        slope = ca.densify(ca.gradient(outputs[0], inputs[0]))
        return ca.Function(function.name(), inputs, [*outputs, ca.vec(slope)])
    except RuntimeError as error:
        raise InvalidProblemError(
            f"CasADi cannot differentiate {function.name()}"
        ) from error
