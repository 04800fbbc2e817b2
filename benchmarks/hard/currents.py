"""Currents in the plane: a uniform one, a linear one, and vortices, with derivatives.

    w(p) = w0 + A p + sum over k of G_k perp(p - c_k) / (|p - c_k|^2 + core^2)

with perp(d) = (-d_y, d_x). A vortex turns counter-clockwise if G_k > 0; its greatest
speed is |G_k| / (2 core), at the distance core.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swarmstart.arrays import Array
from swarmstart.benchmarks.hard.blocks import Point


@dataclass(frozen=True, slots=True)
class Vortex:
    """A vortex.

    Attributes:
        center: c [m].
        strength: G [m^2/s].
        core: Radius of the core, above 0 [m].

    Raises:
        ValueError: If a number is not finite, or the core is not above 0.
    """

    center: Point
    strength: float
    core: float

    def __post_init__(self) -> None:
        """Validate the numbers."""
        if not (np.isfinite((*self.center, self.strength, self.core)).all()) or not (
            self.core > 0
        ):
            raise ValueError(
                f"a vortex needs finite numbers and a core > 0, got {self}"
            )


@dataclass(frozen=True, slots=True)
class Current:
    """A current.

    Attributes:
        vortices: Vortices.
        uniform: w0 [m/s].
        linear: Rows of A [1/s].
    """

    vortices: tuple[Vortex, ...] = ()
    uniform: Point = (0.0, 0.0)
    linear: tuple[Point, Point] = ((0.0, 0.0), (0.0, 0.0))

    def velocity(self, p: Array) -> Array:
        """Return w at points of shape (2, ...), in their shape [m/s]."""
        w = np.einsum("ij,j...->i...", self.linear, p)
        w += np.reshape(self.uniform, (2, *[1] * (p.ndim - 1)))
        for vortex in self.vortices:
            x, y, square = _apart(p, vortex)
            w += vortex.strength / square * np.array([-y, x])
        return np.asarray(w)

    def jacobian(self, p: Array) -> Array:
        """Return the derivatives dw_i/dp_j, shape (2, 2, ...) [1/s]."""
        shape = (2, 2, *[1] * (p.ndim - 1))
        derivatives = np.zeros((2, 2, *p.shape[1:])) + np.reshape(self.linear, shape)
        for vortex in self.vortices:
            x, y, square = _apart(p, vortex)
            turning = np.zeros(derivatives.shape) + np.reshape([[0, -1], [1, 0]], shape)
            fading = 2 / square * np.array([[-y * x, -y * y], [x * x, x * y]])
            derivatives += vortex.strength / square * (turning - fading)
        return np.asarray(derivatives)


def _apart(p: Array, vortex: Vortex) -> tuple[Array, Array, Array]:
    x, y = p[0] - vortex.center[0], p[1] - vortex.center[1]
    return x, y, x**2 + y**2 + vortex.core**2
