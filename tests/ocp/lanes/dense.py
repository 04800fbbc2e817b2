"""The barrier problem of a lane as one dense problem, from the functions of IPOPT.

minimise    f(w) / unit + rho sum(p + n) - mu sum(log(distances to bounds))
subject to  g(w) - s + p - n = 0

Its variables are v = (w; s, p, n of each part), its multipliers m those of all rows.
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.nlp.transcription import NonlinearProgram

_RELAXED = 1e-8


@dataclass(frozen=True, kw_only=True)
class Rows:
    """The parts of the NLP's rows.

    Attributes:
        interval: Number of rows of an interval, without continuity.
        end: Number of rows of the end.
        begin: Number of rows of the start.
        nx: Number of states.
        N: Number of intervals.
    """

    interval: int
    end: int
    begin: int
    nx: int
    N: int

    def parts(self) -> list[NDArray[np.int64]]:
        """Return the rows of each interval, of the end and of the start."""
        height = self.nx + self.interval
        inner = [k * height + self.nx + np.arange(self.interval) for k in range(self.N)]
        first = self.N * height
        return [
            *inner,
            first + np.arange(self.end),
            first + self.end + np.arange(self.begin),
        ]


class Barrier:
    """The part of the problem that is the same at all points.

    Attributes:
        lower: Lower bounds of v.
        upper: Upper bounds.
        E: Derivatives of the rows by (s, p, n).
        fixed: Limits of rows that have no slack.
        kinds: For each of (s, p, n): "s", "p" or "n".
    """

    def __init__(
        self, program: NonlinearProgram, limits: tuple[Array, ...], rows: Rows
    ) -> None:
        """Add slacks and elastic variables, and widen limits."""
        lbx, ubx, lbg, ubg = limits
        self.n, self.m, self.rows = lbx.size, lbg.size, rows
        columns, low, high, kinds = [], list[float](), list[float](), list[str]()
        self.fixed = np.zeros(self.m)
        for part in rows.parts():
            equal = [r for r in part if lbg[r] == ubg[r]]
            slack = [r for r in part if lbg[r] != ubg[r]]
            self.fixed[equal] = lbg[equal]
            less = [r for r in part if r in equal or np.isfinite(lbg[r])]
            more = [r for r in part if r in equal or np.isfinite(ubg[r])]
            for kind, sign, own in (("s", -1, slack), ("p", 1, less), ("n", -1, more)):
                for r in own:
                    columns.append(sign * np.eye(self.m)[r])
                    kinds.append(kind)
                    low.append(_wider(lbg[r], -1) if kind == "s" else 0.0)
                    high.append(_wider(ubg[r], 1) if kind == "s" else np.inf)
        self.E, self.kinds = np.array(columns).T, np.array(kinds)
        self.lower = np.append([_wider(a, -1) for a in lbx], low)
        self.upper = np.append([_wider(a, 1) for a in ubx], high)
        x, q, f, g = (program.nlp[name] for name in "xpfg")
        m = type(x).sym("m", self.m)  # Of SX if the NLP is written out.
        unit = type(x).sym("unit")
        f /= unit
        self.values = ca.Function("values", [x, q, m, unit], [
            f, ca.gradient(f, x), g, ca.jacobian(g, x),
            ca.hessian(f + ca.dot(m, g), x)[0],
        ])  # fmt: skip


def _wider(limit: float, sign: float) -> float:
    return limit + sign * _RELAXED * max(1.0, abs(limit))


@dataclass(frozen=True, kw_only=True)
class Point:
    """A point of one lane.

    Attributes:
        barrier: The problem.
        q: Arguments of the NLP.
        v: The variables.
        m: The multipliers.
        z: Duals of lower and of upper bounds, 0 without one.
        mu: Parameter of the central path.
        rho: Price.
        delta: The addition to second derivatives.
        unit: Unit of the cost.
    """

    barrier: Barrier
    q: Array
    v: Array
    m: Array
    z: tuple[Array, Array]
    mu: float
    rho: float
    delta: float
    unit: float

    @cached_property
    def _values(self) -> list[Array]:
        n = self.barrier.n
        found = self.barrier.values(self.v[:n], self.q, self.m, self.unit)
        return [np.asarray(ca.DM(one)) for one in found]

    @property
    def cost(self) -> float:
        return float(self._values[0].item())

    @property
    def elastic(self) -> Array:
        """Values of the elastic variables."""
        inner = self.v[self.barrier.n :]
        return np.asarray(inner[self.barrier.kinds != "s"])

    @property
    def distances(self) -> tuple[Array, Array]:
        return self.v - self.barrier.lower, self.barrier.upper - self.v

    @property
    def residual(self) -> Array:
        """Residuals of the rows."""
        inner = self.v[self.barrier.n :]
        left = self._values[2].ravel() + self.barrier.E @ inner
        return np.asarray(left - self.barrier.fixed)

    @property
    def gradient(self) -> Array:
        """Gradient of cost and price."""
        price = np.where(self.barrier.kinds == "s", 0.0, self.rho)
        return np.append(self._values[1].ravel(), price)

    @property
    def barrier_slope(self) -> Array:
        """Gradient of cost, price and barrier."""
        low, high = self.distances
        return np.asarray(self.gradient - self.mu / low + self.mu / high)

    @cached_property
    def slopes(self) -> Array:
        """Derivatives of the rows."""
        return np.hstack([self._values[3], self.barrier.E])

    @cached_property
    def curvature(self) -> Array:
        """Second derivatives with z / d and delta."""
        low, high = self.distances
        H = np.diag(self.z[0] / low + self.z[1] / high + self.delta)
        n = self.barrier.n
        H[:n, :n] += self._values[4]
        return H

    @cached_property
    def newton(self) -> tuple[Array, Array]:
        """Step of v, and the multipliers after it."""
        n, rows = self.v.size, self.m.size
        matrix = np.block(
            [[self.curvature, self.slopes.T], [self.slopes, np.zeros((rows, rows))]]
        )
        right = -np.concatenate([self.barrier_slope, self.residual])
        both = np.linalg.solve(matrix, right)
        return both[:n], both[n:]

    @property
    def dual_steps(self) -> tuple[Array, Array]:
        low, high = (
            self.mu / d - z - z / d * sign * self.newton[0]
            for d, z, sign in zip(self.distances, self.z, (1, -1), strict=True)
        )
        return low, high

    @property
    def longest(self) -> tuple[float, float]:
        """Longest steps of variables and duals."""
        left, (step, _) = max(0.99, 1 - self.mu), self.newton
        primal = [
            _longest(d, sign * step, left)
            for d, sign in zip(self.distances, (1, -1), strict=True)
        ]
        dual = [
            _longest(z[z > 0], dz[z > 0], left)
            for z, dz in zip(self.z, self.dual_steps, strict=True)
        ]
        return min(primal), min(dual)

    @cached_property
    def reduced(self) -> Array:
        """Eigenvalues of the curvature on the null space of the rows."""
        V = np.linalg.svd(self.slopes)[2]
        Z = V[self.m.size :].T
        return np.asarray(np.linalg.eigvalsh(Z.T @ self.curvature @ Z))

    def measures(self) -> dict[str, float]:
        """Return the measures of interior_verdict.py."""
        low, high = (np.where(np.isfinite(d), d, 1.0) for d in self.distances)
        dual = self.gradient + self.slopes.T @ self.m - self.z[0] + self.z[1]
        rows = np.concatenate(self.barrier.rows.parts())
        return {
            "cost": self.cost,
            "theta": np.abs(self.residual).sum(),
            "logs": -np.log(low).sum() - np.log(high).sum(),
            "elastic": self.elastic.sum(),
            "duals": np.abs(self.m).sum() + self.z[0].sum() + self.z[1].sum(),
            "dual": np.abs(dual).max(),
            "primal": np.abs(self.residual).max(),
            "gap": max((self.z[0] * low).max(), (self.z[1] * high).max()),
            "pressure": np.abs(self.m[rows]).max(),
            "excess": self.elastic.max(),
        }


def _longest(d: Array, change: Array, left: float) -> float:
    falls = (change < 0) & np.isfinite(d)
    return float(np.min(-left * d[falls] / change[falls], initial=1.0))
