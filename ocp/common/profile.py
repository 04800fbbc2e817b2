"""Controls over the time of a plan: held one after another, or linear between knots."""

from dataclasses import dataclass

import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError


def piece_at(time: float, instants: Array) -> int:
    """Return the number of the interval that holds at a time.

    Args:
        time: Between the first and the last instant [s].
        instants: Ends of the intervals, shape (N + 1,) [s].

    Raises:
        InvalidProblemError: If the time is before the first or after the last instant.
    """
    if not instants[0] <= time <= instants[-1]:
        raise InvalidProblemError(
            f"time must be from {instants[0]:g} to {instants[-1]:g} s, got {time}"
        )
    after = int(np.searchsorted(instants, time, side="right"))
    return min(after, instants.size - 1) - 1


def rows_at(time: float, times: Array, rows: Array) -> Array:
    """Return the values of rows (m, n) at a time, linear between times (n,), (m,)."""
    return np.array([np.interp(time, times, row) for row in rows])


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Profile:
    """Controls held one after another, or knots joined by lines.

    Attributes:
        controls: Controls held one after another, or the knots at the ends, shape
            (nu, m).
        piece: Time for which each is held, or between knots [s].
        start: The first knot, shape (nu,); None: the controls are held.
    """

    controls: Array
    piece: float
    start: Array | None = None

    @property
    def is_held(self) -> bool:
        """True if the controls are held, not linear."""
        return self.start is None

    def at(self, times: Array) -> Array:
        """Return the controls at times (n,) [s], shape (nu, n).

        Held controls jump to the next value at its start. Before the first and after
        the last time, the first and the last value hold.
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
            dt: Total length of all steps [s].
            steps: Number of steps.
        """
        return self.at(dt * (np.arange(steps + 1) / steps))

    def sampled(self, begin: float, dt: float, steps: int) -> Array:
        """Return the controls in the middle of equal steps, shape (nu, steps).

        Args:
            begin: Start time of the first step [s].
            dt: Total length of all steps [s].
            steps: Number of steps.
        """
        return self.at(begin + (np.arange(steps) + 0.5) * dt / steps)

    def means(self, dt: float, steps: int) -> Array:
        """Return the means of held controls over equal steps, shape (nu, steps).

        A step within one piece has the control of this piece, bit for bit. A step
        across an edge has the mean, so that the integral of the controls is kept; the
        control in its middle would be wrong by a part of the jump.

        Args:
            dt: Total length of all steps [s].
            steps: Number of steps.
        """
        u, piece = self.controls, self.piece
        ends = dt * (np.arange(steps + 1) / steps)
        at = np.clip((ends / piece).astype(int), 0, u.shape[1] - 1)
        before = piece * (np.cumsum(u, axis=1) - u)
        integral = before[:, at] + (ends - at * piece) * u[:, at]
        mean = np.diff(integral, axis=1) / (dt / steps)
        one, other = u[:, at[:-1]], u[:, at[1:]]
        several = np.diff(at) > 1
        least = np.where(several, u.min(axis=1)[:, None], np.minimum(one, other))
        most = np.where(several, u.max(axis=1)[:, None], np.maximum(one, other))
        within: Array = np.clip(mean, least, most)  # Rounding must not break a bound.
        return within
