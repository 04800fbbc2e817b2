"""The loop over the steps of lanes, compiled: kernels called at their addresses.

Lanes stand side by side in the columns of one memory. Each turn takes a step in all of
them; a lane that has ended is written down, and the next start takes its place, or, if
there is none left, the last lane.
"""

import numpy as np

from swarmstart.heuristics.compiled_loop import call_kernel
from swarmstart.kernel import Array, Count, free_kernel


@free_kernel
def take_turns(
    calls: Count,
    memory: Array,
    blank: Array,
    starts: tuple[Array, Count, Count],
    ends: tuple[Array, Count],
    places: Count,
    state: Count,
) -> None:
    """Take steps until a number of turns is over, or all starts have ended.

    Args:
        calls: Address, arguments, outputs and lanes at a time of each kernel, (5, 3).
        memory: Of the lanes, shape (rows, lanes).
        blank: What a new lane begins with, shape (rows,).
        starts: What a start brings besides, (given, all starts); rows of the memory it
            comes to; numbers of the starts to be solved.
        ends: To be written: what lanes end with, (kept, all starts); rows of the
            memory that it comes from.
        places: First row of the state, its rows, first row of the next state, row of
            `done`, turns to take.
        state: Number of lanes, starts begun; then the number of each lane's start.
    """
    given, given_rows, numbers = starts
    found, found_rows = ends
    first, rows, following, done, turns = places
    for _ in range(turns):
        lane = 0
        while lane < memory.shape[1]:
            if lane >= state[0] or memory[done, lane] != 0.0:
                if lane < state[0]:
                    for i in range(found_rows.size):
                        found[i, state[2 + lane]] = memory[found_rows[i], lane]
                if state[1] < numbers.size:
                    number = numbers[state[1]]
                    for i in range(blank.size):
                        memory[i, lane] = blank[i]
                    for i in range(given_rows.size):
                        memory[given_rows[i], lane] = given[i, number]
                    state[2 + lane] = number
                    state[1] += 1
                    state[0] = max(state[0], lane + 1)
                elif lane < state[0]:
                    last = state[0] - 1
                    for i in range(blank.size):
                        memory[i, lane] = memory[i, last]
                    state[2 + lane] = state[2 + last]
                    state[0] = last
                    continue
                else:
                    break
            lane += 1
        if state[0] == 0:
            return
        for i in range(calls.shape[0]):
            call_kernel(calls[i, 0], calls[i, 1], calls[i, 2], memory.shape[1])
        for i in range(rows):
            for j in range(memory.shape[1]):
                memory[first + i, j] = memory[following + i, j]
