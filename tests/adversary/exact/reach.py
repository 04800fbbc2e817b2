"""Global optima of costs of the final output, whatever the shape of the cost.

    x' = A x + B u,  y = C x(T),  J = w * integral of u'u + g(y)

The least energy that leads to y is a quadratic function of y,

    E(y) = w dt (y - y0)' (Gamma Gamma')^-1 (y - y0),   y = y0 + Gamma U,

so that the least J is that of E(y) + g(y) over one or two numbers: looked for on a fine
grid, then around its best points.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from swarmstart.arrays import Array
from swarmstart.tests.adversary.exact.held_linear import Linear, program_of

GRID = {1: 40_001, 2: 401}
"""Points along each output, by the number of outputs."""
TRIED = 5
"""Points of the grid around which is looked further."""


class Reached(NamedTuple):
    """The best output, its cost, and the controls that lead there, (nu, N)."""

    output: Array
    cost: float
    controls: Array


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Reach:
    """A problem of the kind above.

    Attributes:
        linear: The system; its costs are not used.
        C: Shape (m, nx), m = 1 or 2.
        weight: w.
        end_cost: g; from (m, k) to (k,).
        breaks: Outputs that are looked at besides the grid, one output only.
        span: Half the width of the grid around y0 that is looked at.
    """

    linear: Linear
    C: Array
    weight: float
    end_cost: Callable[[Array], Array]
    breaks: tuple[float, ...] = ()
    span: float = 6.0

    def best(self) -> Reached:
        """Return the global optimum."""
        gamma, y0 = outputs_of(self.linear, self.C)
        dt = self.linear.horizon / self.linear.intervals
        metric = self.weight * dt * np.linalg.inv(gamma @ gamma.T)

        def cost(y: Array) -> Array:
            away = y - y0[:, None]
            energy: Array = np.einsum("ik,ij,jk->k", away, metric, away)
            return energy + self.end_cost(y)

        m = self.C.shape[0]
        axis = np.linspace(-self.span, self.span, GRID[m])
        grid = np.stack(np.meshgrid(*[axis] * m)).reshape((m, -1)) + y0[:, None]
        if self.breaks:
            around = np.array(self.breaks)[:, None] + np.array([-1e-9, 0.0, 1e-9])
            grid = np.hstack([grid, around.reshape((1, -1))])
        values = cost(grid)
        best, least = grid[:, values.argmin()], float(values.min())
        for index in np.argsort(values)[:TRIED]:
            found = minimize(
                lambda y: float(cost(y[:, None])[0]), grid[:, index],
                method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-13},
            )  # fmt: skip
            if found.fun < least:
                best, least = found.x, float(found.fun)
        U = gamma.T @ np.linalg.solve(gamma @ gamma.T, best - y0)
        return Reached(best, least, U.reshape((-1, self.linear.intervals), order="F"))


def outputs_of(linear: Linear, C: Array) -> tuple[Array, Array]:
    """Return Gamma, shape (m, nu * N), and y0, shape (m,)."""
    bare = Linear(
        A=linear.A,
        B=linear.B,
        c=linear.c,
        x0=linear.x0,
        horizon=linear.horizon,
        intervals=linear.intervals,
        controls=linear.controls,
    )
    programs = [program_of(replace(bare, p=row)) for row in C]
    return np.array([p.g for p in programs]), np.array([p.constant for p in programs])
