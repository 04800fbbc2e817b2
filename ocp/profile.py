"""Controls over the time of a plan: held one after another, or linear between knots."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Profile:
    """Controls held one after another, or knots with lines between them.

    Attributes:
        controls: Held one after another, or the knots at the ends, shape (nu, m).
        piece: How long each is held, or the time between knots [s].
        start: The first knot, shape (nu,); None: controls are held.
    """

    controls: Array
    piece: float
    start: Array | None = None

    @property
    def is_held(self) -> bool:
        """Whether controls are held, not linear."""
        return self.start is None

    def at(self, times: Array) -> Array:
        """Return the controls at times (n,) [s], shape (nu, n).

        Those that are held jump, to what comes next; before and after stay the first
        and the last.
        """
        m = self.controls.shape[1]
        if self.start is None:
            return self.controls[:, np.clip((times / self.piece).astype(int), 0, m - 1)]
        knots, at = np.hstack([self.start[:, None], self.controls]), np.arange(m + 1)
        rows = [np.interp(times / self.piece, at, row) for row in knots]
        return np.array(rows).reshape(len(knots), times.size)

    def ends(self, dt: float, steps: int) -> Array:
        """Return the controls at both ends of equal steps, shape (nu, steps + 1).

        Args:
            dt: Length of all steps together [s].
            steps: Number of steps.
        """
        return self.at(dt * (np.arange(steps + 1) / steps))

    def sampled(self, begin: float, dt: float, steps: int) -> Array:
        """Return the controls in the middle of equal steps, shape (nu, steps).

        Args:
            begin: Time of the first step's beginning [s].
            dt: Length of all steps together [s].
            steps: Number of steps.
        """
        return self.at(begin + (np.arange(steps) + 0.5) * dt / steps)
