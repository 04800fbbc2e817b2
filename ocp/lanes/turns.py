"""The loop over steps and trials of lanes, compiled: kernels called at their addresses.

Lanes are the columns of one memory. A lane that needs a step waits until most lanes
need one, since a sweep (the computation of steps by the Riccati recursion, see
interior_kernels.py) takes as long for one lane as for all. When a lane has ended, its
results are recorded and the last lane moves to its column, so that working lanes are
always in the first columns; then further starts begin.
"""

from typing import NamedTuple

from swarmstart.arrays import Array
from swarmstart.machine_code import Count, call_code, free_kernel, kernel

_MOST = 0.75
"""Fraction of the lanes that must wait for a sweep before the sweep is done."""
_SWEEP, _TRIAL = 5, 3
"""Number of kernels of a sweep, and of a trial before `keep`."""


class Rows(NamedTuple):
    """Rows of the memory that the loop reads.

    Attributes:
        state: First row of the lane's state, the numbers that change from turn to turn.
        aim: First row of the new values of those entries of the state that a sweep
            writes.
        aims: Number of these rows.
        following: First row of the state after a trial.
        size: Number of rows of the state.
        tries: Row that says whether a lane tries a step; else it waits for a sweep.
        taken: Row that says whether the tried step is accepted.
        done: Row that says whether a lane has ended.
    """

    state: int
    aim: int
    aims: int
    following: int
    size: int
    tries: int
    taken: int
    done: int


class Starts(NamedTuple):
    """Starts to be solved.

    Attributes:
        blank: Initial memory of any lane, shape (rows,).
        given: Given numbers, a column for each of all starts.
        rows: Rows of the memory that these numbers are written to.
        numbers: Indices of the starts to be solved.
    """

    blank: Array
    given: Array
    rows: Count
    numbers: Count


class Ends(NamedTuple):
    """Results of lanes.

    Attributes:
        found: The results, written here, a column for each of all starts.
        rows: Rows of the memory that they are read from.
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
def _leave(memory: Array, lane: int, ends: Ends, work: Count) -> None:
    """Record a lane that has ended, and put the last lane in its place."""
    for i in range(ends.rows.size):
        ends.found[i, work[2 + lane]] = memory[ends.rows[i], lane]
    work[0] -= 1
    for i in range(memory.shape[0]):
        # The lane that takes the place may have ended too: it is looked at next.
        memory[i, lane] = memory[i, work[0]]
    work[2 + lane] = work[2 + work[0]]


@kernel
def _fill(memory: Array, starts: Starts, work: Count) -> None:
    """Put further starts into lanes that are free."""
    while work[0] < memory.shape[1] and work[1] < starts.numbers.size:
        work[2 + work[0]] = starts.numbers[work[1]]
        _begin(memory, work[0], starts, work[2 + work[0]])
        work[0] += 1
        work[1] += 1


@kernel
def _refill(memory: Array, rows: Rows, starts: Starts, ends: Ends, work: Count) -> None:
    """Record lanes that have ended, and put others in their places."""
    lane = 0
    while lane < work[0]:
        if memory[rows.done, lane] == 0.0:
            lane += 1
        else:
            _leave(memory, lane, ends, work)
    _fill(memory, starts, work)


@kernel
def _must_sweep(memory: Array, rows: Rows, lanes: int) -> bool:
    """Return whether most lanes that have not ended wait for a sweep."""
    count, working = 0, 0
    for lane in range(lanes):
        if memory[rows.done, lane] == 0.0:
            working += 1
            if memory[rows.tries, lane] == 0.0:
                count += 1
    return count > 0 and count >= _MOST * working


@kernel
def _aim(memory: Array, rows: Rows, lanes: int) -> None:
    """Copy what follows from a sweep in the lanes that waited for it."""
    for lane in range(lanes):
        if memory[rows.tries, lane] == 0.0:
            for i in range(rows.aims):
                memory[rows.state + i, lane] = memory[rows.aim + i, lane]


@kernel
def _take_over(memory: Array, rows: Rows, lanes: int) -> None:
    """Copy the states after a trial; waiting lanes do not change."""
    for lane in range(lanes):
        if memory[rows.tries, lane] != 0.0:
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
        calls: Addresses of `part`, arguments and outputs of each kernel: those of a
            sweep, those of a trial, and `keep`, shape (9, 3).
        memory: Memory of the lanes, shape (rows, lanes).
        rows: Rows that the loop reads.
        starts: Starts to be solved.
        ends: Results; written.
        work: Number of lanes at work, number of starts begun, then the number of each
            lane's start; changed.
        turns: Largest number of turns.
    """
    width = memory.shape[1]
    for _ in range(turns):
        _refill(memory, rows, starts, ends, work)
        lanes = work[0]
        if lanes == 0:
            return
        part = width, 0, lanes  # Of each row only the lanes at work.
        for i in range(_SWEEP, _SWEEP + _TRIAL):
            call_code(calls[i, 0], calls[i, 1], calls[i, 2], part)
        _take_over(memory, rows, lanes)
        # Intervals are changed last: waiting lanes are not `taken`.
        keep = _SWEEP + _TRIAL
        call_code(calls[keep, 0], calls[keep, 1], calls[keep, 2], part)
        # After the trial: a lane that has just begun needs a step of zeros for its
        # first trial, and a sweep writes steps in all lanes, perhaps infinite ones.
        if _must_sweep(memory, rows, lanes):
            for i in range(_SWEEP):
                call_code(calls[i, 0], calls[i, 1], calls[i, 2], part)
            _aim(memory, rows, lanes)
