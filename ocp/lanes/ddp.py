"""Local solves of many starts at once: differential dynamic programming in lanes.

A step is a backward sweep and a roll-out (sweep_kernels.py); verdict.py judges it, and
turns.py repeats steps. Lanes are independent: an answer has the same bits for any lanes
beside it and any number of threads.

Some lanes are solved side by side in one memory, whose columns they are (`Block`).
Every name that a kernel reads or writes is some rows of it. Names of an interval: x, u,
m (multipliers), and the step k, K. Names of the ends: y (the decisions about the
start), end (the state at the end), slope and bend (gradient and Hessian of the
augmented Lagrangian by it). Names of a lane: value (the augmented Lagrangian), mu,
theta, length (of the step to try; 0 if the lane must be rolled out), paid (the cost),
worst (the worst excess), and those of `Schedule`. A name that ends in `_new` is the
value after the step.
"""

import ctypes
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.machine_code import prepare
from swarmstart.ocp.compiled.threads import together
from swarmstart.ocp.lanes.answers import LaneAnswers
from swarmstart.ocp.lanes.posed import Posed
from swarmstart.ocp.lanes.stages import Kernel, LaneOptions
from swarmstart.ocp.lanes.sweep_kernels import Sweeps
from swarmstart.ocp.lanes.turns import Ends, Rows, Starts, take_turns

_NEXT = "next."
_FIRST = "x0"
"""The state at the start: the first rows of x."""

Count = NDArray[np.int64]

SIDE_BY_SIDE = 32
"""Number of lanes in one memory, so small that it fits into a core's own cache."""
_TURNS = 256
"""Number of turns between two checks for Ctrl-C."""
_FIRST_MU = 1e-6
_BROUGHT = "u", "y", "r", "r_end"
_KEPT = "u", "y", "x", "end", "paid", "worst", "iterations"


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """The names of the memory's rows.

    Attributes:
        places: First row and number of rows of each name.
        size: Total number of rows.
    """

    places: Mapping[str, tuple[int, int]]
    size: int

    def at(self, *names: str) -> Count:
        """Return the rows of names, one after the other."""
        places = [self.places[name] for name in names]
        return np.concatenate([np.arange(i, i + n) for i, n in places])


def layout_of(sweeps: Sweeps) -> tuple[Layout, Rows]:
    """Return the rows that kernels need, and those that the loop reads."""
    sizes = kernel_sizes(sweeps)
    following = [name for name in sizes if name.startswith(_NEXT)]
    state = [name.removeprefix(_NEXT) for name in following]
    others = [name for name in sizes if name not in (*following, *state, _FIRST)]
    places, first = {}, 0
    # In one order, so that the loop copies the states after a turn as one block.
    for name in (*state, *following, *others):
        places[name] = first, sizes[name]
        first += sizes[name]
    if _FIRST in sizes:
        places[_FIRST] = places["x"][0], sizes[_FIRST]
    named = {name: place for name, (place, _) in places.items() if name in Rows._fields}
    size = sum(sizes[name] for name in following)
    rows = Rows(state=0, following=places[following[0]][0], size=size, **named)
    return Layout(places, first), rows


def kernel_sizes(sweeps: Sequence[Kernel]) -> dict[str, int]:
    """Return the number of rows of each name, and of all states."""
    sizes: dict[str, int] = {}
    for kernel in sweeps:
        shape = kernel.code.shape
        own = zip(kernel.reads, shape.inputs, shape.per_individual, strict=True)
        sizes |= {name: rows for name, rows, is_own in own if is_own}
        sizes |= dict(zip(kernel.writes, shape.outputs, strict=True))
    return sizes | {
        name.removeprefix(_NEXT): rows
        for name, rows in sizes.items()
        if name.startswith(_NEXT)
    }


class Block:
    """Memory for some lanes.

    Attributes:
        memory: Shape (rows, lanes).
        calls: Address of `part`, of its arguments and of its outputs for each kernel.
    """

    def __init__(
        self,
        sweeps: Sequence[Kernel],
        layout: Layout,
        lanes: int,
        shared: Mapping[str, Array],
    ) -> None:
        """Bind kernels to fresh memory.

        Args:
            sweeps: The kernels.
            layout: Layout of the memory.
            lanes: Number of lanes.
            shared: Shared arguments by name; must live as long as this object.
        """
        self.memory = np.zeros((layout.size, lanes))
        self._places = {name: first for name, (first, _) in layout.places.items()}
        self._shared, self._tables = shared, list[object]()
        self.calls = np.array([self._call(kernel) for kernel in sweeps])

    def _call(self, kernel: Kernel) -> tuple[int, int, int]:
        tables = self._table(kernel.reads), self._table(kernel.writes)
        self._tables.append(tables)
        reads, writes = map(ctypes.addressof, tables)
        return kernel.code.part_address, reads, writes

    def _table(self, names: tuple[str, ...]) -> ctypes.Array[ctypes.c_void_p]:
        return (ctypes.c_void_p * len(names))(*map(self._address, names))

    def _address(self, name: str) -> int:
        if name in self._shared:
            return int(self._shared[name].__array_interface__["data"][0])
        base, width = self.memory.__array_interface__["data"][0], self.memory.strides[0]
        return int(base + width * self._places[name])


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """Starts of one problem.

    Attributes:
        sweeps: The machine code.
        layout: Layout of the memory.
        rows: Rows that the loop reads.
        shared: Arguments that all lanes share.
        starts: All starts.
        ends: Results of the lanes.
        stop: Set when the remaining starts need not be solved.
    """

    sweeps: Sweeps
    layout: Layout
    rows: Rows
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
    n, (layout, rows) = controls.shape[2], layout_of(sweeps)
    y = starts / posed.start_sizes
    given = np.vstack([posed.scaled(controls), y, *(w[None, :] for w in weights)])
    kept = layout.at(*_KEPT)
    task = _Task(
        sweeps=sweeps,
        layout=layout,
        rows=rows,
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
    # Multipliers, which are 0 at first, are divided by it.
    blank[layout.at("r_was")] = 1.0
    blank[layout.at("tolerance")] = options.first_tolerance
    # A violation that was infinite before makes no weight grow.
    blank[layout.at("broken", "broken_end", "paid", "worst")] = np.inf
    return blank


def _solve(task: _Task, numbers: Count) -> None:
    """Solve some of the starts."""
    lanes = min(SIDE_BY_SIDE, numbers.size)
    block = Block(task.sweeps, task.layout, lanes, task.shared)
    work = np.zeros(2 + lanes, dtype=np.int64)
    given = (
        block.calls, block.memory, task.rows,
        task.starts._replace(numbers=numbers), task.ends, work, _TURNS,
    )  # fmt: skip
    prepare(take_turns, *given)
    try:
        while (work[0] or work[1] < numbers.size) and not task.stop.is_set():
            take_turns(*given)
    # Ctrl-C in one thread must end the others too.
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
