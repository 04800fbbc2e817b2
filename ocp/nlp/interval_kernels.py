"""The functions of an NLP's intervals, evaluated by machine code for all of them.

IPOPT asks CasADi for an NLP's values and derivatives, which are those of one interval
at N places (nlp_assembly.py). CasADi would interpret their instructions N times. Here
one call of machine code evaluates all intervals, side by side like the individuals of a
population; CasADi gives it the arguments and puts the results in their places.
"""

from collections.abc import Collection, Sequence

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.compiled.engine import NoCompilerError
from swarmstart.ocp.compiled.simd import Prepared, compile_flat
from swarmstart.ocp.compiled.threads import aside
from swarmstart.tape import UnknownOperationError

MOST_INSTRUCTIONS = 50_000
"""Largest number of instructions of a function that is compiled: it takes LLVM 5 s."""


class IntervalKernel(ca.Callback):
    """A function of one interval, applied to N intervals by machine code.

    Its arguments and outputs are those of `Function.map`: side by side, except for
    arguments that are the same for all intervals. It must live as long as the functions
    that call it.
    """

    def __init__(
        self, function: ca.Function, intervals: int, same: Collection[int]
    ) -> None:
        """Compile the function, in the background.

        Args:
            function: An SX function.
            intervals: Number of intervals N.
            same: Indices of the arguments that are the same for all intervals.

        Raises:
            UnknownOperationError: If it has an operation that is not compiled.
            NoCompilerError: If machine code cannot be made here, or would be too long.
        """
        super().__init__()
        count = function.n_instructions()
        if count > MOST_INSTRUCTIONS:
            raise NoCompilerError(
                f"expected at most {MOST_INSTRUCTIONS} instructions, found {count}"
            )
        self._function, self._intervals = function, intervals
        self._is_own = tuple(i not in same for i in range(function.n_in()))
        with aside():
            self._code = compile_flat(
                function, self._is_own, nonzeros=True, quickly=True
            )
        self._free: list[Prepared] = []
        self.construct(function.name(), {})  # Last: CasADi asks for the shapes at once.

    def get_n_in(self) -> int:
        """Return the number of arguments."""
        return int(self._function.n_in())

    def get_n_out(self) -> int:
        """Return the number of outputs."""
        return int(self._function.n_out())

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Return the shape of an argument."""
        one = self._function.sparsity_in(i)
        return ca.repmat(one, 1, self._intervals) if self._is_own[i] else one

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        """Return the shape of an output."""
        return ca.repmat(self._function.sparsity_out(i), 1, self._intervals)

    def has_eval_buffer(self) -> bool:
        """Return True: it reads and writes CasADi's memory."""
        return True

    def eval_buffer(
        self, given: Sequence[memoryview], found: Sequence[memoryview | None]
    ) -> int:
        """Evaluate all intervals; outputs that are None are not wanted."""
        # Two threads may call at once, so buffers are taken and given back.
        prepared = self._free.pop() if self._free else self._code.prepare(
            self._intervals
        )  # fmt: skip
        for buffer, memory in zip(prepared.arguments, given, strict=True):
            # CasADi stores column by column: interval after interval.
            buffer.T[...] = _array(memory, buffer.T.shape)
        prepared.run()
        for buffer, memory in zip(prepared.outputs, found, strict=True):
            if memory is not None:
                _array(memory, buffer.T.shape)[...] = buffer.T
        self._free.append(prepared)
        return 0


def _array(memory: memoryview, shape: tuple[int, ...]) -> Array:
    """Return CasADi's memory as an array; empty memory cannot be shared."""
    if memory.nbytes == 0:
        return np.empty(shape)
    return np.frombuffer(memory).reshape(shape)


def over_intervals(
    function: ca.Function, intervals: int, same: Sequence[int], *, compiled: bool
) -> ca.Function:
    """Return a function of one interval for all of them, as machine code if possible.

    Args:
        function: An SX function.
        intervals: Number of intervals.
        same: Indices of the arguments that are the same for all intervals.
        compiled: Whether machine code is wanted.
    """
    if compiled:
        try:
            return IntervalKernel(function, intervals, same)
        except (NoCompilerError, UnknownOperationError):
            pass  # CasADi evaluates everything.
    return function.map(function.name(), "serial", intervals, list(same), [])
