"""Steps of adaptive length as LLVM IR: a loop until all individuals are done.

ocp/integration/adaptive.py defines a tick; for an individual that is done it changes
nothing.
"""

import math
from dataclasses import dataclass

from swarmstart.ocp.compiled.frame import Frame
from swarmstart.ocp.compiled.vectors.loop import Loop
from swarmstart.ocp.compiled.vectors.operations import Read, emit_tape
from swarmstart.ocp.compiled.vectors.vector_ir import VectorIR
from swarmstart.tape import Tape


@dataclass(frozen=True, kw_only=True, slots=True)
class Ticks:
    """Steps of adaptive length from check to check; see ocp/integration/adaptive.py.

    Attributes:
        tick: (z, u, p, s) -> z after one tick, s flat over both ends of a check; z is
            (y, |y| so far, left, h), y the states and the integrals.
        checks: Number of checks in an interval.
        first: Step size h at the beginning of an interval.
        most: Largest number of ticks between two checks.
    """

    tick: Tape
    checks: int
    first: float
    most: int


def stepped(
    frame: Frame, ticks: Ticks, read: Read, state: list[str]
) -> tuple[list[str], list[str]]:
    """Emit the ticks of an interval.

    Args:
        frame: The frame to emit into.
        ticks: The ticks.
        read: Reads the arguments of the interval.
        state: The states at its beginning.

    Returns:
        The states at each check, check after check, and the integrals.
    """
    ir, size = frame.ir, (ticks.tick.inputs[0] - 2) // 2
    zero, nan = ir.constant(0.0), ir.constant(math.nan)
    y = [*state, *[zero] * (size - len(state))]
    z = [*y, *(ir.intrinsic("fabs", value) for value in y), "", ""]
    h, reached = ir.constant(ticks.first), []
    for check in range(ticks.checks):
        # Lanes whose result is not needed count as done from the beginning.
        z = [*z[:-2], ir.flag(frame.wanted), h]
        z = _until_all_are_done(ir, ticks, read, z, check)
        done, h = ir.compare("oeq", z[-2], zero), z[-1]
        z = [*(ir.select(done, value, nan) for value in z[:-2]), "", ""]
        reached += z[: len(state)]
    return reached, z[len(state) : size]


def _until_all_are_done(
    ir: VectorIR, ticks: Ticks, read: Read, z: list[str], check: int
) -> list[str]:
    """Emit the loop over the ticks to the end of one check; return z after it."""
    tape, known = ticks.tick, {}
    first = check * (tape.inputs[3] // 2)
    for node in tape.nodes:
        if node.operation == "input" and node.arguments[0] > 0:
            argument, entry = node.arguments
            at = first + entry if argument == 3 else entry  # noqa: PLR2004 - z, u, p, s
            known[node.arguments] = read(argument, at)
    loop = Loop(ir, [*z, ir.unserved], ticks.most)
    *before, ir.unserved = loop.carried

    def of_tick(argument: int, entry: int) -> str:
        return known[argument, entry] if argument else before[entry]

    values = emit_tape(ir, tape, of_tick)
    after = [values[number] for number in tape.outputs[0]]
    running = ir.any(ir.compare("ogt", after[-2], ir.constant(0.0)))
    loop.close([*after, ir.unserved], while_=running)
    return after


def with_steps(read: Read, steps: tuple[list[str], list[str]]) -> Read:
    """Return a reader of an interval's arguments and of the results of its steps."""

    def either(argument: int, entry: int) -> str:
        own = argument - 4  # After x, u, p, s.
        return read(argument, entry) if own < 0 else steps[own][entry]

    return either
