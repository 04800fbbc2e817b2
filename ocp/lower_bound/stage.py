"""The problem in numbers at many points: rates, costs and the best control.

These numbers are not rigorous: they make rows of linear programs and find points at
which a polynomial fails. The proof depends on intervals alone.
"""

from __future__ import annotations

import itertools

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.basis import Basis, Box
from swarmstart.ocp.lower_bound.stated.statement import Affine, Statement

GRID = 9
MOST_CANDIDATES = 729


class Stage:
    """Rates and costs of a problem at points."""

    def __init__(self, statement: Statement, affine: Affine | None) -> None:
        """Compile rates and costs; `affine` is the problem in that form, if any."""
        self._statement, self._affine = statement, affine
        point, u = statement.point, statement.controls
        rates = ca.densify(ca.vertcat(statement.rate, statement.stage))
        self._rates = ca.Function("rates", [point, u], [rates])
        self._end = ca.Function("end", [point], [ca.densify(statement.end)])
        if affine is not None:
            columns = ca.densify(ca.vertcat(*affine.columns, ca.SX(0, 1)))
            self._columns = ca.Function("columns", [point], [columns])

    def rates(self, points: Array, u: Array) -> tuple[Array, Array]:
        """Return f (n, N) and L (N,) at points (1 + n, N), controls (m, N)."""
        found = np.array(self._rates(points, u))
        return found[:-1], found[-1]

    def end(self, points: Array) -> Array:
        """Return phi at points (1 + n, N), shape (N,)."""
        return np.array(self._end(points)).ravel()

    def hamiltonian(
        self, slopes: Array, points: Array, u: Array | None = None
    ) -> tuple[Array, Array]:
        """Return h and the controls that minimise it.

        Args:
            slopes: Derivatives of V, shape (1 + n, N).
            points: Shape (1 + n, N).
            u: Controls to use, shape (m, N); None means the best ones.

        Returns:
            h, shape (N,), not finite at points at which the problem is not finite;
            controls, (m, N).
        """
        if u is None:
            u = self._best(slopes, points)
        f, L = self.rates(points, u)
        return slopes[0] + L + (slopes[1:] * f).sum(axis=0), u

    def _best(self, slopes: Array, points: Array) -> Array:
        low, high = (limit[:, None] for limit in self._statement.control_box)
        m, count = self._statement.m, points.shape[1]
        if self._affine is not None:
            columns = np.array(self._columns(points)).reshape(m, -1, count)
            b = (columns * slopes[None, 1:]).sum(axis=1)
            b += self._affine.linear[:, None]
            q = self._affine.quadratic[:, None]
            curved = np.where(q > 0, q, 1.0)
            smooth = np.clip(-b / (2 * curved), low, high)
            return np.where(q > 0, smooth, np.where(b > 0, low, high))
        found, best = None, np.full(count, np.inf)
        for candidate in self._candidates():
            u = np.repeat(candidate[:, None], count, axis=1)
            h, _ = self.hamiltonian(slopes, points, u)
            better = h < best
            best = np.where(better, h, best)
            found = u if found is None else np.where(better, u, found)
        if found is None:
            return np.zeros((0, count))
        return self._refined(slopes, points, found, best)

    def _candidates(self) -> Array:
        m = self._statement.m
        each = GRID
        while each > 2 and each**m > MOST_CANDIDATES:  # noqa: PLR2004
            each -= 1
        axes = [
            np.linspace(low, high, each)
            for low, high in zip(*self._statement.control_box, strict=True)
        ]
        return np.array(list(itertools.product(*axes))).reshape(-1, m)

    def _refined(self, slopes: Array, points: Array, u: Array, h: Array) -> Array:
        """Return controls of lower h, by shrinking steps along each control."""
        low, high = (limit[:, None] for limit in self._statement.control_box)
        step = (high - low) / (GRID - 1)
        for _ in range(6):
            step = step / 2
            for k in range(len(u)):
                for sign in (1.0, -1.0):
                    tried = u.copy()
                    tried[k] = np.clip(u[k] + sign * step[k], low[k], high[k])
                    other, _ = self.hamiltonian(slopes, points, tried)
                    better = other < h
                    u, h = np.where(better, tried, u), np.where(better, other, h)
        return u


def slopes_of(basis: Basis, box: Box, w: Array, points: Array) -> Array:
    """Return the slopes of a polynomial at points, shape (variables, N)."""
    return np.asarray(basis.slopes(box, points) @ w)
