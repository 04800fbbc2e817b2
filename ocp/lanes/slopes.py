"""Local solves of many starts at once by gradients: for stages too long for sweeps.

The gradient of a rollout by its controls, from the last interval back (the adjoint
equation), and projected L-BFGS within the bounds (heuristics/descent.py). Lanes renew
their multipliers together, after each descent.
"""

import numpy as np
from numpy.typing import NDArray

from swarmstart.heuristics.box import Box
from swarmstart.heuristics.descent import DescentOptions, descend
from swarmstart.ocp.compiled.simd import SimdBatch
from swarmstart.ocp.lanes.augmented import (
    AugmentedSolver,
    LaneAnswers,
    LaneOptions,
    Lanes,
    none_found,
    write_down,
)
from swarmstart.ocp.lanes.posed import Posed

Array = NDArray[np.float64]


def solve_by_slopes(
    posed: Posed,
    adjoint: SimdBatch,
    controls: Array,
    starts: Array,
    *,
    weights: tuple[Array, Array],
    options: LaneOptions | None = None,
) -> LaneAnswers:
    """Return the local optima that many starts lead to.

    Args:
        posed: The problem from one initial state; all that is decided has bounds.
        adjoint: The machine code of the gradient; see `kernels.compile_adjoint`.
        controls: Shape (nu, N, n), within their bounds.
        starts: What is decided about the start, shape (ny, n), within its bounds.
        weights: First weights of the rows of intervals and of the end, each (n,).
        options: When lanes end; None means the defaults.
    """
    options = options or LaneOptions()
    solver = _Descending(posed, adjoint, options)
    found = none_found(posed, controls, starts)
    lanes = solver.begun(posed.scaled(controls), starts / posed.start_sizes, weights)
    while lanes.count:
        solver.descend(lanes)
        every = np.arange(lanes.count)
        ended, cost, worst = solver.renew(lanes, every)
        write_down(found, posed, lanes.kept(ended), cost, worst)
        lanes = lanes.kept(np.setdiff1d(every, ended))
    return found


class _Descending(AugmentedSolver):
    """The inner loop by gradients."""

    def __init__(self, posed: Posed, adjoint: SimdBatch, options: LaneOptions) -> None:
        super().__init__(posed, options)
        self._adjoint = adjoint
        self._box = Box(
            lower=np.concatenate([np.tile(posed.least, self.N), posed.first_least]),
            upper=np.concatenate([np.tile(posed.most, self.N), posed.first_most]),
        )

    def descend(self, lanes: Lanes) -> None:
        """Make the augmented Lagrangians as small as their tolerance asks."""
        split = self.N * self.nu

        def sloped(w: Array, numbers: NDArray[np.int64]) -> tuple[Array, Array]:
            some = lanes.kept(numbers)
            some.u, some.y = (np.ascontiguousarray(p) for p in np.split(w, [split]))
            return self._sloped(some)

        # A tenth of what the lane asks, as single steps gain less than they could.
        tolerance = 0.1 * float(lanes.tolerance.min())
        found = descend(
            sloped,
            self._box,
            np.vstack([lanes.u, lanes.y]),
            DescentOptions(tolerance=tolerance, slope=tolerance),
        )
        lanes.u, lanes.y = (np.ascontiguousarray(p) for p in np.split(found.x, [split]))
        lanes.iterations = lanes.iterations + found.iterations
        self.roll_out(lanes)

    def _sloped(self, lanes: Lanes) -> tuple[Array, Array]:
        """Return values (n,) and gradients by controls and decisions of the start."""
        self.roll_out(lanes)
        _, ahead, *_ = self.at_end(lanes.end, lanes)
        ahead, of_controls = self._adjoint.evaluate(
            [ahead, lanes.x, lanes.u, lanes.m, lanes.r, *self.posed.interval]
        )
        if self.posed.begin is not None:
            ahead = ahead + self.at_begin(lanes.x0, lanes)[1]
        return lanes.value[0], np.vstack([of_controls, self.posed.tied.T @ ahead])
