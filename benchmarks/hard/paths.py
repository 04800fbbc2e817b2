"""Paths in the plane as segments and arcs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swarmstart.benchmarks.hard.blocks import Point


@dataclass(frozen=True, slots=True)
class Segment:
    """Straight piece of a path, from point to point [m]."""

    start: Point
    end: Point

    @property
    def length(self) -> float:
        """Length [m]."""
        return float(np.hypot(*np.subtract(self.end, self.start)))

    def point(self, share: float) -> Point:
        """Return the point after a share of the length, from 0 to 1."""
        x, y = np.add(np.multiply(self.start, 1 - share), np.multiply(self.end, share))
        return float(x), float(y)


@dataclass(frozen=True, slots=True)
class Arc:
    """Piece of a path along a corner.

    Attributes:
        center: Centre of the circle [m].
        radius: Its radius [m].
        angle: Direction from the centre to the start of the arc [rad].
        sweep: Angle turned, positive counter-clockwise [rad].
    """

    center: Point
    radius: float
    angle: float
    sweep: float

    @property
    def length(self) -> float:
        """Length [m]."""
        return abs(self.sweep) * self.radius

    def point(self, share: float) -> Point:
        """Return the point after a share of the length, from 0 to 1."""
        angle = self.angle + share * self.sweep
        x, y = self.center
        cos, sin = float(np.cos(angle)), float(np.sin(angle))
        return x + self.radius * cos, y + self.radius * sin


Piece = Segment | Arc


@dataclass(frozen=True, slots=True)
class ShortestPath:
    """A shortest path: its length [m] and its pieces in order, start to goal."""

    length: float
    pieces: tuple[Piece, ...]

    @property
    def cost(self) -> float:
        """Minimum of the integral of u'u over one second for x' = u [m^2/s]."""
        return self.length**2
