"""The instructions of an SX function as single static assignments.

CasADi evaluates an SX function by a list of instructions on a work vector whose entries
are overwritten. Here every value gets its own number, equal values share one (value
numbering), and values that no output needs are left out. CasADi has already folded the
constants.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import casadi as ca

OPERATIONS: dict[int, str] = {
    getattr(ca, f"OP_{name.upper()}"): name
    for name in (
        "add sub mul div neg exp log pow constpow sqrt sq twice sin cos tan asin acos "
        "atan lt le eq ne not and or floor ceil fmod fabs sign copysign if_else_zero "
        "erf fmin fmax inv sinh cosh tanh asinh acosh atanh atan2 log1p expm1 hypot "
        "remainder assign lift"
    ).split()
}
"""CasADi's operation code -> name, for all operations that a tape may hold."""

COMMUTATIVE = frozenset(("add", "mul", "eq", "ne", "and", "or"))


class UnknownOperationError(Exception):
    """An operation that is unknown to the reader or to a user of the tape.

    Attributes:
        operation: Name of the operation; empty if the function has no tape at all.
    """

    def __init__(self, message: str, operation: str = "") -> None:
        """Keep the name beside the message."""
        super().__init__(message)
        self.operation = operation


@dataclass(frozen=True, slots=True)
class Node:
    """One value of a tape.

    Attributes:
        operation: A name of OPERATIONS, "input" or "constant".
        arguments: Numbers of the values that this one is computed from; (argument,
            nonzero) for an input; empty for a constant.
        value: The constant.
    """

    operation: str
    arguments: tuple[int, ...] = ()
    value: float = 0.0


@dataclass(frozen=True, kw_only=True, slots=True)
class Tape:
    """SX function as a list of values, each after those it is computed from.

    Attributes:
        nodes: All values; a value's number is its index.
        outputs: For each output the number of the value at each dense entry, column by
            column.
        inputs: Number of dense entries of each argument.
    """

    nodes: tuple[Node, ...]
    outputs: tuple[tuple[int, ...], ...]
    inputs: tuple[int, ...]

    def users(self) -> list[int]:
        """Return how many values and outputs use each value."""
        counts = [0] * len(self.nodes)
        for node in self.nodes:
            if node.operation != "input":
                for argument in node.arguments:
                    counts[argument] += 1
        for output in self.outputs:
            for number in output:
                counts[number] += 1
        return counts


class TapeBuilder:
    """Builder of a tape, which gives equal values one number.

    Attributes:
        nodes: The values so far.
    """

    def __init__(self) -> None:
        """Begin an empty tape."""
        self.nodes: list[Node] = []
        self._numbers: dict[tuple[object, ...], int] = {}

    def number(self, node: Node) -> int:
        """Return the number of a value, a new number for a new value."""
        # Compared by repr: 0.0 and -0.0 must differ, and one NaN must equal another.
        key = (node.operation, node.arguments, repr(node.value))
        if key not in self._numbers:
            self._numbers[key] = len(self.nodes)
            self.nodes.append(node)
        return self._numbers[key]

    def apply(self, operation: str, arguments: tuple[int, ...]) -> int:
        """Return the number of an operation's result."""
        if operation in ("assign", "lift"):
            return arguments[0]
        if operation in COMMUTATIVE:
            arguments = tuple(sorted(arguments))
        return self.number(Node(operation, arguments))

    def rewritten(
        self, tape: Tape, write: Callable[[Node, tuple[int, ...]], int]
    ) -> Tape:
        """Return a copy of a tape with each operation replaced by `write`.

        Args:
            tape: The tape to copy.
            write: Function (node of an operation, new numbers of its arguments) -> new
                number of its result.
        """
        numbers: list[int] = []
        for node in tape.nodes:
            if node.operation in ("input", "constant"):
                numbers.append(self.number(node))
            else:
                numbers.append(write(node, tuple(numbers[a] for a in node.arguments)))
        outputs = [[numbers[number] for number in output] for output in tape.outputs]
        return self.tape(outputs, tape.inputs)

    def tape(self, outputs: Sequence[Sequence[int]], inputs: tuple[int, ...]) -> Tape:
        """Return the tape, without the values that no output needs.

        Args:
            outputs: As in `Tape`.
            inputs: As in `Tape`.
        """
        needed = {number for output in outputs for number in output}
        for number in range(len(self.nodes) - 1, -1, -1):
            if number in needed and self.nodes[number].operation != "input":
                needed.update(self.nodes[number].arguments)
        renumbered = {old: new for new, old in enumerate(sorted(needed))}
        return Tape(
            nodes=tuple(_renumbered(self.nodes, sorted(needed), renumbered)),
            outputs=tuple(tuple(renumbered[n] for n in output) for output in outputs),
            inputs=inputs,
        )


def expanded(function: ca.Function) -> ca.Function:
    """Return a function as SX.

    Args:
        function: A function of SX or of MX.

    Raises:
        UnknownOperationError: If the function cannot be written in SX.
    """
    if function.is_a("SXFunction"):
        return function
    try:
        return function.expand()
    except RuntimeError as error:
        raise UnknownOperationError(
            f"{function.name()} does not expand to SX"
        ) from error


def read_tape(function: ca.Function, *, nonzeros: bool = False) -> Tape:
    """Return the tape of an SX function.

    Args:
        function: A function with SX instructions (`Function.is_a("SXFunction")`), whose
            inputs and outputs may be sparse.
        nonzeros: Whether only the nonzeros of the outputs are listed, in CasADi's
            order.

    Raises:
        UnknownOperationError: If the function has an operation that is not in
            OPERATIONS.
    """
    if not function.is_a("SXFunction"):
        raise UnknownOperationError(f"{function.name()} is no SX function")
    builder = TapeBuilder()
    work: dict[int, int] = {}
    zero = builder.number(Node("constant", (), 0.0))
    entries = function.nnz_out if nonzeros else function.numel_out
    outputs = [[zero] * entries(i) for i in range(function.n_out())]
    dense_in = [_dense_entries(function.sparsity_in(i)) for i in range(function.n_in())]
    places = [
        range(function.nnz_out(i))
        if nonzeros
        else _dense_entries(function.sparsity_out(i))
        for i in range(function.n_out())
    ]
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        source = function.instruction_input(k)
        target = function.instruction_output(k)
        if code == ca.OP_INPUT:
            place = (source[0], dense_in[source[0]][source[1]])
            work[target[0]] = builder.number(Node("input", place))
        elif code == ca.OP_OUTPUT:
            outputs[target[0]][places[target[0]][target[1]]] = work[source[0]]
        elif code == ca.OP_CONST:
            value = float(function.instruction_constant(k))
            work[target[0]] = builder.number(Node("constant", (), value))
        elif code in OPERATIONS:
            arguments = tuple(work[s] for s in source)
            work[target[0]] = builder.apply(OPERATIONS[code], arguments)
        else:
            name = _name(code)
            raise UnknownOperationError(
                f"{function.name()} has the operation {name}, which is unknown", name
            )
    inputs = tuple(function.numel_in(i) for i in range(function.n_in()))
    return builder.tape(outputs, inputs)


def _name(code: int) -> str:
    """Return CasADi's name of an operation, or its number."""
    names = (name for name in dir(ca) if name.startswith("OP_"))
    found = (name for name in names if getattr(ca, name) == code)
    return next(found, f"OP_{code}").removeprefix("OP_").lower()


def _dense_entries(sparsity: ca.Sparsity) -> list[int]:
    """Return the dense index, column by column, of each nonzero."""
    return [int(i) for i in sparsity.find()]


def _renumbered(
    nodes: list[Node], kept: list[int], numbers: dict[int, int]
) -> Iterator[Node]:
    for old in kept:
        node = nodes[old]
        if node.operation == "input":
            yield node
        else:
            arguments = tuple(numbers[a] for a in node.arguments)
            yield Node(node.operation, arguments, node.value)
