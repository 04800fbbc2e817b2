"""Local solves of many starts at once: differential dynamic programming in lanes.

A step is a backward sweep and a roll-out (sweep_kernels.py); verdict.py judges it, and
turns.py repeats steps. Lanes are independent: an answer has the same bits for any lanes
beside it and any number of threads.
"""

import threading
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.machine_code import prepare
from swarmstart.ocp.compiled.threads import together
from swarmstart.ocp.lanes.answers import LaneAnswers
from swarmstart.ocp.lanes.block import Block, Layout, layout_of
from swarmstart.ocp.lanes.posed import Posed
from swarmstart.ocp.lanes.schedule import LaneOptions
from swarmstart.ocp.lanes.sweep_kernels import Sweeps
from swarmstart.ocp.lanes.turns import Ends, Starts, take_turns

Count = NDArray[np.int64]

SIDE_BY_SIDE = 32
"""Number of lanes in one memory, so small that it fits into a core's own cache."""
_TURNS = 256
"""Number of turns between two checks for Ctrl-C."""
_FIRST_MU = 1e-6
_BROUGHT = "u", "y", "r", "r_end"
_KEPT = "u", "y", "x", "end", "paid", "worst", "iterations"


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """Starts of one problem.

    Attributes:
        sweeps: The machine code.
        layout: Layout of the memory.
        shared: Arguments that all lanes share.
        starts: All starts.
        ends: Results of the lanes.
        stop: Set when the remaining starts need not be solved.
    """

    sweeps: Sweeps
    layout: Layout
    shared: dict[str, Array]
    starts: Starts
    ends: Ends
    stop: threading.Event


def solve_by_sweeps(  # noqa: PLR0913 - starts and how they are solved
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
        starts: Decisions about the start, shape (ny, n), within their bounds.
        weights: First weights of the rows of intervals and of the end, each (n,). The
            lighter those of the end, the fewer and better optima are found.
        options: Conditions at which lanes end.
        threads: Number of threads for the lanes.
    """
    n, layout = controls.shape[2], layout_of(sweeps)
    y = starts / posed.start_sizes
    given = np.vstack([posed.scaled(controls), y, *(w[None, :] for w in weights)])
    kept = layout.at(*_KEPT)
    task = _Task(
        sweeps=sweeps,
        layout=layout,
        shared=posed.shared(),
        starts=Starts(
            _blank(layout, options),
            given,
            layout.at(*_BROUGHT),
            np.arange(n),
            options.most,
        ),
        ends=Ends(np.empty((kept.size, n)), kept),
        stop=threading.Event(),
    )
    shares = np.array_split(np.arange(n), max(1, min(threads, n)))
    together([partial(_solve, task, one) for one in shares])
    return _answers(posed, task)


def _blank(layout: Layout, options: LaneOptions) -> Array:
    """Return the initial memory of a lane; its length is 0, so it is rolled out."""
    blank = np.zeros(layout.size)
    blank[layout.at("mu")] = _FIRST_MU
    blank[layout.at("r_was")] = 1.0
    blank[layout.at("tolerance")] = options.first_tolerance
    blank[layout.at("broken", "broken_end", "paid", "worst")] = np.inf
    return blank


def _solve(task: _Task, numbers: Count) -> None:
    """Solve some of the starts."""
    lanes = min(SIDE_BY_SIDE, numbers.size)
    block = Block(task.sweeps, task.layout, lanes, task.shared)
    work = np.zeros(2 + lanes, dtype=np.int64)
    given = (
        block.calls, block.memory, task.layout.rows,
        task.starts._replace(numbers=numbers), task.ends, work, _TURNS,
    )  # fmt: skip
    prepare(take_turns, *given)
    try:
        while (work[0] or work[1] < numbers.size) and not task.stop.is_set():
            take_turns(*given)
    except BaseException:
        task.stop.set()
        raise


def _answers(posed: Posed, task: _Task) -> LaneAnswers:
    sizes = [task.layout.places[name][1] for name in _KEPT]
    parts = np.split(task.ends.found, np.cumsum(sizes)[:-1])
    u, y, x, end, cost, worst, iterations = parts
    return LaneAnswers(
        controls=posed.controls(u),
        starts=y * posed.start_sizes,
        states=posed.states(x, end),
        cost=cost[0] * posed.sizes.cost,
        violation=worst[0],
        iterations=iterations[0].astype(np.int64),
    )
