"""Path of a run between the plant's steps: Hermite interpolation of degree 5.

One step of the plant has the length h, the start state a and the end state b; the
control and the parameters are held. Each state is interpolated by the polynomial of
degree 5 that has, at both ends, the state x, the rate x' = f(x, u, p) and the second
derivative x'' = df/dx f. Its Bernstein coefficients are

    a,  a + h/5 a',  a + 2h/5 a' + h^2/20 a'',
    b - 2h/5 b' + h^2/20 b'',  b - h/5 b',  b

The rates jump where the control jumps, so each piece has its own rates at its ends. The
error is at most h^6 / 46080 max |x^(6)|: below 1e-7 m in the scenarios that ship,
whereas a cubic, from the rates alone, is off by up to 4e-5 m.

Source: Hairer, Norsett and Wanner (1993), Solving Ordinary Differential Equations I,
section II.6; Farin (2002), Curves and Surfaces for CAGD, chapter 7.
"""

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.loop.closed_loop import Trajectory
from swarmstart.ocp.loop.plant import Plant
from swarmstart.ocp.system.model import Model

DEGREE = 5
choices = np.vectorize(math.comb, otypes=[np.float64])
"""Binomial coefficients, written out: importing scipy.special takes 0.1 s."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DenseOutput:
    """Continuous path of a closed-loop run.

    Attributes:
        step: Length of a piece, which is one step of the plant [s].
        curves: Bernstein coefficients of each state on each piece, shape
            (nx, pieces, 6); neither copied nor locked.
    """

    step: float
    curves: Array

    def __call__(self, times: ArrayLike) -> Array:
        """Return the states at given times, shape (nx, n).

        Args:
            times: Times within the run, shape (n,) [s].
        """
        elapsed = np.atleast_1d(np.asarray(times, dtype=np.float64)) / self.step
        piece = np.clip(elapsed.astype(int), 0, self.curves.shape[1] - 1)
        s, k = (elapsed - piece)[:, None], np.arange(DEGREE + 1)
        weights = choices(DEGREE, k) * s**k * (1.0 - s) ** (DEGREE - k)
        return np.asarray(np.einsum("xnk,nk->xn", self.curves[:, piece], weights))


def interpolate(plant: Plant, trajectory: Trajectory) -> DenseOutput:
    """Return the continuous path of a closed-loop run.

    Only times, controls and dense states are used, so a saved record is enough.

    Args:
        plant: The plant of the run.
        trajectory: The run, with the same number of plant steps in each interval.

    Returns:
        The path, a function of the time.

    Raises:
        InvalidProblemError: If the trajectory does not fit the plant, or its intervals
            do not all have the same number of steps.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        >>> falling = ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u))
        >>> run = ss.Trajectory(
        ...     times=np.array([0.0, 1.0]), dense_times=np.array([0.0, 1.0]),
        ...     states=np.array([[0.0, 1.0], [0.0, 2.0]]), controls=np.array([[2.0]]),
        ...     dense_states=np.array([[0.0, 1.0], [0.0, 2.0]]),
        ...     decisions=(), step_seconds=np.zeros(1),
        ... )
        >>> path = ss.interpolate(ss.Plant(falling, dt=1.0, substeps=1), run)
        >>> path(0.5).round(12)
        array([[0.25],
               [1.  ]])
    """
    substeps = _substeps(plant, trajectory)
    states, steps = trajectory.dense_states, trajectory.controls.shape[1]
    a, b, h = states[:, :-1], states[:, 1:], plant.dt / substeps
    held = np.repeat(trajectory.controls, substeps, axis=1)
    # As the plant computes them: a parameter may jump at a step's beginning.
    begins = np.arange(steps)[:, None] * plant.dt + plant.dt * (
        np.arange(substeps) / substeps
    )
    known = plant.parameters(begins.ravel())
    each = [np.hstack([a, b]), np.tile(held, 2), np.tile(known, 2)]
    found = _derivatives(plant.model).map(2 * steps * substeps)(*each)
    (a1, b1), (a2, b2) = (np.split(np.array(d), 2, axis=1) for d in found)
    inner = (
        a + h / 5 * a1,
        a + 2 * h / 5 * a1 + h**2 / 20 * a2,
        b - 2 * h / 5 * b1 + h**2 / 20 * b2,
        b - h / 5 * b1,
    )
    return DenseOutput(step=h, curves=np.stack([a, *inner, b], axis=-1))


def _derivatives(model: Model) -> ca.Function:
    """Return (x, u, p) -> x', x'' with u and p held."""
    symbols = [model.states, model.controls, model.parameters]
    second = ca.jtimes(model.ode, model.states, model.ode)
    return ca.Function("derivatives", symbols, [model.ode, ca.densify(second)])


def _substeps(plant: Plant, trajectory: Trajectory) -> int:
    """Return the number of the plant's steps in an interval."""
    steps, pieces = trajectory.controls.shape[1], trajectory.dense_states.shape[1] - 1
    rows = (trajectory.dense_states.shape[0], trajectory.controls.shape[0])
    if rows != (plant.model.nx, plant.model.nu):
        raise InvalidProblemError(
            f"trajectory must have {plant.model.nx} states and {plant.model.nu} "
            f"controls like the plant, got {rows[0]} and {rows[1]}"
        )
    if not steps or not pieces or pieces % steps:
        raise InvalidProblemError(
            "dense_states must have the same number of steps in each of the "
            f"{steps} control intervals, got {pieces} steps"
        )
    return int(pieces // steps)
