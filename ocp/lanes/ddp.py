"""Local solves of many starts at once: differential dynamic programming in lanes.

A step is a sweep back and a roll-out (sweep_kernels.py); verdict.py says what it was
worth. Lanes do not know of each other: an answer has the same bits, whatever lanes
stand beside it, and on however many threads.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from swarmstart.kernel import prepare
from swarmstart.ocp.compiled.simd import addresses
from swarmstart.ocp.lanes.answers import LaneAnswers
from swarmstart.ocp.lanes.block import Layout, layout_of
from swarmstart.ocp.lanes.posed import Posed
from swarmstart.ocp.lanes.schedule import LaneOptions
from swarmstart.ocp.lanes.sweep_kernels import Sweeps
from swarmstart.ocp.lanes.turns import take_turns

Array = NDArray[np.float64]
Count = NDArray[np.int64]

SIDE_BY_SIDE = int(os.environ.get("LANES", "32"))
"""Lanes in one memory: it stays within a core's own cache."""
_TURNS = 256
"""Steps before Python looks whether it was interrupted."""


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """Starts to be solved, and where answers are written.

    Attributes:
        given: What each start brings, and the rows of the memory it comes to.
        found: What each lane ends with, and the rows of the memory it comes from.
        blank: What each lane begins with.
        layout: Of the memory.
        shared: What all lanes know, by name.
    """

    given: tuple[Array, Count]
    found: tuple[Array, Count]
    blank: Array
    layout: Layout
    shared: dict[str, Array]


def solve_by_sweeps(
    posed: Posed,
    sweeps: Sweeps,
    controls: Array,
    starts: Array,
    *,
    weights: tuple[Array, Array],
    options: LaneOptions,
    threads: int = 1,
) -> LaneAnswers:
    """Return the local optima that many starts lead to.

    Args:
        posed: The problem from one initial state.
        sweeps: The machine code of a step.
        controls: Shape (nu, N, n), within their bounds.
        starts: What is decided about the start, shape (ny, n), within its bounds.
        weights: First weights of the rows of intervals and of the end, each (n,): the
            lighter those of the end, the fewer and better the optima that are found.
        options: When lanes end.
        threads: Over how many threads lanes are spread.
    """
    n, layout = controls.shape[2], layout_of(sweeps)
    scaled, y = posed.scaled(controls), starts / posed.start_sizes
    given = np.vstack([scaled, y, *(np.reshape(w, (1, n)) for w in weights)])
    kept = "u", "y", "x", "end", "paid", "worst", "iterations"
    blank = np.zeros(layout.size)
    for name, value in (
        ("mu", 1e-6), ("tolerance", options.first_tolerance), ("broken", np.inf),
        ("broken_end", np.inf), ("paid", np.inf), ("worst", np.inf), ("r_was", 1.0)
    ):  # fmt: skip
        blank[layout.at(name)] = value
    rows = layout.at(*kept)
    found = np.empty((rows.size, n))
    task = Task((given, layout.at("u", "y", "r", "r_end")), (found, rows), blank, layout,
                posed.shared())  # fmt: skip
    shares = [np.arange(first, n, threads) for first in range(min(threads, n))]
    others = [_pool(os.getpid(), threads - 1).submit(_solve, task, sweeps, one) for one in shares[1:]]
    _solve(task, sweeps, shares[0])
    for one in others:
        one.result()
    return _answers(posed, task, kept)


@cache
def _pool(process: int, workers: int) -> ThreadPoolExecutor:
    del process
    return ThreadPoolExecutor(workers)


def _solve(task: Task, sweeps: Sweeps, numbers: Count) -> None:
    layout = task.layout
    width = SIDE_BY_SIDE
    memory = np.repeat(task.blank[:, None], width, axis=1)
    tables = []
    calls = np.empty((len(sweeps), 3), dtype=np.int64)
    base = memory.__array_interface__["data"][0]
    import ctypes
    for row, kernel in zip(calls, sweeps, strict=True):
        places = [
            task.shared[name].__array_interface__["data"][0] if name in task.shared
            else base + 8 * width * layout.rows[name][0]
            for name in kernel.reads
        ]
        out = [base + 8 * width * layout.rows[name][0] for name in kernel.writes]
        pair = [(ctypes.c_void_p * len(p))(*p) for p in (places, out)]
        tables.append(pair)
        row[:] = kernel.code.address, *map(ctypes.addressof, pair)
    first, rows, following = layout.state
    state = np.zeros(2 + width, dtype=np.int64)
    places = np.array([first, rows, following, layout.at("done")[0], _TURNS])
    while state[1] < numbers.size or state[0]:
        take_turns(calls, memory, task.blank, (*task.given, numbers), task.found, places, state)


def _answers(posed: Posed, task: Task, names: tuple[str, ...]) -> LaneAnswers:
    found, _ = task.found
    sizes = [task.layout.rows[name][1] for name in names]
    u, y, x, end, cost, worst, iterations = np.split(found, np.cumsum(sizes)[:-1])
    nx, n = posed.x0.size, found.shape[1]
    inner = np.moveaxis(x.reshape(posed.intervals, nx, n), 0, 1)
    return LaneAnswers(
        controls=np.ascontiguousarray(posed.controls(u)),
        starts=y * posed.start_sizes,
        states=np.concatenate([inner, end[:, None]], axis=1),
        cost=cost[0] * posed.sizes.cost,
        violation=worst[0].copy(),
        iterations=iterations[0].astype(np.int64),
    )
