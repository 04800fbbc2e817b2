"""Local minima of many starts at once: projected L-BFGS within a box.

Each column is one start, with its own memory, step and end; the objective gives values
and gradients of all columns in one call. In coordinates scaled by the box's widths:

    d = -H g on the coordinates that no bound holds,  x <- P(x + a d)

with H from the last ten steps and P the projection onto the box. The full step is tried
first. If it fails (Armijo's condition), four shorter ones are tried side by side.

Source: Nocedal and Wright (2006), Numerical optimization, algorithm 7.4; Bertsekas
(1982), Projected Newton methods for optimization problems with simple constraints.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.heuristics.laws.box import Box

Numbers = NDArray[np.int64]
Sloped = Callable[[Array, Numbers], tuple[Array, Array]]
"""(population (dim, n), number of the start of each individual (n,)) -> (values (n,),
gradients (dim, n)). A start may have data of its own, hence its number."""

_SHORTER = np.array([0.5, 0.2, 0.05, 0.005])
_ARMIJO = 1e-4
_CURVED = 1e-12
"""Least curvature along a step that is kept, relative to the gradient's change."""
_FIRST = 0.1
"""Length of the first step: the steepest coordinate moves this part of its width."""
_AT_BOUND = 1e-12
"""Distance from a bound, in widths, up to which a coordinate counts as on it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class DescentOptions:
    """Conditions at which a descent ends.

    Attributes:
        iterations: Largest number of steps.
        memory: Number of steps that the curvature is taken from.
        tolerance: Relative decrease of the value below which a step counts as no
            progress; four such steps in a row end the descent.
        slope: Largest component of the projected gradient, scaled by the box's widths
            and relative to the value, at which the descent ends.
    """

    iterations: int = 300
    memory: int = 10
    tolerance: float = 1e-9
    slope: float = 1e-9


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Descended:
    """The local minima that starts led to.

    Attributes:
        x: Shape (dim, n), within the box.
        value: Shape (n,).
        iterations: Number of steps of each start, shape (n,).
    """

    x: Array
    value: Array
    iterations: Numbers


def descend(
    objective: Sloped,
    box: Box,
    starts: Array,
    options: DescentOptions | None = None,
) -> Descended:
    """Return the local minima that starts lead to.

    Args:
        objective: Values and gradients of a population; a step to a value that is not
            finite is rejected.
        box: The bounds.
        starts: Shape (dim, n), clipped to the box.
        options: Conditions at which a descent ends; None means the defaults.
    """
    options = options or DescentOptions()
    width = (box.upper - box.lower)[:, None]
    origin = box.lower[:, None]

    def placed(y: Array) -> Array:
        return np.clip(origin + width * y, origin, box.upper[:, None])

    def seen(y: Array, numbers: Numbers) -> tuple[Array, Array]:
        value, slope = objective(placed(y), numbers)
        # Infinity is above any other value, so that the step is rejected.
        lost = ~(np.isfinite(value) & np.isfinite(slope).all(axis=0))
        return np.where(lost, np.inf, value), np.where(lost, 0.0, slope * width)

    with np.errstate(divide="ignore", invalid="ignore"):  # 0 / 0 where x is fixed.
        y = np.where(width > 0, (starts - origin) / width, 0.0).clip(0.0, 1.0)
    value, slope = seen(y, np.arange(y.shape[1]))
    whole = Descended(
        x=placed(y), value=value.copy(),
        iterations=np.zeros(y.shape[1], dtype=np.int64),
    )  # fmt: skip
    columns = _Columns(y, value, slope, options.memory)
    for _ in range(options.iterations):
        if not columns.numbers.size:
            break
        ended = _step(columns, seen, options)
        whole.iterations[columns.numbers] += 1
        whole.x[:, columns.numbers] = placed(columns.y)
        whole.value[columns.numbers] = columns.value
        if ended.any():
            columns.keep(~ended)
    return whole


class _Columns:
    """The columns whose descent has not ended, and their memories."""

    def __init__(self, y: Array, value: Array, slope: Array, memory: int) -> None:
        self.numbers = np.arange(y.shape[1])
        self.y, self.value, self.slope = y, value, slope
        self.moves = np.zeros((memory, *y.shape))
        self.changes = np.zeros((memory, *y.shape))
        self.inverse = np.zeros((memory, y.shape[1]))
        self.still = np.zeros(y.shape[1], dtype=np.int64)
        self.first = np.full(y.shape[1], _FIRST)

    def keep(self, chosen: NDArray[np.bool_]) -> None:
        """Drop all columns but the chosen ones."""
        for name, values in vars(self).items():
            setattr(self, name, np.ascontiguousarray(values[..., chosen]))

    def direction(self) -> Array:
        """Return the step of each column, 0 on coordinates that a bound holds."""
        g, y = self.slope, self.y
        held = ((y <= _AT_BOUND) & (g > 0)) | ((y >= 1 - _AT_BOUND) & (g < 0))
        q, used = np.where(held, 0.0, g), range(len(self.inverse))
        along = np.zeros_like(self.inverse)
        # The two loops of algorithm 7.4, the newest step at 0. An empty place has the
        # inverse 0 and does nothing.
        for i in used:
            along[i] = self.inverse[i] * _dot(self.moves[i], q)
            q = q - along[i] * self.changes[i]
        steepest = np.maximum(np.abs(g).max(axis=0), 1e-300)
        # (7.20) by the newest step; without one, by the length of the first step.
        square = np.maximum(self.inverse[0] * _dot(self.changes[0], self.changes[0]), 0)
        known = square > 0
        scale = np.where(known, 1 / np.where(known, square, 1.0), self.first / steepest)
        q = q * scale
        for i in reversed(used):
            q = q + self.moves[i] * (
                along[i] - self.inverse[i] * _dot(self.changes[i], q)
            )
        # Without the held coordinates, H need not lead downhill; the gradient does.
        d = np.where(held, 0.0, -q)
        downhill = _dot(d, g) < 0
        return np.where(downhill, d, np.where(held, 0.0, -g) * scale)

    def remember(self, move: Array, change: Array, good: NDArray[np.bool_]) -> None:
        """Add good steps and their changes of the gradient to the memory."""
        product = _dot(move, change)
        usable = good & (product > _CURVED * _dot(change, change)) & (product > 0)
        for past, new in ((self.moves, move), (self.changes, change)):
            past[1:, :, usable] = past[:-1, :, usable]
            past[0][:, usable] = new[:, usable]
        self.inverse[1:, usable] = self.inverse[:-1, usable]
        self.inverse[0, usable] = 1 / product[usable]
        # The gradient's step failed as well, down to 0.005 of it: begin nearer.
        stuck = ~good & (self.inverse[0] == 0)
        self.first = np.where(stuck, 0.02 * self.first, _FIRST)
        self.inverse[:, ~good] = 0.0  # The memory is cleared.


def _step(
    columns: _Columns, seen: Sloped, options: DescentOptions
) -> NDArray[np.bool_]:
    """Take one step in every column; return which columns have ended."""
    d, before = columns.direction(), columns.value
    y = (columns.y + d).clip(0.0, 1.0)
    value, slope = seen(y, columns.numbers)
    low = before + _ARMIJO * np.minimum(_dot(columns.slope, y - columns.y), 0.0)
    failed = np.flatnonzero(~(value <= low))
    if failed.size:
        several = np.tile(failed, _SHORTER.size)
        length = np.repeat(_SHORTER, failed.size)
        tried = (columns.y[:, several] + length * d[:, several]).clip(0.0, 1.0)
        values, slopes = seen(tried, columns.numbers[several])
        best = values.reshape(_SHORTER.size, -1).argmin(axis=0)
        chosen = best * failed.size + np.arange(failed.size)
        y[:, failed], value[failed] = tried[:, chosen], values[chosen]
        slope[:, failed] = slopes[:, chosen]
    good = value < before
    with np.errstate(invalid="ignore"):
        fall = np.where(good, before - value, 0.0)
    y, slope = np.where(good, y, columns.y), np.where(good, slope, columns.slope)
    fresh = columns.inverse[0] == 0
    columns.remember(y - columns.y, slope - columns.slope, good)
    columns.y, columns.slope = y, slope
    columns.value = np.where(good, value, before)
    size = np.maximum(np.abs(columns.value), 1e-300)
    slow = fall <= options.tolerance * size
    # A step that failed with a memory is tried again without.
    columns.still = np.where(slow, columns.still + np.where(good | fresh, 1, 0), 0)
    projected = np.abs((y - slope).clip(0.0, 1.0) - y).max(axis=0)
    flat = projected <= options.slope * size
    return np.asarray((columns.still >= 4) | flat | ~np.isfinite(columns.value))  # noqa: PLR2004


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("dn,dn->n", a, b))
