"""Linear systems with held controls and quadratic costs, discretised exactly.

    x' = A x + B u + c,   u held on each of N intervals
    J  = integral of x'Qx + u'Ru + q'x + r'u  +  x(T)'P x(T) + p'x(T)
    lower <= C x + D u <= upper all along,   end_lower <= E x(T) <= end_upper

With z = (x, u, 1), z' = M z within an interval, z(t) = exp(M t) z(0), and the cost of
an interval is z(0)' S z(0), S = integral of exp(M't) W exp(Mt); both come from one
exponential, over a part of the interval, and doublings. So J is a quadratic function of
all controls, without any error but rounding, and what remains is a convex program.

Source: Van Loan (1978), Computing integrals involving the matrix exponential, eq. 1.2.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag, expm

from swarmstart.arrays import Array
from swarmstart.tests.adversary.exact.convex import Program

EMPTY = np.empty(0)


class Path(NamedTuple):
    """lower <= C x + D u <= upper; shapes (m, nx), (m, nu), (m,), (m,)."""

    C: Array
    D: Array
    lower: Array
    upper: Array


class End(NamedTuple):
    """lower <= E x(T) <= upper; shapes (m, nx), (m,), (m,)."""

    E: Array
    lower: Array
    upper: Array


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Linear:
    """A linear-quadratic problem; see above. What is not given is zero or absent.

    Attributes:
        A: Shape (nx, nx).
        B: Shape (nx, nu).
        x0: Initial state, shape (nx,).
        horizon: [s].
        intervals: Number N of control intervals.
        controls: Lower and upper bounds, each (nu,).
        c: Shape (nx,).
        Q: Shape (nx, nx).
        R: Shape (nu, nu).
        q: Shape (nx,).
        r: Shape (nu,).
        P: Shape (nx, nx).
        p: Shape (nx,).
        path: What holds all along.
        end: What holds at the end.
        states: Bounds of the states, each (nx,).
    """

    A: Array
    B: Array
    x0: Array
    horizon: float
    intervals: int
    controls: tuple[Array, Array]
    c: Array = field(default_factory=lambda: EMPTY)
    Q: Array = field(default_factory=lambda: EMPTY)
    R: Array = field(default_factory=lambda: EMPTY)
    q: Array = field(default_factory=lambda: EMPTY)
    r: Array = field(default_factory=lambda: EMPTY)
    P: Array = field(default_factory=lambda: EMPTY)
    p: Array = field(default_factory=lambda: EMPTY)
    path: Path | None = None
    end: End | None = None
    states: tuple[Array, Array] | None = None

    def __post_init__(self) -> None:
        """Fill in zeros for matrices and vectors that are not given."""
        nx, nu = self.B.shape
        shapes = {
            **{"c": (nx,), "q": (nx,), "p": (nx,), "r": (nu,)},
            **{"Q": (nx, nx), "P": (nx, nx), "R": (nu, nu)},
        }
        for name, shape in shapes.items():
            if not getattr(self, name).size:
                object.__setattr__(self, name, np.zeros(shape))

    @property
    def ends(self) -> End:
        """The conditions at the end."""
        return self.end or End(np.empty((0, self.A.shape[0])), EMPTY, EMPTY)

    @property
    def state_limits(self) -> tuple[Array, Array]:
        """Bounds of the states, each (nx,)."""
        free = np.full(self.A.shape[0], np.inf)
        return self.states or (-free, free)

    @property
    def rows(self) -> Path:
        """All that holds along the path, the bounded states last."""
        nx, nu = self.B.shape
        lower, upper = self.state_limits
        bounded = np.isfinite(lower) | np.isfinite(upper)
        count = int(bounded.sum())
        on_states = Path(
            np.eye(nx)[bounded], np.zeros((count, nu)), lower[bounded], upper[bounded]
        )
        if self.path is None:
            return on_states
        pairs = zip(self.path, on_states, strict=True)
        return Path(*[np.concatenate([own, more]) for own, more in pairs])


def program_of(linear: Linear, *, points: int = 2) -> Program:
    """Return the convex program over all controls, interval after interval.

    Args:
        linear: The problem.
        points: In each interval, both ends included, at which path rows hold.
    """
    nx, nu = linear.B.shape
    N, dt = linear.intervals, linear.horizon / linear.intervals
    n = nx + nu + 1
    M = np.zeros((n, n))
    M[:nx] = np.hstack([linear.A, linear.B, linear.c[:, None]])
    W = block_diag(linear.Q, linear.R, 0.0)
    W[:-1, -1] = W[-1, :-1] = np.concatenate([linear.q, linear.r]) / 2
    S = _held_cost(M, W, dt)
    inner = [expm(M * tau) for tau in np.linspace(0.0, dt, points)]

    # Of (all controls, 1): state, then z = (state, control, 1), then what z costs.
    state = np.zeros((nx, nu * N + 1))
    state[:, -1] = linear.x0
    cost, held = np.zeros((nu * N + 1, nu * N + 1)), []
    rows = linear.rows
    for k in range(N):
        z = np.zeros((n, nu * N + 1))
        z[:nx], z[-1, -1] = state, 1.0
        z[nx:-1, k * nu : (k + 1) * nu] = np.eye(nu)
        cost += z.T @ ((S + S.T) / 2) @ z
        CD = np.hstack([rows.C, rows.D, np.zeros((rows.lower.size, 1))])
        held += [CD @ step @ z for step in inner]
        state = (inner[-1] @ z)[:nx]
    cost += state.T @ linear.P @ state
    cost[-1] += linear.p @ state
    return _program(linear, (cost + cost.T) / 2, held, state)


def _held_cost(M: Array, W: Array, dt: float) -> Array:
    """Return S; over a part of dt first, since exp(-M't) overflows if M is stiff."""
    n = M.shape[0]
    size = max(float(np.linalg.norm(M)) * dt, 1.0)
    halvings = int(np.ceil(np.log2(size)))
    both = expm(np.block([[-M.T, W], [np.zeros((n, n)), M]]) * dt / 2**halvings)
    step: Array = both[n:, n:]
    S: Array = step.T @ both[:n, n:]
    for _ in range(halvings):
        S, step = S + step.T @ S @ step, step @ step
    return S


def _program(linear: Linear, cost: Array, held: list[Array], state: Array) -> Program:
    end = linear.ends
    size, N = cost.shape[0] - 1, linear.intervals
    last = end.E @ state
    equal = end.lower == end.upper
    controls = np.hstack([np.eye(size), np.zeros((size, 1))])
    lower_u, upper_u = (np.tile(limit, N) for limit in linear.controls)
    rows = linear.rows
    stacked = [
        (controls, lower_u, upper_u),
        (last[~equal], end.lower[~equal], end.upper[~equal]),
        *[(values, rows.lower, rows.upper) for values in held],
    ]
    G = np.vstack([part for left, _, _ in stacked for part in (left, -left)])
    h = np.concatenate([part for _, low, up in stacked for part in (up, -low)])
    finite = np.isfinite(h)
    return Program(
        H=2 * cost[:-1, :-1],
        g=2 * cost[:-1, -1],
        constant=float(cost[-1, -1]),
        G=G[finite, :-1],
        h=(h - G[:, -1])[finite],
        E=last[equal, :-1],
        e=end.lower[equal] - last[equal, -1],
    )
