"""The loop over steps and trials of an interior-point method, compiled.

As in turns.py, lanes are the columns of one memory. A lane that needs a step waits
until most lanes do, since a sweep takes as long for one lane as for all.
"""

from typing import NamedTuple

from swarmstart.arrays import Array
from swarmstart.machine_code import Count, free_kernel, kernel
from swarmstart.ocp.lanes.turns import Ends, Starts, call_part, fill, leave

_MOST = 0.75
"""Fraction of the lanes that must wait for a sweep before it is done."""
_SWEEP, _TRIAL = 5, 3
"""Number of kernels of a sweep, and of a trial before `keep`."""


class InteriorRows(NamedTuple):
    """Rows of the memory that the loop reads.

    Attributes:
        state: First row of the state.
        aim: First row of its part that a sweep has changed.
        aims: Number of rows of that part.
        following: First row of the state after a trial.
        size: Number of rows of the state.
        tries: Whether a lane tries a step; else it waits for a sweep.
        taken: Whether the tried step is accepted.
        done: Whether a lane has ended.
    """

    state: int
    aim: int
    aims: int
    following: int
    size: int
    tries: int
    taken: int
    done: int


@kernel
def _refill(
    memory: Array, rows: InteriorRows, starts: Starts, ends: Ends, work: Count
) -> None:
    """Record lanes that have ended, and put others in their places."""
    lane = 0
    while lane < work[0]:
        if memory[rows.done, lane] == 0.0:
            lane += 1
        else:
            leave(memory, lane, ends, work)
    fill(memory, starts, work)


@kernel
def _must_sweep(memory: Array, rows: InteriorRows, lanes: int) -> bool:
    """Return whether most lanes that have not ended wait for a sweep."""
    count, working = 0, 0
    for lane in range(lanes):
        if memory[rows.done, lane] == 0.0:
            working += 1
            if memory[rows.tries, lane] == 0.0:
                count += 1
    return count > 0 and count >= _MOST * working


@kernel
def _aim(memory: Array, rows: InteriorRows, lanes: int) -> None:
    """Copy what follows from a sweep in the lanes that waited for it."""
    for lane in range(lanes):
        if memory[rows.tries, lane] == 0.0:
            for i in range(rows.aims):
                memory[rows.state + i, lane] = memory[rows.aim + i, lane]


@kernel
def _take_over(memory: Array, rows: InteriorRows, lanes: int) -> None:
    """Copy the states after a trial; waiting lanes do not change."""
    for lane in range(lanes):
        if memory[rows.tries, lane] != 0.0:
            for i in range(rows.size):
                memory[rows.state + i, lane] = memory[rows.following + i, lane]
        else:
            memory[rows.taken, lane] = 0.0
            memory[rows.done, lane] = 0.0


@free_kernel
def take_interior_turns(  # noqa: PLR0913, PLR0917 - compiled code takes no keywords
    calls: Count,
    memory: Array,
    rows: InteriorRows,
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
        for i in range(_SWEEP, _SWEEP + _TRIAL):
            call_part(calls[i, 0], calls[i, 1], calls[i, 2], width, lanes)
        _take_over(memory, rows, lanes)
        # Intervals are changed last: waiting lanes are not `taken`.
        keep = _SWEEP + _TRIAL
        call_part(calls[keep, 0], calls[keep, 1], calls[keep, 2], width, lanes)
        # After the trial: a lane that has just begun needs a step of zeros for its
        # first trial, and a sweep writes steps in all lanes, perhaps infinite ones.
        if _must_sweep(memory, rows, lanes):
            for i in range(_SWEEP):
                call_part(calls[i, 0], calls[i, 1], calls[i, 2], width, lanes)
            _aim(memory, rows, lanes)
