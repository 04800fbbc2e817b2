"""The loop over the steps of lanes, compiled: kernels called at their addresses.

Lanes stand side by side in the columns of one memory. A turn tries a step in all of
them: start, forward, verdict, keep. Lanes whose step is done with wait for a sweep
backward until most lanes do; so shorter steps are tried without one. A lane that has
ended is written down, and the next start takes its place; if there is none left, the
last lane does, so that those at work are always the first ones.
"""

from typing import NamedTuple

from swarmstart.kernel import Array, Count, free_kernel, kernel
from swarmstart.ocp.compiled.calls import call_part

_WAITING = 0.75
"""Part of the lanes that wait for a sweep before there is one."""
_WHOLE = 1.0
"""Length of the step of a lane that waits."""


class Rows(NamedTuple):
    """Rows of the memory.

    Attributes:
        state: First one of the state.
        following: First one of the state after a turn.
        count: Number of rows of the state.
        done: Whether a lane has ended.
        length: Length of the step that is tried next.
        taken: Whether the step that was tried is taken.
    """

    state: int
    following: int
    count: int
    done: int
    length: int
    taken: int


class Starts(NamedTuple):
    """Starts to be solved.

    Attributes:
        blank: What any lane begins with, shape (rows,).
        given: What a start brings besides, a column for each of all starts.
        rows: Rows of the memory that it comes to.
        numbers: Those of the starts to be solved.
    """

    blank: Array
    given: Array
    rows: Count
    numbers: Count


class Ends(NamedTuple):
    """What lanes end with.

    Attributes:
        found: To be written, a column for each of all starts.
        rows: Rows of the memory that it comes from.
    """

    found: Array
    rows: Count


@kernel
def _refill(
    memory: Array, rows: Rows, starts: Starts, ends: Ends, work: Count
) -> None:
    """Write down lanes that have ended, and put others in their places."""
    lane = 0
    while lane < memory.shape[1]:
        old = lane < work[0]
        if old and memory[rows.done, lane] == 0.0:
            lane += 1
            continue
        if old:
            for i in range(ends.rows.size):
                ends.found[i, work[2 + lane]] = memory[ends.rows[i], lane]
        if work[1] < starts.numbers.size:
            number = starts.numbers[work[1]]
            for i in range(starts.blank.size):
                memory[i, lane] = starts.blank[i]
            for i in range(starts.rows.size):
                memory[starts.rows[i], lane] = starts.given[i, number]
            work[2 + lane] = number
            work[1] += 1
            work[0] = max(work[0], lane + 1)
            lane += 1
        elif old:
            work[0] -= 1
            for i in range(starts.blank.size):
                memory[i, lane] = memory[i, work[0]]
            work[2 + lane] = work[2 + work[0]]
        else:
            return


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
        calls: Addresses of `part`, arguments and outputs of each kernel, shape (5, 3).
        memory: Of the lanes, shape (rows, lanes).
        rows: Those that the loop looks at.
        starts: What lanes begin with.
        ends: What they end with; written.
        work: Number of lanes at work, starts begun, then the number of each lane's
            start; changed.
        turns: How many to take at most.
    """
    width = memory.shape[1]
    for _ in range(turns):
        _refill(memory, rows, starts, ends, work)
        lanes = work[0]
        if lanes == 0:
            return
        waiting = 0
        for j in range(lanes):
            if memory[rows.length, j] == _WHOLE:
                waiting += 1
        all_go = waiting >= _WAITING * lanes
        for i in range(0 if all_go else 1, calls.shape[0] - 1):
            call_part(calls[i, 0], calls[i, 1], calls[i, 2], width, lanes)
        for j in range(lanes):
            if all_go or memory[rows.length, j] != _WHOLE:
                for i in range(rows.count):
                    memory[rows.state + i, j] = memory[rows.following + i, j]
            else:
                memory[rows.taken, j] = 0.0
                memory[rows.done, j] = 0.0
        last = calls.shape[0] - 1
        call_part(calls[last, 0], calls[last, 1], calls[last, 2], width, lanes)
