"""Lanes side by side in one block of memory, and all starts solved in such blocks.

Every name that a kernel reads or writes stands for some rows of the memory, whose
columns are the lanes. For any name x, the rows of "next.x" hold the value of x after a
turn, which is a trial of a step's length (turns.py). Threads take equal shares of the
starts, each with a memory of its own.
"""

import ctypes
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.machine_code import prepare
from swarmstart.ocp.compiled.threads import together
from swarmstart.ocp.lanes.kernels import Kernel
from swarmstart.ocp.lanes.turns import Ends, Starts

Count = NDArray[np.int64]
NEXT = "next."


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


def placed(names: Sequence[str], sizes: Mapping[str, int]) -> Layout:
    """Return a layout with names one after the other.

    Args:
        names: The names.
        sizes: Number of rows of each.
    """
    places, first = {}, 0
    for name in names:
        places[name] = first, sizes[name]
        first += sizes[name]
    return Layout(places, first)


def kernel_sizes(kernels: Sequence[Kernel]) -> dict[str, int]:
    """Return the number of rows of each name that kernels read or write.

    If "next.x", the new value of a name x, is among them, so is x.
    """
    sizes: dict[str, int] = {}
    for kernel in kernels:
        shape = kernel.code.shape
        own = zip(kernel.reads, shape.inputs, shape.per_individual, strict=True)
        sizes |= {name: rows for name, rows, is_own in own if is_own}
        sizes |= dict(zip(kernel.writes, shape.outputs, strict=True))
    return sizes | {
        name.removeprefix(NEXT): rows
        for name, rows in sizes.items()
        if name.startswith(NEXT)
    }


class Block:
    """Memory for some lanes.

    Attributes:
        memory: The memory, shape (rows, lanes).
        calls: For each kernel the addresses of its function `part` (compiled/frame.py),
            of the table of its arguments, and of the table of its outputs.
    """

    def __init__(
        self,
        kernels: Sequence[Kernel],
        layout: Layout,
        lanes: int,
        shared: Mapping[str, Array],
    ) -> None:
        """Bind kernels to fresh memory.

        Args:
            kernels: The kernels.
            layout: Layout of the memory.
            lanes: Number of lanes.
            shared: Shared arguments by name; must live as long as this object.
        """
        self.memory = np.zeros((layout.size, lanes))
        self._places = {name: first for name, (first, _) in layout.places.items()}
        self._shared, self._tables = shared, list[object]()
        self.calls = np.array([self._call(kernel) for kernel in kernels])

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


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Job:
    """Starts of one problem.

    Attributes:
        kernels: The machine code, in the order of the loop.
        layout: Layout of the memory.
        rows: Rows of the memory that the loop reads.
        shared: Arguments that all lanes share.
        blank: Initial memory of any lane, shape (rows,).
        given: Given numbers, a column for each start.
        brought: Names of the given numbers.
        kept: Names of the results.
        loop: The compiled loop: (calls, memory, rows, starts, ends, work, turns).
        turns: Number of turns between two checks for Ctrl-C.
        side_by_side: Largest number of lanes in one memory.
    """

    kernels: Sequence[Kernel]
    layout: Layout
    rows: tuple[int, ...]
    shared: Mapping[str, Array]
    blank: Array
    given: Array
    brought: Sequence[str]
    kept: Sequence[str]
    loop: Callable[..., None]
    turns: int
    side_by_side: int


def results_of(job: Job, threads: int) -> list[Array]:
    """Solve from all starts, and return the results.

    Args:
        job: The starts.
        threads: Number of threads for the lanes.

    Returns:
        An array for each name in `job.kept`, with a column for each start.
    """
    layout, n = job.layout, job.given.shape[1]
    kept = layout.at(*job.kept)
    ends = Ends(np.empty((kept.size, n)), kept)
    # Set when the remaining starts need not be solved.
    stop = threading.Event()
    shares = np.array_split(np.arange(n), max(1, min(threads, n)))
    together([partial(_solve, job, ends, stop, one) for one in shares])
    sizes = [layout.places[name][1] for name in job.kept]
    return np.split(ends.found, np.cumsum(sizes)[:-1])


def _solve(job: Job, ends: Ends, stop: threading.Event, numbers: Count) -> None:
    """Solve some of the starts."""
    lanes = min(job.side_by_side, numbers.size)
    block = Block(job.kernels, job.layout, lanes, job.shared)
    work = np.zeros(2 + lanes, dtype=np.int64)
    rows = job.layout.at(*job.brought)
    given: tuple[Any, ...] = (
        block.calls, block.memory, job.rows,
        Starts(job.blank, job.given, rows, numbers), ends, work, job.turns,
    )  # fmt: skip
    prepare(job.loop, *given)
    try:
        while (work[0] or work[1] < numbers.size) and not stop.is_set():
            job.loop(*given)
    # Ctrl-C in one thread must end the others too.
    except BaseException:
        stop.set()
        raise
