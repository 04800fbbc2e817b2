"""The loop over the steps of lanes, compiled: kernels called at their addresses.

Lanes are the columns of one memory. A turn tries a step in all of them: start, forward,
verdict, keep. A lane whose step is decided waits for a backward sweep until most lanes
wait, so that shorter steps of the others are tried without a sweep. A lane that has
ended is recorded, and the last lane takes its place, so that working lanes are always
the first ones; then further starts begin.

A lane that ends without meeting its limits begins once more from its start, with a
heavier end, and with the decisions about the start fixed until multipliers are renewed.
Without that, a lane with light weights shortens a free end time as long as this costs
less than its end conditions, and may reach a point from which it cannot meet them.
"""

import ctypes
from collections.abc import Callable
from typing import Any, NamedTuple, cast

from swarmstart.arrays import Array
from swarmstart.machine_code import Count, free_kernel, intrinsic, kernel
from swarmstart.ocp.compiled.engine import PART

Call = Callable[[int, int, int, int, int], None]

_MOST = 0.75
"""Fraction of the lanes that must wait for a sweep before it is done."""
_MET = 1e-6
"""Largest violation at which a lane need not begin again."""
_AGAIN_WEIGHT = 100.0
"""Least weight of the end's rows in a lane that begins again."""
_WHOLE = 1.0
"""Step length of a waiting lane: a full step."""


def _call_part(
    typing_context: Any, function: Any, inputs: Any, outputs: Any, size: Any, last: Any
) -> tuple[Any, Callable[..., Any]]:
    """Call void part(double **in, double **out, int64 n, int64 first, int64 last)."""
    import numba
    from llvmlite import ir

    integer = numba.types.int64
    signature = numba.types.void(integer, integer, integer, integer, integer)

    def generate(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        address, first, second, count, end = arguments
        pointer, number = ir.IntType(8).as_pointer(), ir.IntType(64)
        kind = ir.FunctionType(
            ir.VoidType(), [pointer, pointer, number, number, number]
        )
        called = builder.inttoptr(address, kind.as_pointer())
        given = [builder.inttoptr(a, pointer) for a in (first, second)]
        builder.call(called, [*given, count, number(0), end])
        return context.get_dummy_value()

    return signature, generate


def _in_python(function: int, inputs: int, outputs: int, size: int, last: int) -> None:
    """Call it from plain Python."""
    tables = ctypes.c_void_p(int(inputs)), ctypes.c_void_p(int(outputs))
    PART(int(function))(*tables, size, 0, int(last))


# Without compilation the loop is plain Python, which knows no intrinsics.
call_part = cast(Call, intrinsic(_call_part, plain=_in_python))
"""Evaluate the first individuals: (address of `part`, addresses of the tables of its
arguments and outputs, individuals in a row, number of individuals to evaluate)."""


class Rows(NamedTuple):
    """Rows of the memory that the loop reads.

    Attributes:
        state: First row of the state.
        following: First row of the state after a turn.
        size: Number of rows of the state.
        done: Whether a lane has ended.
        length: Length of the step that is tried next.
        taken: Whether the tried step is accepted.
        worst: The worst excess.
        iterations: Number of steps so far.
        again: Whether a lane has begun a second time.
        r_end: Weight of the end's rows.
    """

    state: int
    following: int
    size: int
    done: int
    length: int
    taken: int
    worst: int
    iterations: int
    again: int
    r_end: int


class Starts(NamedTuple):
    """Starts to be solved.

    Attributes:
        blank: Initial memory of any lane, shape (rows,).
        given: Numbers of each start, a column for each of all starts.
        rows: Rows of the memory that these numbers are written to.
        numbers: Indices of the starts to be solved.
        most: Number of steps after which a lane does not begin again.
    """

    blank: Array
    given: Array
    rows: Count
    numbers: Count
    most: int


class Ends(NamedTuple):
    """Results of lanes.

    Attributes:
        found: The results, written here, a column for each of all starts.
        rows: Rows of the memory that they are read from.
    """

    found: Array
    rows: Count


@kernel
def begin(memory: Array, lane: int, starts: Starts, number: int) -> None:
    """Put a start in a lane."""
    for i in range(starts.blank.size):
        memory[i, lane] = starts.blank[i]
    for i in range(starts.rows.size):
        memory[starts.rows[i], lane] = starts.given[i, number]


@kernel
def leave(memory: Array, lane: int, ends: Ends, work: Count) -> None:
    """Record a lane that has ended, and put the last lane in its place."""
    for i in range(ends.rows.size):
        ends.found[i, work[2 + lane]] = memory[ends.rows[i], lane]
    work[0] -= 1
    for i in range(memory.shape[0]):
        # The lane that takes the place may have ended too: it is looked at next.
        memory[i, lane] = memory[i, work[0]]
    work[2 + lane] = work[2 + work[0]]


@kernel
def fill(memory: Array, starts: Starts, work: Count) -> None:
    """Put further starts into lanes that are free."""
    while work[0] < memory.shape[1] and work[1] < starts.numbers.size:
        work[2 + work[0]] = starts.numbers[work[1]]
        begin(memory, work[0], starts, work[2 + work[0]])
        work[0] += 1
        work[1] += 1


@kernel
def _begins_again(
    memory: Array, lane: int, rows: Rows, starts: Starts, number: int
) -> bool:
    """Restart a lane that has not met its limits; return whether it was restarted."""
    steps = memory[rows.iterations, lane]
    met = memory[rows.worst, lane] <= _MET
    if met or memory[rows.again, lane] != 0.0 or steps >= starts.most:
        return False
    begin(memory, lane, starts, number)
    memory[rows.again, lane] = 1.0
    memory[rows.iterations, lane] = steps
    memory[rows.r_end, lane] = max(memory[rows.r_end, lane], _AGAIN_WEIGHT)
    return True


@kernel
def _refill(memory: Array, rows: Rows, starts: Starts, ends: Ends, work: Count) -> None:
    """Record lanes that have ended, and put others in their places."""
    lane = 0
    while lane < work[0]:
        number = work[2 + lane]
        done = memory[rows.done, lane] != 0.0
        if not done or _begins_again(memory, lane, rows, starts, number):
            lane += 1
            continue
        leave(memory, lane, ends, work)
    fill(memory, starts, work)


@kernel
def _waiting(memory: Array, rows: Rows, lanes: int) -> int:
    """Return the number of lanes that wait for a sweep."""
    count = 0
    for lane in range(lanes):
        if memory[rows.length, lane] == _WHOLE:
            count += 1
    return count


@kernel
def _take_over(memory: Array, rows: Rows, lanes: int, all_go: bool) -> None:
    """Copy the states after a turn; waiting lanes do not change."""
    for lane in range(lanes):
        if all_go or memory[rows.length, lane] != _WHOLE:
            for i in range(rows.size):
                memory[rows.state + i, lane] = memory[rows.following + i, lane]
        else:
            memory[rows.taken, lane] = 0.0
            memory[rows.done, lane] = 0.0


@free_kernel
def take_turns(  # noqa: PLR0913, PLR0917 - compiled code takes no keywords
    calls: Count,
    memory: Array,
    rows: Rows,
    starts: Starts,
    ends: Ends,
    work: Count,
    turns: int,
) -> None:
    """Take steps until a number of turns is over, or all starts have ended.

    Args:
        calls: Addresses of `part`, arguments and outputs of each kernel, in the order
            of `Sweeps`, shape (5, 3).
        memory: Memory of the lanes, shape (rows, lanes).
        rows: Rows that the loop reads.
        starts: Starts to be solved.
        ends: Results; written.
        work: Number of lanes at work, number of starts begun, then the number of each
            lane's start; changed.
        turns: Largest number of turns.
    """
    width, last = memory.shape[1], calls.shape[0] - 1
    for _ in range(turns):
        _refill(memory, rows, starts, ends, work)
        lanes = work[0]
        if lanes == 0:
            return
        all_go = _waiting(memory, rows, lanes) >= _MOST * lanes
        # Kernel 0 is the backward sweep, which waits until most lanes need it.
        for i in range(0 if all_go else 1, last):
            call_part(calls[i, 0], calls[i, 1], calls[i, 2], width, lanes)
        _take_over(memory, rows, lanes, all_go)
        # Intervals are copied last: waiting lanes are not `taken` any more.
        call_part(calls[last, 0], calls[last, 1], calls[last, 2], width, lanes)
