"""The tube of a certificate: a polytope that moves.

The tube of the file is { x : d_k x <= s_k(t) }, with s_k linear between the times.
Faces must satisfy d_k f < s_k' strictly: if a face rises just as fast as the fastest
trajectory, the check stays open, since rounding cannot decide it. Then no admissible
trajectory leaves the tube. To see it, take the last time up to which it stayed inside.
A face that it touches at this time has d_k f < s_k' there for all controls. As f is
continuous and the controls' box is compact, that also holds for some time after, in
which the trajectory does not cross the face. A face with s_k >= the largest d_k x over
the bounds of the states is not crossed by an admissible trajectory, for any f.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from swarmstart.ocp.lower_bound.checker.boxes import Boxes, Flags
from swarmstart.ocp.lower_bound.checker.certificate_file import Certificate
from swarmstart.ocp.lower_bound.checker.models import (
    ROUNDING,
    TINY,
    Array,
)


@dataclass(frozen=True, eq=False)
class Tube:
    """A polytope that moves.

    Attributes:
        directions: Shape (K, n).
        times: Shape (M + 1,).
        levels: Shape (M + 1, K).
    """

    directions: Array
    times: Array
    levels: Array

    @property
    def n(self) -> int:
        """Number of states."""
        return int(self.directions.shape[1])

    @cached_property
    def _largest(self) -> list[Array]:
        """Largest levels of 2^l times from the i-th on, for each l."""
        table = [self.levels]
        while 2 ** len(table) <= len(self.times):
            step = 2 ** (len(table) - 1)
            table.append(np.maximum(table[-1][:-step], table[-1][step:]))
        return table

    def level_at(self, t: Array) -> tuple[Array, Array]:
        """Return the levels at times and their rounding, each (K, N)."""
        last = len(self.times) - 2
        i = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, last)
        before, after = self.times[i], self.times[i + 1]
        share = np.clip((t - before) / (after - before), 0.0, 1.0)
        low, high = self.levels[i].T, self.levels[i + 1].T
        level = low + (high - low) * share
        return level, ROUNDING * (np.abs(low) + np.abs(high)) + TINY

    def highest(self, start: Array, stop: Array) -> Array:
        """Return upper bounds of the levels between times, shape (K, N)."""
        first, rounding = self.level_at(start)
        last, its = self.level_at(stop)
        most = np.maximum(first + rounding, last + its)
        i = np.searchsorted(self.times, start, side="right")
        j = np.searchsorted(self.times, stop, side="left")  # i, ..., j - 1 lie between
        for power, table in enumerate(self._largest):
            which = np.flatnonzero((j - i >= 2**power) & (j - i < 2 ** (power + 1)))
            if which.size:
                a, b = table[i[which]], table[j[which] - 2**power]
                most[:, which] = np.maximum(most[:, which], np.maximum(a, b).T)
        return most

    def cut(self, boxes: Boxes) -> tuple[Boxes, Flags]:
        """Drop what is outside of the tube.

        Args:
            boxes: Boxes.

        Returns:
            Smaller boxes; which boxes lie outside altogether.
        """
        n = self.n
        most = self.highest(boxes.lower[0], boxes.upper[0])
        lower, upper = boxes.lower.copy(), boxes.upper.copy()
        up, dn = np.maximum(self.directions, 0.0), np.minimum(self.directions, 0.0)
        x = slice(1, 1 + n)
        least = up @ lower[x] + dn @ upper[x]
        size = np.abs(self.directions) @ np.maximum(np.abs(lower[x]), np.abs(upper[x]))
        rounding = ROUNDING * (size + np.abs(most)) + TINY
        room = most - least + rounding  # of d_k x, above its least value
        outside = np.asarray((room < 0.0).any(axis=0), dtype=np.bool_)
        for k, direction in enumerate(self.directions):
            for i in np.flatnonzero(direction):
                reach = room[k] / abs(direction[i])
                reach += ROUNDING * np.abs(reach) + TINY
                pad = ROUNDING * np.abs(boxes.upper[1 + i] - boxes.lower[1 + i])
                if direction[i] > 0.0:
                    at = boxes.lower[1 + i] + reach
                    pad += ROUNDING * np.abs(boxes.lower[1 + i])
                    upper[1 + i] = np.fmin(upper[1 + i], at + pad)
                else:
                    at = boxes.upper[1 + i] - reach
                    pad += ROUNDING * np.abs(boxes.upper[1 + i])
                    lower[1 + i] = np.fmax(lower[1 + i], at - pad)
        return Boxes(lower, upper, boxes.slab), outside

    def holds(self, boxes: Boxes, *, but: int | None = None) -> Flags:
        """Return which points are certainly inside.

        Args:
            boxes: Boxes without width.
            but: Number of a face that is ignored.
        """
        x = boxes.lower[1 : 1 + self.n]
        level, rounding = self.level_at(boxes.lower[0])
        rounding += ROUNDING * (np.abs(self.directions) @ np.abs(x)) + TINY
        inside = self.directions @ x + rounding <= level
        if but is not None:
            inside[but] = True
        return np.asarray(inside.all(axis=0), dtype=np.bool_)

    def holds_exactly(self, x: tuple[float, ...]) -> int | None:
        """Return the number of a face that a point violates at the start, or None."""
        for k, direction in enumerate(self.directions):
            pairs = zip(direction, x, strict=True)
            value = Fraction()
            for entry, state in pairs:
                value += Fraction(float(entry)) * Fraction(state)
            if value > Fraction(float(self.levels[0, k])):
                return k
        return None


def stated_tube(certificate: Certificate) -> Tube:
    """Return the tube of the file."""
    return Tube(
        directions=np.array(certificate.directions),
        times=np.array(certificate.times),
        levels=np.array(certificate.levels),
    )


def is_cut_off(
    direction: Array, levels: tuple[float, float], certificate: Certificate
) -> bool:
    """Return whether the bounds of the states alone imply d x <= levels.

    Args:
        direction: d, shape (n,).
        levels: Levels at both ends of a slab.
        certificate: Certificate with the bounds.
    """
    lower, upper = certificate.problem.state_box
    most = Fraction()
    for entry, low, high in zip(direction, lower, upper, strict=True):
        end = high if entry > 0.0 else low
        if entry and end is None:
            return False
        if entry and end is not None:
            most += Fraction(float(entry)) * Fraction(end)
    return most <= Fraction(float(min(levels)))
