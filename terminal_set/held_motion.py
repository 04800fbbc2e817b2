"""The motion over one hold of the input, and what a proof of it must allow for.

F is the Runge-Kutta map of a hold, phi the flow, both relative to the reference's own
motion. Measured at states of the whole set, against an integration FINER times finer:

    c with |phi(e) - F(e)|_P <= c |e|_P
    g with e'Pe at any time of the hold <= g e'Pe at its beginning

c at the end of the hold; in it the map takes shorter steps.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.terminal_set.certificate import HeldMargins
from swarmstart.terminal_set.design import TerminalSet
from swarmstart.terminal_set.ellipsoid import Ellipsoid
from swarmstart.terminal_set.growth import Hold

Array = NDArray[np.float64]

RESERVE = 10.0
"""How many times the measured error of the integrator the proof allows for."""
SAMPLES = 2000
RADII = (0.01, 0.3, 0.6, 0.8, 0.9, 1.0)
"""At which parts of the set's radius the margins are measured, for every sample."""
FINER = 50
"""Steps of the fine integration in one of the map's; the growth is measured at each."""
GROWTH_RESERVE = 1.1
LEAST_GROWTH = 1.05


class HeldMotion:
    """The motion over one hold: by the Runge-Kutta map, and much finer.

    Attributes:
        law: The design.
        step: F(x, u) -> x after dt.
        hold: (e, t) -> the deviation after t, by as many steps.
    """

    def __init__(
        self, dynamics: ca.Function, law: TerminalSet, *, dt: float, substeps: int
    ) -> None:
        """Build the maps."""
        x = ca.SX.sym("x", dynamics.size1_in(0))
        u = ca.SX.sym("u", dynamics.size1_in(1))
        map_ = ca.simpleRK(dynamics, substeps, 4).expand()
        self.step = ca.Function("step", [x, u], [map_(x, u, dt)])
        self._piece = ca.Function("piece", [x, u], [map_(x, u, dt / FINER)])
        e, t = ca.SX.sym("e", x.numel()), ca.SX.sym("t")
        x_ref, u_ref = ca.DM(law.x_ref), ca.DM(law.u_ref)
        after = map_(x_ref + e, u_ref - ca.DM(law.K) @ e, t) - map_(x_ref, u_ref, t)
        self.hold = Hold(motion=ca.Function("motion", [e, t], [after]), P=law.P, dt=dt)
        self.law, self._substeps = law, substeps

    def margins(
        self, alpha: float, rng: np.random.Generator
    ) -> tuple[HeldMargins, bool]:
        """Measure the error of the map and the growth between samples.

        Args:
            alpha: Level of the ellipsoid.
            rng: Of the directions.

        Returns:
            The margins, and whether e'Pe fell over the hold at every sample.
        """
        law = self.law
        directions = rng.normal(size=(len(law.P), SAMPLES))
        boundary = Ellipsoid(P=law.P, alpha=alpha).boundary(directions)
        e = np.hstack([radius * boundary for radius in RADII])
        x = np.hstack([e, np.zeros((len(law.P), 1))]) + law.x_ref[:, None]
        u = np.hstack([law.feedback(e), np.zeros((len(law.u_ref), 1))])
        u += law.u_ref[:, None]
        size, growth = law.value(e), 1.0
        piece, now = self._piece.map(x.shape[1]), x
        for _ in range(FINER):
            now = np.array(piece(now, u))
            # Not Python's max, which would drop NaN.
            grown = (law.value(_relative(now)) / size).max()
            growth = float(np.maximum(growth, grown))
        mapped = np.array(self.step.map(x.shape[1])(x, u))
        error = law.value(_relative(now) - _relative(mapped)) / size
        falls = bool(np.all(law.value(_relative(now)) < size))
        measured = HeldMargins(
            substeps=self._substeps,
            integrator_error=RESERVE * float(np.sqrt(error.max())),
            samples=e.shape[1],
            growth=float(np.maximum(LEAST_GROWTH, GROWTH_RESERVE * growth)),
            growth_is_proven=False,
        )
        return measured, falls


def _relative(x: Array) -> Array:
    """Return the deviations from the last column, which is the reference's."""
    return x[:, :-1] - x[:, -1:]
