"""Controls over time: their shape within an interval, blocks of intervals, a profile.

Within an interval controls are held, or linear between knots:

    constant    u(t) = v_k                                    from t_k to t_k+1
    linear      u(t) = q_k + (v_k - q_k) (t - t_k) / dt,   q_k+1 = v_k
    continuous  like linear, except that q_0 is given: the control before the horizon

v_k, k = 0 ... N - 1, are the controls of the core, the problem after all rewrites, and
keep their bounds. The knot q_k at the start of an interval is a state, which the end of
the interval sets to v_k. u(t) is a state with the rate (v_k - q_k) / dt; all
expressions use it in place of the control.

Move blocking: the intervals of a block share one control.

    blocks (1, 1, 2, 4):  u_0 | u_1 | u_2 = u_3 | u_4 = u_5 = u_6 = u_7

The grid of the states, the checks and the closed loop is not changed; only the number
of decisions falls. A search has one column of controls for each block. An NLP has the
equation u_k = u_k-1 within a block. The same equations tie the members of an ensemble
over the intervals in which they share their controls.

A `Profile` has the controls of a plan at any time.

Source: von Stryk and Bulirsch (1992), Direct and indirect methods for trajectory
optimization, Annals of Operations Research 37, for controls linear between nodes;
Cagienard, Grieder, Kerrigan and Morari (2007), Move blocking strategies in receding
horizon control, Journal of Process Control 17.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.limits import require_choice

ControlShape = Literal["constant", "linear", "continuous"]
Index = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Knots:
    """States of a rewritten problem (core) that make its controls linear.

    Attributes:
        now: The control at the present time, shape (nu, 1).
        first: The knot at the start of the interval, shape (nu, 1).
    """

    now: ca.SX
    first: ca.SX

    @property
    def states(self) -> ca.SX:
        """The states `now` and `first`, one after the other, shape (2 nu, 1)."""
        return ca.vertcat(self.now, self.first)

    def rates(self, controls: ca.SX, dt: float) -> ca.SX:
        """Return the rates of both states.

        Args:
            controls: Controls at the end of the interval, shape (nu, 1).
            dt: Length of an interval, in units of the core's time.
        """
        return ca.vertcat((controls - self.first) / dt, ca.SX.zeros(self.first.numel()))

    def after(self, controls: ca.SX) -> ca.SX:
        """Return both states after the end of an interval; `now` is continuous."""
        return ca.vertcat(self.now, controls)


def knot_names(control: str) -> tuple[str, str]:
    """Return the names of the two states that belong to a linear control."""
    return f"control {control}", f"knot of {control}"


def control_of(knot: str, controls: Sequence[str]) -> int | None:
    """Return the number of the control of a knot state; None for any other state."""
    return next((j for j, u in enumerate(controls) if knot == knot_names(u)[1]), None)


def require_shape(shape: str, *, is_discrete: bool, integer: int) -> None:
    """Raise if the shape is unknown or the controls can only be held.

    Args:
        shape: Shape of the controls.
        is_discrete: Whether the model is in discrete time.
        integer: Number of controls that take whole numbers.

    Raises:
        InvalidProblemError: If the shape is not allowed; the message has the value
            given and what is allowed.
    """
    require_choice("control_shape", shape, get_args(ControlShape))
    if shape == "constant":
        return
    if is_discrete:
        raise InvalidProblemError(
            "a discrete-time model has controls of steps: its control_shape must be "
            f"constant, got {shape!r}"
        )
    if integer:
        raise InvalidProblemError(
            "controls that take whole numbers are held: control_shape must be "
            f"constant, got {shape!r}"
        )


def split_knots(knots: Array, intervals: int) -> tuple[Array, Array]:
    """Return (first knot (nu,), controls (nu, N)) of knots or of held controls.

    Args:
        knots: Knots, shape (nu, N + 1); or held controls, shape (nu, N), whose first
            column is taken as the first knot.
        intervals: Number N of intervals.
    """
    if knots.shape[1] == intervals:
        return knots[:, 0], knots
    return knots[:, 0], knots[:, 1:]


def block_lengths(given: Sequence[int], intervals: int) -> tuple[int, ...]:
    """Return the validated block lengths; empty: every interval is its own block.

    Args:
        given: Number of intervals of each block, in order.
        intervals: Number N of intervals.

    Raises:
        InvalidProblemError: If they are not positive whole numbers with the sum N.
    """
    numbers = not isinstance(given, str) and all(
        isinstance(n, int | np.integer) and not isinstance(n, bool) and n > 0
        for n in given
    )
    if not numbers or (len(given) and sum(given) != intervals):
        raise InvalidProblemError(
            "blocks must be lengths, positive whole numbers, that sum to the "
            f"{intervals} intervals, got {given!r}"
        )
    lengths = tuple(int(n) for n in given)
    # Blocks of one interval each tie nothing.
    return () if len(lengths) == intervals else lengths


def block_numbers(blocks: Sequence[int], intervals: int) -> NDArray[np.intp]:
    """Return the number of the block that each interval belongs to, shape (N,)."""
    if not blocks:
        return np.arange(intervals)
    return np.repeat(np.arange(len(blocks)), blocks)


def first_intervals(blocks: Sequence[int], intervals: int) -> NDArray[np.intp]:
    """Return the first interval of each block."""
    numbers = block_numbers(blocks, intervals)
    return np.flatnonzero(np.diff(numbers, prepend=-1))


def control_labels(
    blocks: Sequence[int], intervals: int, *, controls: int, own: int, shared: int
) -> Index:
    """Return a label for each control of each interval, shape (controls, intervals).

    Controls that must be equal have the same label.

    Args:
        blocks: Lengths of the blocks; empty: every interval is its own block.
        intervals: Number N of intervals.
        controls: Number of controls, of all members of an ensemble together.
        own: Number of controls of one member; the controls of the members correspond by
            their number within the member.
        shared: Number of intervals in which all members have the same controls. A block
            that begins within them is shared up to its end.
    """
    block = block_numbers(blocks, intervals)
    first = first_intervals(blocks, intervals)[block]
    row = np.arange(controls)[:, None]
    return np.where(first < shared, row % own, row) + controls * block


def first_of(labels: Index) -> Index:
    """Return the index in ca.vec(labels) at which each label first occurs, ascending.

    Equal labels mark controls that must be equal.
    """
    return np.sort(np.unique(labels.ravel(order="F"), return_index=True)[1])


def variables_of(labels: Index) -> Index:
    """Return the number of each control's label, for the controls in ca.vec order.

    Labels are numbered from 0, in the order in which they first occur.
    """
    numbers = labels.ravel(order="F")
    rank = {label: place for place, label in enumerate(numbers[first_of(labels)])}
    return np.array([rank[label] for label in numbers], dtype=np.intp)


def ties(labels: Index) -> tuple[Index, Index]:
    """Return pairs (later, earlier) of controls that must be equal, as indices.

    They are indices in ca.vec(labels).
    """
    last: dict[int, int] = {}
    now, before = [], []
    for place, label in enumerate(labels.ravel(order="F").tolist()):
        if label in last:
            now.append(place)
            before.append(last[label])
        last[label] = place
    return np.array(now, dtype=np.intp), np.array(before, dtype=np.intp)


def same_in_labels(controls: Array, labels: Index) -> Array:
    """Return a copy of controls (nu, N) in which each label has its mean value."""
    values, number = controls.ravel(order="F"), variables_of(labels)
    count = np.bincount(number)
    means = np.bincount(number, weights=values) / count
    least, most = np.full(count.size, np.inf), np.full(count.size, -np.inf)
    np.minimum.at(least, number, values)
    np.maximum.at(most, number, values)
    # If all values are the same, keep them without rounding errors.
    found = np.where(least == most, least, means)[number]
    return found.reshape(controls.shape, order="F")


def averaged(controls: Array, blocks: Sequence[int]) -> Array:
    """Return a copy of controls (nu, N) in which each block has its mean value."""
    if not blocks:
        return controls.copy()
    first = first_intervals(blocks, controls.shape[1])
    lengths = np.array(blocks)
    means = np.add.reduceat(controls, first, axis=1) / lengths
    least, most = (
        f.reduceat(controls, first, axis=1) for f in (np.minimum, np.maximum)
    )
    # If all values are the same, keep them without rounding errors.
    return np.repeat(np.where(least == most, least, means), lengths, axis=1)


def piece_at(time: float, instants: Array) -> int:
    """Return the number of the interval that contains a time.

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
    """Return the linear interpolation of rows (m, n) at a time, shape (m,).

    The columns of the rows are the values at `times`, shape (n,).
    """
    return np.array([np.interp(time, times, row) for row in rows])


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Profile:
    """Controls held one after another, or knots joined by lines.

    Attributes:
        controls: Controls held one after another, or the knots at the ends of the
            pieces, shape (nu, m).
        piece: Time for which each control is held, or between two knots [s].
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
        # Integral up to the start of each piece.
        before = piece * (np.cumsum(u, axis=1) - u)
        integral = before[:, at] + (ends - at * piece) * u[:, at]
        mean = np.diff(integral, axis=1) / (dt / steps)
        one, other = u[:, at[:-1]], u[:, at[1:]]
        several = np.diff(at) > 1
        least = np.where(several, u.min(axis=1)[:, None], np.minimum(one, other))
        most = np.where(several, u.max(axis=1)[:, None], np.maximum(one, other))
        within: Array = np.clip(mean, least, most)  # Rounding must not break a bound.
        return within
