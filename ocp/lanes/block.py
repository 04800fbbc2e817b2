"""The memory of the lanes that are solved side by side, and the kernels bound to it.

Every name that a kernel reads or writes is some rows of one memory, whose columns are
the lanes. Of an interval: x, u, m (multipliers), the step k, K; at the ends: y (what is
decided about the start), end (the state there), slope and bend (gradient and Hessian of
the augmented Lagrangian by it); for a lane: value (the augmented Lagrangian), mu,
theta, length (of the step to try; 0: it is to be rolled out), paid (the cost), worst
(excess), and where it stands in its schedule. A name in `_new` is after the step.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.compiled.simd import addresses
from swarmstart.ocp.lanes.stages import Kernel
from swarmstart.ocp.lanes.sweep_kernels import Sweeps

Array = NDArray[np.float64]
_NEXT = "next."
_FIRST = "x0"
"""The state at the start: the first rows of x."""


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Which rows of the memory have which name.

    Attributes:
        rows: First row and number of rows.
        size: Number of rows in all.
        state: First row of the state, number of its rows, first row of the next one.
    """

    rows: Mapping[str, tuple[int, int]]
    size: int
    state: tuple[int, int, int]

    def at(self, *names: str) -> NDArray[np.int64]:
        """Return the rows of names, one after the other."""
        parts = [np.arange(first, first + n) for first, n in map(self.rows.get, names)]
        return np.concatenate(parts)


def layout_of(sweeps: Sweeps) -> Layout:
    """Return the rows that kernels need."""
    sizes = {}
    for kernel in sweeps:
        shape = kernel.code.shape
        own = zip(kernel.reads, shape.inputs, shape.per_individual, strict=True)
        sizes |= {name: rows for name, rows, is_own in own if is_own}
        sizes |= dict(zip(kernel.writes, shape.outputs, strict=True))
    following = [name for name in sizes if name.startswith(_NEXT)]
    state = [name.removeprefix(_NEXT) for name in following]
    others = [name for name in sizes if name not in (*following, *state, _FIRST)]
    rows, first = {}, 0
    for name in (*state, *following, *others):
        size = sizes.get(name, sizes.get(_NEXT + name, 0))
        rows[name] = first, size
        first += size
    if _FIRST in sizes:
        rows[_FIRST] = rows["x"][0], sizes[_FIRST]
    many = sum(sizes[name] for name in following)
    return Layout(rows, first, (0, many, many))
