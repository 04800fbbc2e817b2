"""LLVM IR of a tape: the population as vectors, the horizon as a loop.

A tape is the list of a function's operations. Its code is flat (every operation once)
or rolled: one stage in a loop over the intervals of a horizon, so that neither code nor
build time grow with the horizon. frame.py describes what a kernel reads and writes.

The tape is simplified first: multiples of one value in a sum are merged. CasADi keeps
sums as they are written: the classical Runge-Kutta step of a constant rate k is
h/6 (((k + 2 k) + 2 k) + k). Here it becomes h k. The last stage, too, is evaluated at
x + h k, so that a sine of this state is computed only once. This removes some
roundings. Multiples are merged only if they have one sign, so that nothing cancels, and
if nothing else uses the partial sum.

Steps of adaptive length are a loop of their own, until all individuals are done. Each
turn of the loop is a tick, in which every individual tries one step
(integration/rodas.py); a tick changes nothing for an individual that is done.
"""

import math
from collections import Counter
from dataclasses import dataclass

from swarmstart.ocp.compiled.frame import Frame, Target, module_of
from swarmstart.ocp.compiled.vectors.operations import Read, emit_operation, emit_tape
from swarmstart.ocp.compiled.vectors.vector_ir import Loop, VectorIR
from swarmstart.tape import Node, Tape, TapeBuilder


@dataclass(frozen=True, kw_only=True, slots=True)
class Ticks:
    """Steps of adaptive length between checks; a tick tries one (integration/rodas.py).

    Attributes:
        tick: Function (z, u, p, s) -> z after one trial step, with controls u,
            parameters p, and signals s at two checks, one after the other. z is (y,
            largest |y| so far, time left, step size h), with y the states and the
            integrals; time left and h are fractions of the time between two checks.
        checks: Number of checks in an interval.
        first: Step size h at the beginning of an interval.
        most: Largest number of trial steps between two checks.
    """

    tick: Tape
    checks: int
    first: float
    most: int


@dataclass(frozen=True, kw_only=True, slots=True)
class Roll:
    """A rollout: a stage applied N times, then the terms of the end.

    Attributes:
        stage: Function (x, u, p, s) -> (x after, cost, violation), with states x,
            controls u, parameters p, and signals s, flat over the nodes of one
            interval. With steps of adaptive length it has two more arguments: the
            states that these steps reach at each check, and the integrals.
        end: (x, p, s) -> (cost, violation), s at the last node.
        intervals: Number of intervals N.
        signals_per_interval: Offset to the signals of the next interval, ns * checks.
        decided: For each state, None if it starts at x0. If its initial value is
            decided: the number of this value among the decisions after the controls.
        begin: (x, p, s) -> (cost, violation) at the start, s at the first node; None if
            nothing is added there.
        ticks: Steps of adaptive length; None if the stage contains the integrator.
    """

    stage: Tape
    end: Tape
    intervals: int
    signals_per_interval: int
    decided: tuple[int | None, ...]
    begin: Tape | None = None
    ticks: Ticks | None = None


def emit_flat(tape: Tape, *, per_individual: tuple[bool, ...], target: Target) -> str:
    """Return the IR module of a function applied to a population.

    Args:
        tape: The function.
        per_individual: For each argument whether it differs per individual.
        target: Processor and precision that code is emitted for.

    Raises:
        UnknownOperationError: If the tape has an operation that cannot be emitted.
    """

    def body(frame: Frame) -> None:
        def read(argument: int, entry: int) -> str:
            if per_individual[argument]:
                return frame.load_row(argument, str(entry))
            return frame.load_shared(argument, str(entry))

        values = emit_tape(frame.ir, tape, read)
        for output, numbers in enumerate(tape.outputs):
            for row, number in enumerate(numbers):
                frame.store_row(output, row, values[number])

    return module_of(body, target, inputs=len(tape.inputs), outputs=len(tape.outputs))


def emit_rollout(roll: Roll, *, target: Target) -> str:
    """Return the IR module of (decisions, x0, p, signals) -> (cost, violation).

    The violation is infinity unless the sums of costs and of violations are finite.

    Args:
        roll: The rollout; only the decisions differ per individual.
        target: Processor and precision that code is emitted for.

    Raises:
        UnknownOperationError: If a tape has an operation that cannot be emitted.
    """
    return module_of(lambda frame: _emit_roll(frame, roll), target, inputs=4, outputs=2)


def _emit_roll(frame: Frame, roll: Roll) -> None:
    """Emit the loop over the intervals, then the end."""
    ir, nx, stage = frame.ir, len(roll.decided), roll.stage
    first = roll.intervals * stage.inputs[1]
    state = [
        frame.load_shared(1, str(i)) if row is None
        else frame.load_row(0, str(first + row))
        for i, row in enumerate(roll.decided)
    ]  # fmt: skip
    # Computed once before the loop; then each turn takes them over from the last one.
    repeated = repeated_functions(stage)
    known = [
        emit_operation(ir, stage.nodes[now].operation, [state[i]])
        for i, now, _ in repeated
    ]
    sums = [ir.constant(0.0)] * 2
    if roll.begin is not None:
        sums = _sums(frame, roll.begin, state, 0)
    loop = Loop(ir, [*state, *sums, *known], roll.intervals)
    *state, cost, violation = loop.carried[: nx + 2]
    known = loop.carried[nx + 2 :]
    given = {now: value for (_, now, _), value in zip(repeated, known, strict=True)}

    read = _stage_reader(frame, roll, loop.k, state)
    if roll.ticks is not None:
        read = with_steps(read, stepped(frame, roll.ticks, read, state))
    values = emit_tape(ir, stage, read, given)
    after, (spent,), (broken,) = ([values[n] for n in out] for out in stage.outputs)
    cost, violation = ir.add(cost, spent), ir.add(violation, broken)
    following = [values[later] for _, _, later in repeated]
    loop.close([*after, cost, violation, *following])

    last = roll.intervals * roll.signals_per_interval
    end_cost, end_violation = _sums(frame, roll.end, after, last)
    cost, violation = ir.add(cost, end_cost), ir.add(violation, end_violation)
    frame.store_row(0, 0, cost)
    frame.store_row(1, 0, _unless_finite(ir, cost, violation))


def _sums(frame: Frame, tape: Tape, state: list[str], first: int) -> list[str]:
    """Emit (x, p, s) -> (cost, violation), s the signals from a number on."""

    def read(argument: int, entry: int) -> str:
        if argument == 0:
            return state[entry]
        if argument == 1:
            return frame.load_shared(2, str(entry))
        return frame.load_shared(3, str(first + entry))

    values = emit_tape(frame.ir, tape, read)
    return [values[number] for (number,) in tape.outputs]


def _unless_finite(ir: VectorIR, cost: str, violation: str) -> str:
    """Return the violation; infinity unless it and the cost are finite numbers."""
    infinity = ir.constant(math.inf)
    both = ir.add(ir.intrinsic("fabs", cost), violation)
    # An ordered comparison is false for NaN.
    return ir.select(ir.compare("olt", both, infinity), violation, infinity)


def _stage_reader(frame: Frame, roll: Roll, k: str, state: list[str]) -> Read:
    """Return the reader of the stage's arguments in interval k."""
    ir = frame.ir
    u_row = ir.emit(f"mul i64 {k}, {roll.stage.inputs[1]}")
    s_first = ir.emit(f"mul i64 {k}, {roll.signals_per_interval}")

    def read(argument: int, entry: int) -> str:
        if argument == 0:
            return state[entry]
        if argument == 1:
            return frame.load_row(0, ir.emit(f"add i64 {u_row}, {entry}"))
        if argument == 2:  # noqa: PLR2004 - x, u, p, s
            return frame.load_shared(2, str(entry))
        return frame.load_shared(3, ir.emit(f"add i64 {s_first}, {entry}"))

    return read


def simplified(tape: Tape) -> Tape:
    """Return a tape with the multiples of one value in each sum merged."""
    users = tape.users()
    sums = _Sums()

    def write(node: Node, arguments: tuple[int, ...]) -> int:
        inner = tuple(
            number
            for number, a in zip(arguments, node.arguments, strict=True)
            if users[a] == 1
        )
        return sums.value(node.operation, arguments, inner)

    return sums.rewritten(tape, write)


def with_inverses(tape: Tape) -> Tape:
    """Return a tape that inverts a value once if it divides by it several times.

    CasADi turns each product with an inverse into a quotient; elimination, whose pivots
    divide rows and columns, has many of them. A division takes a processor ten times as
    long as a product.
    """
    divided = Counter(n.arguments[1] for n in tape.nodes if n.operation == "div")
    builder = TapeBuilder()

    def write(node: Node, arguments: tuple[int, ...]) -> int:
        if node.operation == "div" and divided[node.arguments[1]] > 1:
            inverse = builder.apply("inv", arguments[1:])
            return builder.apply("mul", (arguments[0], inverse))
        return builder.apply(node.operation, arguments)

    return builder.rewritten(tape, write)


_SMALLEST = 1e-100


class _Sums(TapeBuilder):
    """Builder of a tape that knows the sums and constant multiples it has built."""

    def value(
        self, operation: str, arguments: tuple[int, ...], inner: tuple[int, ...]
    ) -> int:
        """Return the number of an operation's result.

        Args:
            operation: Name of the operation.
            arguments: Numbers of its arguments.
            inner: Arguments that nothing else uses.
        """
        if operation == "add":
            first, second = arguments
            return self._sum(first, second, inner)
        if operation == "mul":
            for factor, other in (arguments, arguments[::-1]):
                if self.nodes[factor].operation == "constant" and other in inner:
                    known, base = self._multiple(other)
                    product = self.nodes[factor].value * known
                    if known != 1.0 and _is_ordinary(product):
                        return self._times(product, base)
        return self.apply(operation, arguments)

    def _sum(self, a: int, b: int, inner: tuple[int, ...]) -> int:
        merged = self._merged(a, b, inner)
        if merged is not None:
            return merged
        for total, term in ((a, b), (b, a)):
            if total in inner and self.nodes[total].operation == "add":
                first, second = self.nodes[total].arguments
                for kept, other in ((first, second), (second, first)):
                    merged = self._merged(other, term, (*inner, other))
                    if merged is not None:
                        return self.apply("add", (kept, merged))
        return self.apply("add", (a, b))

    def _merged(self, a: int, b: int, inner: tuple[int, ...]) -> int | None:
        """Return a + b as one multiple; None unless both are multiples of one value."""
        (p, u), (q, v) = (self._multiple(n) if n in inner else (1.0, n) for n in (a, b))
        if u != v or not p * q > 0 or not _is_ordinary(p + q):
            return None
        return self._times(p + q, u)

    def _multiple(self, number: int) -> tuple[float, int]:
        """Return c and u of a value c u."""
        node = self.nodes[number]
        if node.operation == "twice":
            return 2.0, node.arguments[0]
        if node.operation == "mul":
            for factor, other in (node.arguments, node.arguments[::-1]):
                if self.nodes[factor].operation == "constant":
                    return self.nodes[factor].value, other
        return 1.0, number

    def _times(self, factor: float, number: int) -> int:
        if factor == 1.0:
            return number
        if factor == 2.0:  # noqa: PLR2004
            return self.apply("twice", (number,))
        constant = self.number(Node("constant", (), factor))
        return self.apply("mul", (constant, number))


def _is_ordinary(factor: float) -> bool:
    """Return whether products with a factor stay away from overflow and underflow."""
    return _SMALLEST < abs(factor) < 1 / _SMALLEST


COSTLY = frozenset(
    "sin cos tan exp log sqrt asin acos atan sinh cosh tanh asinh acosh atanh "
    "log1p expm1 erf".split()
)


def repeated_functions(stage: Tape) -> list[tuple[int, int, int]]:
    """Return the functions of a state that the next stage would compute again.

    The last stage of a Runge-Kutta step is evaluated at x + h k. For a constant rate k
    this is the state after the step, and the next step would begin with the same
    functions of it, such as a sine.

    Args:
        stage: Tape of (x, ...) -> (x after, ...).

    Returns:
        For each such function: the number of a state; the tape's node that is the
        function of this state before the stage; the node that is the same function of
        this state after the stage.
    """
    places = {
        (node.operation, node.arguments[0]): number
        for number, node in enumerate(stage.nodes)
        if node.operation in COSTLY
    }
    before = {
        node.arguments[1]: number
        for number, node in enumerate(stage.nodes)
        if node.operation == "input" and node.arguments[0] == 0
    }
    return [
        (entry, now, places[operation, stage.outputs[0][entry]])
        for (operation, argument), now in places.items()
        for entry, number in before.items()
        if argument == number and (operation, stage.outputs[0][entry]) in places
    ]


def stepped(
    frame: Frame, ticks: Ticks, read: Read, state: list[str]
) -> tuple[list[str], list[str]]:
    """Emit the steps of adaptive length of an interval.

    Returns:
        The states at each check, check after check, and the integrals.
    """
    ir, size = frame.ir, (ticks.tick.inputs[0] - 2) // 2
    zero, nan = ir.constant(0.0), ir.constant(math.nan)
    y = [*state, *[zero] * (size - len(state))]
    z = [*y, *(ir.intrinsic("fabs", value) for value in y), "", ""]
    h, reached = ir.constant(ticks.first), []
    for check in range(ticks.checks):
        # Lanes beyond the end count as done from the beginning.
        z = [*z[:-2], ir.flag(frame.inside), h]
        z = _until_all_are_done(ir, ticks, read, z, check)
        # Not 0 after too many ticks, or if h became too small.
        done, h = ir.compare("oeq", z[-2], zero), z[-1]
        z = [*(ir.select(done, value, nan) for value in z[:-2]), "", ""]
        reached += z[: len(state)]
    return reached, z[len(state) : size]


def _until_all_are_done(
    ir: VectorIR, ticks: Ticks, read: Read, z: list[str], check: int
) -> list[str]:
    """Emit the loop over trial steps to the end of one check; return z after it."""
    # u, p and s do not change between ticks: they are read before the loop.
    tape, known = ticks.tick, {}
    # s has the signals at both ends of a check.
    first = check * (tape.inputs[3] // 2)
    for node in tape.nodes:
        if node.operation == "input" and node.arguments[0] > 0:
            argument, entry = node.arguments
            at = first + entry if argument == 3 else entry  # noqa: PLR2004 - z, u, p, s
            known[node.arguments] = read(argument, at)
    loop = Loop(ir, z, ticks.most)
    before = loop.carried

    def of_tick(argument: int, entry: int) -> str:
        return known[argument, entry] if argument else before[entry]

    values = emit_tape(ir, tape, of_tick)
    after = [values[number] for number in tape.outputs[0]]
    running = ir.any(ir.compare("ogt", after[-2], ir.constant(0.0)))
    loop.close(after, while_=running)
    return after


def with_steps(read: Read, steps: tuple[list[str], list[str]]) -> Read:
    """Return a reader of an interval's arguments and of the results of its steps."""

    def either(argument: int, entry: int) -> str:
        own = argument - 4  # After x, u, p, s.
        return read(argument, entry) if own < 0 else steps[own][entry]

    return either
