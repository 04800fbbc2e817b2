"""The control problem that a bound is proven for, with numbers in place of parameters.

    minimise    offset + integral of L(t, x, u) over [0, T] + phi(T, x(T))
    subject to  x' = f(t, x, u),  x(0) = x0,  u(t) in a box at all times,
                g(t, x) <= 0 at all times, e(T, x(T)) <= 0,  T in [earliest, latest]

over all measurable u, so that the bound also holds for controls that are held,
piecewise linear, integer or of any other shape. States are divided by their sizes; a
maximised cost is multiplied by -1. Every limit is widened by the tolerance of the
problem's answers.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from swarmstart.arrays import Array


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Statement:
    """A control problem in numbers.

    Attributes:
        time: Symbol of the time t [s].
        states: Symbols of the states x, each in its size, shape (n, 1).
        controls: Symbols of the controls u, in their units, shape (m, 1).
        rate: f(t, x, u), shape (n, 1) [1/s].
        stage: L(t, x, u) [cost / s].
        end: phi(t, x) [cost], t the time of the end.
        x0: Initial state, shape (n,).
        sizes: Sizes of the states, in their units, shape (n,): a state is its x times
            its size.
        horizon: Earliest and latest end [s].
        control_box: Lower and upper bounds of the controls, each (m,), finite.
        state_box: Lower and upper bounds of the states, each (n,), infinite if missing;
            admissible trajectories keep them at all times.
        path: Expressions g(t, x) that are at most 0 at all times.
        ends: Expressions e(t, x) that are at most 0 at the end, t its time.
        offset: Cost that no decision changes.
        sense: 1 for a minimised cost, -1 for a maximised one.
    """

    time: ca.SX
    states: ca.SX
    controls: ca.SX
    rate: ca.SX
    stage: ca.SX
    end: ca.SX
    x0: Array
    sizes: Array
    horizon: tuple[float, float]
    control_box: tuple[Array, Array]
    state_box: tuple[Array, Array]
    path: tuple[ca.SX, ...] = ()
    ends: tuple[ca.SX, ...] = ()
    offset: float = 0.0
    sense: float = 1.0

    @property
    def n(self) -> int:
        """Number of states."""
        return int(self.states.numel())

    @property
    def m(self) -> int:
        """Number of controls."""
        return int(self.controls.numel())

    @property
    def point(self) -> ca.SX:
        """The symbols (t, x), shape (1 + n, 1)."""
        return ca.vertcat(self.time, self.states)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Affine:
    """A problem with dynamics affine in the controls and a separable cost.

        f = drift + sum of columns[k] u_k,    L = stage + sum of (c_k u_k + q_k u_k^2)

    with numbers c_k and q_k >= 0: the least u is known in closed form.

    Attributes:
        drift: Shape (n, 1), of (t, x).
        columns: A column for each control, shape (n, 1), of (t, x).
        stage: Scalar, of (t, x).
        linear: c, shape (m,).
        quadratic: q, shape (m,).
    """

    drift: ca.SX
    columns: tuple[ca.SX, ...]
    stage: ca.SX
    linear: Array = field(default_factory=lambda: np.zeros(0))
    quadratic: Array = field(default_factory=lambda: np.zeros(0))
