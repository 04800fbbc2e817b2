"""The memory of the lanes that are solved side by side, and the kernels bound to it.

Every name that a kernel reads or writes is some rows of one memory, whose columns are
the lanes. Names of an interval: x, u, m (multipliers), and the step k, K. Names of the
ends: y (the decisions about the start), end (the state at the end), slope and bend
(gradient and Hessian of the augmented Lagrangian by it). Names of a lane: value (the
augmented Lagrangian), mu, theta, length (of the step to try; 0 if the lane must be
rolled out), paid (the cost), worst (the worst excess), and those of `Schedule`. A name
that ends in `_new` is the value after the step.
"""

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.lanes.stages import Kernel
from swarmstart.ocp.lanes.sweep_kernels import Sweeps
from swarmstart.ocp.lanes.turns import Rows

Count = NDArray[np.int64]

_NEXT = "next."
_FIRST = "x0"
"""The state at the start: the first rows of x."""


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """The names of the memory's rows.

    Attributes:
        places: First row and number of rows of each name.
        size: Total number of rows.
        rows: Rows that the loop reads itself.
    """

    places: Mapping[str, tuple[int, int]]
    size: int
    rows: Rows

    def at(self, *names: str) -> Count:
        """Return the rows of names, one after the other."""
        places = [self.places[name] for name in names]
        return np.concatenate([np.arange(i, i + n) for i, n in places])


def layout_of(sweeps: Sweeps) -> Layout:
    """Return the rows that kernels need."""
    sizes = _sizes(sweeps)
    following = [name for name in sizes if name.startswith(_NEXT)]
    state = [name.removeprefix(_NEXT) for name in following]
    others = [name for name in sizes if name not in (*following, *state, _FIRST)]
    places, first = {}, 0
    for name in (*state, *following, *others):
        places[name] = first, sizes[name]
        first += sizes[name]
    if _FIRST in sizes:
        places[_FIRST] = places["x"][0], sizes[_FIRST]
    named = {name: place for name, (place, _) in places.items() if name in Rows._fields}
    size = sum(sizes[name] for name in following)
    rows = Rows(state=0, following=places[following[0]][0], size=size, **named)
    return Layout(places, first, rows)


def _sizes(sweeps: Sweeps) -> dict[str, int]:
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
        self, sweeps: Sweeps, layout: Layout, lanes: int, shared: Mapping[str, Array]
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
