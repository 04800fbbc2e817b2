"""The motion over one hold of the input, by Runge-Kutta steps.

The map F of a hold takes n steps; its curve (`residual.py`) is given step by step,
relative to the reference's own. Measurements on it here only suggest what to try to
prove.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from swarmstart.terminal_set.certificates.design import TerminalSet
from swarmstart.terminal_set.linear.ellipsoid import Ellipsoid
from swarmstart.terminal_set.proving.growth import PIECES, Hold
from swarmstart.terminal_set.proving.residual import ORDER, Residual

SAMPLES = 500
RADII = (0.01, 0.3, 0.6, 0.8, 0.9, 1.0)
"""Radii at which every sample is measured, relative to the set's radius."""
TIMES = 50
"""Least number of times in a hold at which the growth is measured."""


class HeldMotion:
    """The motion over one hold, by the Runge-Kutta map.

    Attributes:
        law: The design.
        dt: Time for which the input is held [s].
        step: F(x, u) -> x after dt.
        holds: A function for each step: (e, t) -> the deviation at t after its
            beginning.
        residual: Residual of the curve.
    """

    def __init__(
        self, dynamics: ca.Function, law: TerminalSet, *, dt: float, substeps: int
    ) -> None:
        """Build the maps."""
        h, one = dt / substeps, ca.simpleRK(dynamics, 1, ORDER).expand()
        x = ca.SX.sym("x", dynamics.size1_in(0))
        u = ca.SX.sym("u", dynamics.size1_in(1))
        map_ = ca.simpleRK(dynamics, substeps, ORDER).expand()
        self.step = ca.Function("step", [x, u], [map_(x, u, dt)])
        e, t = ca.SX.sym("e", x.numel()), ca.SX.sym("t")
        held, pieces = ca.DM(law.u_ref) - ca.DM(law.K) @ e, -(-PIECES // substeps)
        now, holds = ca.DM(law.x_ref) + e, []
        for _ in range(substeps):
            after = one(now, held, t)
            # The same operations on the same numbers: exactly 0 at 0.
            after -= ca.substitute(after, e, ca.DM.zeros(e.shape))
            motion = ca.Function("motion", [e, t], [after])
            holds.append(Hold(motion=motion, P=law.P, dt=h, pieces=pieces))
            now = one(now, held, h)
        self.law, self.dt, self.holds = law, dt, tuple(holds)
        self.residual = Residual(dynamics, law, dt=dt, substeps=substeps)

    def measured(self, alpha: float, rng: np.random.Generator) -> tuple[float, bool]:
        """Measure the growth between samples, at states of a whole ellipsoid.

        Args:
            alpha: Level of the ellipsoid.
            rng: Source of randomness of the directions.

        Returns:
            The largest ratio of e'Pe in a hold and at its beginning, NaN if the motion
            is undefined; whether e'Pe decreases over the hold at every state.
        """
        directions = rng.normal(size=(len(self.law.P), SAMPLES))
        boundary = Ellipsoid(P=self.law.P, alpha=alpha).boundary(directions)
        e = np.hstack([radius * boundary for radius in RADII])
        size, growth, later = self.law.value(e), 1.0, np.empty(0)
        for hold in self.holds:
            motion = hold.motion.map(e.shape[1])
            for time in np.linspace(0.0, hold.dt, -(-TIMES // len(self.holds)) + 1)[1:]:
                later = self.law.value(np.array(motion(e, time)))
                growth = float(np.maximum(growth, (later / size).max()))  # Keeps NaN.
        return growth, bool(np.all(later < size))
