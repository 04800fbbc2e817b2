"""The loop over the steps of lanes, compiled: kernels called at their addresses.

Lanes stand side by side in the columns of one memory. A turn tries a step in all of
them: start, forward, verdict, keep. Lanes whose step is done with wait for a sweep
backward until most lanes do; so shorter steps are tried without one. A lane that has
ended is written down, and the last lane takes its place, so that those at work are
always the first ones; then further starts begin.

A lane that ends without having met its limits begins once more from its start: with a
heavier end, and what is decided about the start held until multipliers are renewed.
Else a light lane makes a free end time short as long as that costs less than its end
conditions, and may get to where the nearest way to them is no way.
"""

from typing import NamedTuple

from swarmstart.kernel import Array, Count, free_kernel, kernel
from swarmstart.ocp.compiled.calls import call_part

_MOST = 0.75
"""Part of the lanes that wait for a sweep before there is one."""
_MET = 1e-6
"""Largest violation with which a lane need not begin again."""
_AGAIN_WEIGHT = 100.0
"""Least weight of the end's rows in a lane that begins again."""
_WHOLE = 1.0
"""Length of the step of a lane that waits."""


class Rows(NamedTuple):
    """Rows of the memory.

    Attributes:
        state: First one of the state.
        following: First one of the state after a turn.
        size: Number of rows of the state.
        done: Whether a lane has ended.
        length: Length of the step that is tried next.
        taken: Whether the step that was tried is taken.
        worst: Excess.
        iterations: Steps so far.
        again: Whether a lane has begun for a second time.
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
        blank: What any lane begins with, shape (rows,).
        given: What a start brings besides, a column for each of all starts.
        rows: Rows of the memory that it comes to.
        numbers: Those of the starts to be solved.
        most: Steps after which a lane does not begin again.
    """

    blank: Array
    given: Array
    rows: Count
    numbers: Count
    most: int


class Ends(NamedTuple):
    """What lanes end with.

    Attributes:
        found: To be written, a column for each of all starts.
        rows: Rows of the memory that it comes from.
    """

    found: Array
    rows: Count


@kernel
def _begin(memory: Array, lane: int, starts: Starts, number: int) -> None:
    """Put a start in a lane."""
    for i in range(starts.blank.size):
        memory[i, lane] = starts.blank[i]
    for i in range(starts.rows.size):
        memory[starts.rows[i], lane] = starts.given[i, number]


@kernel
def _begins_again(
    memory: Array, lane: int, rows: Rows, starts: Starts, number: int
) -> bool:
    """Let a lane begin a second time that has not met its limits; say whether."""
    steps = memory[rows.iterations, lane]
    met = memory[rows.worst, lane] <= _MET
    if met or memory[rows.again, lane] != 0.0 or steps >= starts.most:
        return False
    _begin(memory, lane, starts, number)
    memory[rows.again, lane] = 1.0
    memory[rows.iterations, lane] = steps
    memory[rows.r_end, lane] = max(memory[rows.r_end, lane], _AGAIN_WEIGHT)
    return True


@kernel
def _refill(memory: Array, rows: Rows, starts: Starts, ends: Ends, work: Count) -> None:
    """Write down lanes that have ended, and put others in their places."""
    lane = 0
    while lane < work[0]:
        number = work[2 + lane]
        done = memory[rows.done, lane] != 0.0
        if not done or _begins_again(memory, lane, rows, starts, number):
            lane += 1
            continue
        for i in range(ends.rows.size):
            ends.found[i, number] = memory[ends.rows[i], lane]
        work[0] -= 1
        for i in range(memory.shape[0]):
            memory[i, lane] = memory[i, work[0]]
        work[2 + lane] = work[2 + work[0]]
    while work[0] < memory.shape[1] and work[1] < starts.numbers.size:
        work[2 + work[0]] = starts.numbers[work[1]]
        _begin(memory, work[0], starts, work[2 + work[0]])
        work[0] += 1
        work[1] += 1


@kernel
def _waiting(memory: Array, rows: Rows, lanes: int) -> int:
    """Return how many lanes wait for a sweep."""
    count = 0
    for lane in range(lanes):
        if memory[rows.length, lane] == _WHOLE:
            count += 1
    return count


@kernel
def _take_over(memory: Array, rows: Rows, lanes: int, all_go: bool) -> None:
    """Take over the states after a turn; lanes that wait stay as they are."""
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
        memory: Of the lanes, shape (rows, lanes).
        rows: Those that the loop looks at.
        starts: What lanes begin with.
        ends: What they end with; written.
        work: Number of lanes at work, starts begun, then the number of each lane's
            start; changed.
        turns: How many to take at most.
    """
    width, last = memory.shape[1], calls.shape[0] - 1
    for _ in range(turns):
        _refill(memory, rows, starts, ends, work)
        lanes = work[0]
        if lanes == 0:
            return
        all_go = _waiting(memory, rows, lanes) >= _MOST * lanes
        for i in range(0 if all_go else 1, last):
            call_part(calls[i, 0], calls[i, 1], calls[i, 2], width, lanes)
        _take_over(memory, rows, lanes, all_go)
        call_part(calls[last, 0], calls[last, 1], calls[last, 2], width, lanes)
