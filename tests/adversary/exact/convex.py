"""Convex programs solved without CasADi, with a bound on how wrong the answer can be.

    minimise 1/2 z'Hz + g'z   subject to  E z = e,  G z <= h

Quadratic: Mehrotra's predictor-corrector; linear: HiGHS. The gap is what weak duality
leaves between the cost found and the least possible one.

Source: Nocedal and Wright (2006), Numerical Optimization, algorithm 16.4.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from swarmstart.arrays import Array

ITERATIONS = 200
CLOSE = 1e-9
STEP = 0.995
"""Of the way to the boundary, the most that a step takes."""


class UnsolvedError(Exception):
    """A program that has no solution, or none that was found."""


class Optimum(NamedTuple):
    """A point, its cost, and how far below the least cost can be."""

    point: Array
    cost: float
    gap: float


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Program:
    """A convex program; see above.

    Attributes:
        H: Shape (n, n), positive semidefinite.
        g: Shape (n,).
        G: Shape (m, n).
        h: Shape (m,).
        E: Shape (k, n).
        e: Shape (k,).
        constant: Added to the cost.
    """

    H: Array
    g: Array
    G: Array
    h: Array
    E: Array
    e: Array
    constant: float = 0.0

    def cost(self, z: Array) -> float:
        """Return the cost of a point."""
        return float(0.5 * z @ self.H @ z + self.g @ z + self.constant)


def solve_convex(program: Program) -> Optimum:
    """Return the optimum of a convex program.

    Raises:
        UnsolvedError: If there is none, or the iterations end before.
    """
    is_linear = not program.H.any()
    answer = linprog(
        program.g * is_linear,
        *(program.G, program.h, program.E, program.e),
        bounds=(None, None),
        method="highs",
    )
    if not answer.success:
        raise UnsolvedError(answer.message)
    if not is_linear:  # What is feasible is all that was asked.
        return _quadratic(program)
    dual = program.h @ answer.ineqlin.marginals + program.e @ answer.eqlin.marginals
    return Optimum(answer.x, program.cost(answer.x), abs(float(answer.fun - dual)))


def _quadratic(program: Program) -> Optimum:
    H, g, G, h = program.H, program.g, program.G, program.h
    E, e = program.E, program.e
    z: Array = np.zeros(g.size)
    if e.size:
        z += np.linalg.lstsq(E, e, rcond=None)[0]
    y, dual = np.zeros(e.size), np.ones(h.size)
    s = np.maximum(h - G @ z, 1.0)
    size = 1.0 + max(np.abs(g).max(), np.abs(H).max())
    for _ in range(ITERATIONS):
        rd, rp, re = H @ z + g + E.T @ y + G.T @ dual, G @ z + s - h, E @ z - e
        mu = float(s @ dual) / max(h.size, 1)
        if max(_largest(rd), _largest(rp), _largest(re), mu) <= CLOSE * size:
            return Optimum(z, program.cost(z), h.size * mu + float(abs(rd @ z)))
        kkt = np.block(
            [[H + (G.T * (dual / s)) @ G, E.T], [E, np.zeros((e.size, e.size))]]
        )
        centred = s * dual
        for is_last in (False, True):
            target = -rd - G.T @ ((dual * rp - centred) / s)
            step = np.linalg.solve(kkt, np.concatenate([target, -re]))
            dz, dy = step[: g.size], step[g.size :]
            ds = -rp - G @ dz
            dd = -(centred + dual * ds) / s
            length = min(_length(s, ds), _length(dual, dd))
            if not is_last and h.size:
                after = float((s + length * ds) @ (dual + length * dd)) / h.size
                centred = s * dual + ds * dd - mu * (after / mu) ** 3
        length = min(1.0, STEP * length)
        z, y = z + length * dz, y + length * dy
        s, dual = s + length * ds, dual + length * dd
    raise UnsolvedError(f"no optimum after {ITERATIONS} iterations")


def _largest(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))


def _length(values: Array, step: Array) -> float:
    """Return how much of a step leaves positive values positive, at most 1 / STEP."""
    falls = step < 0
    return float(np.min(-values[falls] / step[falls], initial=1.0 / STEP))
