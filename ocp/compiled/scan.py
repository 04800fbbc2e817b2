"""A step applied interval after interval, from the first or from the last.

A step computes carried values from those before it; these stay in registers. Kept
values of a step are written for every interval. Two examples, with the state x, the
controls u, the right-hand side f of the step, and the costate lambda:

    forward    x_k+1 = f(x_k, u_k)                      keeps the states
    backward   lambda_k = df/dx' lambda_k+1 + ...       keeps the gradient

A rollout (emitter.py) is a forward scan that keeps nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import casadi as ca

from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.compiled.emitter import simplified, with_inverses
from swarmstart.ocp.compiled.engine import NoCompilerError
from swarmstart.ocp.compiled.frame import Frame, Target, module_of, target_of
from swarmstart.ocp.compiled.simd import (
    Shape,
    SimdBatch,
    cached,
    key_of,
)
from swarmstart.ocp.compiled.vectors.operations import emit_tape
from swarmstart.ocp.compiled.vectors.vector_ir import Loop, Precision
from swarmstart.ocp.interpolation.interpolants import without_interpolants
from swarmstart.tape import Tape, read_tape

Role = Literal["carried", "individual", "interval", "both", "shared"]
"""Role of an argument of a step: "carried" from turn to turn, at first (rows, n);
"individual", the same in all intervals, (rows, n); "interval", the same for all
individuals, (turns * rows,); "both", of each interval and individual, (turns * rows,
n), interval after interval; "shared" by all, (rows,)."""

MOST_INSTRUCTIONS = 40_000
"""Largest number of instructions of a step: LLVM takes about 3 s for 30,000."""
PER_INTERVAL: tuple[Role, ...] = ("interval", "both")


@dataclass(frozen=True, kw_only=True, slots=True)
class Scan:
    """A step with the roles of its arguments.

    Attributes:
        step: Function (arguments) -> (new carried values, in the order of the carried
            arguments; then the values of this interval to be kept).
        roles: Role of each argument: "carried" from interval to interval; "individual",
            the same in all intervals; "interval", the same for all individuals; "both",
            of each interval and individual; or "shared" by all.
        turns: Number of intervals N.
        backward: Whether the last interval comes first.
    """

    step: Tape
    roles: tuple[Role, ...]
    turns: int
    backward: bool

    @property
    def carried(self) -> list[int]:
        """Indices of the carried arguments."""
        return [i for i, role in enumerate(self.roles) if role == "carried"]


def emit_scan(scan: Scan, *, target: Target) -> str:
    """Return the IR module of (arguments) -> (last carried values, kept values).

    Kept values have shape (turns * rows, n), interval after interval.

    Args:
        scan: The step.
        target: Processor and precision that code is emitted for.

    Raises:
        UnknownOperationError: If an operation cannot be emitted.
    """
    return module_of(
        lambda frame: _emit(frame, scan),
        target,
        inputs=len(scan.roles),
        outputs=len(scan.step.outputs),
    )


def _emit(frame: Frame, scan: Scan) -> None:
    """Emit the loop over the intervals."""
    ir, step = frame.ir, scan.step
    fixed = {
        (argument, entry): _load(frame, role, argument, str(entry))
        for argument, role in enumerate(scan.roles)
        for entry in range(step.inputs[argument])
        if role not in PER_INTERVAL
    }
    places = [(a, e) for a in scan.carried for e in range(step.inputs[a])]
    loop = Loop(ir, [fixed[place] for place in places], scan.turns)
    fixed |= dict(zip(places, loop.carried, strict=True))
    k = ir.emit(f"sub i64 {scan.turns - 1}, {loop.k}") if scan.backward else loop.k

    def row_of(rows: int, entry: int) -> str:
        first = ir.emit(f"mul i64 {k}, {rows}")
        return ir.emit(f"add i64 {first}, {entry}")

    def read(argument: int, entry: int) -> str:
        role = scan.roles[argument]
        if role not in PER_INTERVAL:
            return fixed[argument, entry]
        return _load(frame, role, argument, row_of(step.inputs[argument], entry))

    found = emit_tape(ir, step, read)
    count = len(scan.carried)
    ends, kept = step.outputs[:count], step.outputs[count:]
    for output, numbers in enumerate(kept, start=len(ends)):
        for entry, number in enumerate(numbers):
            frame.store_row(output, row_of(len(numbers), entry), found[number])
    loop.close([found[n] for numbers in ends for n in numbers])
    for output, numbers in enumerate(ends):
        for entry, number in enumerate(numbers):
            frame.store_row(output, entry, found[number])


def _load(frame: Frame, role: Role, argument: int, row: str) -> str:
    if role in ("shared", "interval"):
        return frame.load_shared(argument, row)
    return frame.load_row(argument, row)


def compile_scan(
    step: ca.Function,
    roles: Sequence[Role],
    *,
    turns: int,
    backward: bool = False,
    precision: Precision = "double",
    threads: int = 1,
) -> SimdBatch:
    """Return an evaluator of (arguments) -> (last carried values, kept values).

    Args:
        step: An SX function; see `Scan`.
        roles: Role of each argument; at least one differs per individual.
        turns: Number of intervals, at least 1.
        backward: Whether the last interval comes first.
        precision: Precision of the arithmetic; arguments and outputs are doubles.
        threads: Largest number of threads for a population.

    Raises:
        InvalidProblemError: If the roles do not fit the step.
        UnknownOperationError: If the step has an operation that is not compiled.
        NoCompilerError: If machine code cannot be made here.
    """
    _require(step, roles)
    step = without_interpolants(step)
    count = step.n_instructions()
    if count > MOST_INSTRUCTIONS:
        raise NoCompilerError(
            f"expected at most {MOST_INSTRUCTIONS} instructions in an interval, found "
            f"{count}"
        )

    def emit() -> str:
        tape = simplified(with_inverses(read_tape(step)))
        scan = Scan(step=tape, roles=tuple(roles), turns=turns, backward=backward)
        return emit_scan(scan, target=target_of([tape], precision))

    carried = sum(role == "carried" for role in roles)
    shape = Shape(
        tuple(role in ("carried", "individual", "both") for role in roles),
        tuple(
            step.numel_in(i) * (turns if role in PER_INTERVAL else 1)
            for i, role in enumerate(roles)
        ),
        tuple(
            step.numel_out(i) * (1 if i < carried else turns)
            for i in range(step.n_out())
        ),
    )
    settings = ("scan", tuple(roles), turns, backward, precision)
    compiled = cached(key_of([step], settings, __name__), emit)
    return SimdBatch(compiled, shape, threads, instructions=count)


def _require(step: ca.Function, roles: Sequence[Role]) -> None:
    """Validate that roles fit a step."""
    carried = [i for i, role in enumerate(roles) if role == "carried"]
    if len(roles) != step.n_in() or any(role not in get_args(Role) for role in roles):
        raise InvalidProblemError(
            f"roles must be {step.n_in()} of {', '.join(get_args(Role))}, got {roles}"
        )
    sizes = [step.numel_in(i) for i in carried]
    after = [step.numel_out(i) for i in range(min(len(carried), step.n_out()))]
    if sizes != after:
        raise InvalidProblemError(
            f"the first outputs must have the sizes {sizes} of what is carried, "
            f"got {after}"
        )
