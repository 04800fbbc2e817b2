"""The functions of an NLP's intervals, evaluated by machine code for all of them.

IPOPT asks CasADi for an NLP's values and derivatives, which are those of one interval
at N places (nlp_assembly.py). CasADi would interpret their instructions N times. Here
one call of machine code evaluates all intervals, side by side like the individuals of a
population; CasADi gives it the arguments and puts the results in their places.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.compiled.backend import mapped_buffers
from swarmstart.ocp.compiled.engine import NoCompilerError
from swarmstart.ocp.compiled.simd import compile_flat
from swarmstart.ocp.compiled.threads import aside
from swarmstart.tape import UnknownOperationError

MOST_INSTRUCTIONS = 60_000
"""Largest number of instructions of a function that is compiled: it takes LLVM 7 s."""


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
            UnknownOperationError: If the function has an operation that is not
                compiled.
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
        self._free: list[_Buffers] = []
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
        """Evaluate all intervals; an output whose buffer is None is not written."""
        # Two threads may call at once, so buffers are taken and given back.
        try:
            buffers = self._free.pop()
        except IndexError:
            buffers = self._new_buffers()
        # IPOPT asks for cost and rows, or for their slopes, one after the other.
        asked = [_copy(one) for one in given]
        if buffers.given != asked:
            for argument, values in zip(buffers.arguments, asked, strict=True):
                argument[...] = np.frombuffer(values).reshape(argument.shape)
            buffers.run()
            buffers.given = asked
        for output, place in zip(buffers.outputs, found, strict=True):
            if place is not None and output.size:
                np.frombuffer(place).reshape(output.shape)[...] = output
        self._free.append(buffers)
        return 0

    def _new_buffers(self) -> "_Buffers":
        try:
            prepared = self._code.prepare(self._intervals)
        except NoCompilerError:  # LLVM refused it, in the background.
            shared = [i for i, is_own in enumerate(self._is_own) if not is_own]
            mapped = mapped_buffers(self._function, self._intervals, shared)
            return _Buffers(
                mapped.arguments, mapped.results, mapped.run, keeps_alive=mapped
            )
        return _Buffers(
            # CasADi stores column by column: interval after interval.
            [one.T for one in prepared.arguments],
            [one.T for one in prepared.outputs],
            prepared,
        )


@dataclass(slots=True, eq=False)
class _Buffers:
    """Memory, as CasADi orders it, and the code that reads and writes it.

    Attributes:
        arguments: Arguments, (N, entries), or (entries,) if they are the same for all.
        outputs: Outputs, (N, nonzeros).
        run: Function that evaluates the arguments into the outputs.
        given: Arguments from CasADi to which the outputs belong.
        keeps_alive: Objects that `run` calls but does not own.
    """

    arguments: list[Array]
    outputs: list[Array]
    run: Callable[[], None]
    given: list[bytes] = field(default_factory=list)
    keeps_alive: object = None


def _copy(memory: memoryview) -> bytes:
    """Return a copy; CasADi's empty memory has no address to read from."""
    return bytes(memory) if memory.nbytes else b""


def over_intervals(
    function: ca.Function,
    intervals: int,
    same: Sequence[int],
    *,
    apart: Sequence[Sequence[int]],
    compiled: bool,
) -> list[ca.Function]:
    """Return functions that together give the outputs of one function at all intervals.

    Args:
        function: An SX function of one interval.
        intervals: Number of intervals.
        same: Indices of the arguments that are the same for all intervals.
        apart: Numbers of the outputs, in groups that are not needed together; each
            group becomes a function.
        compiled: Whether to make machine code if that is possible. With machine code
            there is one function, which evaluates all outputs at once.
    """
    if compiled:
        try:
            return [IntervalKernel(function, intervals, same)]
        except (NoCompilerError, UnknownOperationError):
            pass  # CasADi evaluates everything.
    return [
        one.map(one.name(), "serial", intervals, list(same), [])
        for one in _separated(function, apart)
    ]


def _separated(
    function: ca.Function, groups: Sequence[Sequence[int]]
) -> list[ca.Function]:
    """Return a function for each group of outputs, without what others need."""
    if len(groups) == 1:
        return [function]
    given = [ca.SX.sym(f"a{i}", *function.size_in(i)) for i in range(function.n_in())]
    outputs = function.call(given)
    return [
        ca.Function(
            f"{function.name()}_{first}",
            given,
            [outputs[first], *[outputs[i] for i in others]],
        )
        for first, *others in groups
    ]
