"""Linear problems with two or three states: Riccati, Gramians, bang-bang controls."""

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from swarmstart.arrays import Array
from swarmstart.ocp import TerminalConstraint
from swarmstart.tests.ocp.lower_bound.known_optimum import (
    KnownOptimum,
    Symbols,
    known,
    stated,
)

CHAIN = np.array([[0.0, 1.0], [0.0, 0.0]])
LONGER_CHAIN = np.diag([1.0, 1.0], 1)
OSCILLATOR = np.array([[0.0, 1.0], [-1.0, 0.0]])


def last(n: int) -> Array:
    """Return the column by which a control moves the last state."""
    return np.eye(n)[:, -1:]


def gramian(A: Array, B: Array, horizon: float) -> Array:
    """Return the integral of e^(A t) B B' e^(A' t) over the horizon.

    Source: Van Loan (1978), Computing integrals involving the matrix exponential.
    """
    n = len(A)
    blocks = np.block([[-A, B @ B.T], [np.zeros((n, n)), A.T]])
    parts = expm(blocks * horizon)
    return np.asarray(parts[n:, n:].T @ parts[:n, n:])


def transfer(  # noqa: PLR0913 - the data of a transfer
    name: str,
    A: Array,
    x0: list[float],
    target: list[float],
    *,
    horizon: float,
    most: float,
    weight: float | None = None,
) -> KnownOptimum:
    """Return the transfer with the least integral of u^2, the last state driven.

    Args:
        name: Of the problem.
        A: Shape (n, n).
        x0: Initial state.
        target: Final state.
        horizon: [s].
        most: Bound of |u|, not active.
        weight: Of the squared distance at the end; None: it must be zero.
    """
    n, B = len(A), last(len(A))
    s = Symbols(n)
    apart = s.x - ca.DM(target)
    problem = stated(
        s, ca.DM(A) @ s.x + ca.DM(B) @ s.u, horizon=horizon, controls=(-most, most),
        stage=s.u**2, end=0.0 if weight is None else weight * ca.sumsqr(apart),
        terminal=[apart] if weight is None else [],
    )  # fmt: skip
    far = np.array(target) - expm(A * horizon) @ np.array(x0)
    spread = gramian(A, B, horizon) + (np.eye(n) / weight if weight else 0.0)
    optimum = float(far @ np.linalg.solve(spread, far))
    return known(name, problem, x0, optimum, "Gramian")


def riccati(  # noqa: PLR0913 - the data of a regulator
    name: str,
    A: Array,
    Q: Array,
    x0: list[float],
    *,
    horizon: float,
    R: float = 1.0,
    P: float = 0.0,
    most: float = 5.0,
) -> KnownOptimum:
    """Return the regulator x'Qx + R u^2, end cost P |x|^2, the last state driven."""
    n, B = len(A), last(len(A))
    s = Symbols(n)
    problem = stated(
        s, ca.DM(A) @ s.x + ca.DM(B) @ s.u, horizon=horizon, controls=(-most, most),
        stage=ca.bilin(ca.DM(Q), s.x, s.x) + R * s.u**2, end=P * ca.sumsqr(s.x),
    )  # fmt: skip

    def back(_: float, flat: Array) -> Array:
        p = flat.reshape(n, n)
        rate = Q + A.T @ p + p @ A - p @ B @ B.T @ p / R
        return np.asarray(rate).ravel()

    flown = solve_ivp(
        back, (0, horizon), (P * np.eye(n)).ravel(), method="DOP853", rtol=1e-12,
        atol=1e-12,
    )  # fmt: skip
    optimum = float(np.array(x0) @ flown.y[:, -1].reshape(n, n) @ np.array(x0))
    return known(name, problem, x0, optimum, "Riccati equation by DOP853")


def farthest() -> KnownOptimum:
    """x'' = u, |u| <= 1: as far as possible in 2 s, and stop there."""
    s = Symbols(2)
    problem = stated(
        s, [s.x[1], s.u], horizon=2.0, controls=(-1, 1), end=s.x[0],
        terminal=[s.x[1]], maximize=True,
    )  # fmt: skip
    return known("farthest", problem, [0.0, 0.0], 1.0, "T^2 / 4")


def driven_up() -> KnownOptimum:
    """x'' = -x + u, |u| <= 1, x(T) largest: the integral of |sin| over a turn."""
    s = Symbols(2)
    problem = stated(
        s, [s.x[1], s.u - s.x[0]], horizon=2 * np.pi, controls=(-1, 1), end=s.x[0],
        maximize=True,
    )  # fmt: skip
    return known("driven up", problem, [0.0, 0.0], 4.0, "u = sign sin(T - t): 4")


def fuel_to_rest() -> KnownOptimum:
    """x'' = u1 - u2, the integral of u1 + u2: push, coast, push, t (T - t) = 1."""
    s, T = Symbols(2, 2), 3.0
    problem = stated(
        s, [s.x[1], s.u[0] - s.u[1]], horizon=T, controls=(0, 1), stage=ca.sum1(s.u),
        terminal=[s.x],
    )  # fmt: skip
    push = (T - np.sqrt(T * T - 4)) / 2
    return known("fuel to rest", problem, [1.0, 0.0], 2 * push, "t (T - t) = 1: 2 t")


def shear() -> KnownOptimum:
    """Zermelo's x' = cos a + y, y' = sin a: tan a = T - t takes x(T) farthest."""
    s, T = Symbols(2), 1.0
    problem = stated(
        s, [ca.cos(s.u) + s.x[1], ca.sin(s.u)], horizon=T, controls=(-np.pi, np.pi),
        end=s.x[0], maximize=True,
    )  # fmt: skip
    optimum = (T * np.sqrt(1 + T * T) + np.arcsinh(T)) / 2
    return known("Zermelo, shear", problem, [0.0, 0.0], optimum, "linear costates")


def to_a_disc() -> KnownOptimum:
    """x' = u in the plane from (2, 0) into a disc of radius 1/2: 1.5^2."""
    s = Symbols(2, 2)
    near = TerminalConstraint(expression=ca.sumsqr(s.x), upper=0.25)
    problem = stated(
        s, s.u, horizon=1.0, controls=(-3, 3), stage=ca.sumsqr(s.u), terminal=[near]
    )
    return known("to a disc", problem, [2.0, 0.0], 2.25, "straight way: distance^2 / T")


def three_regulators() -> KnownOptimum:
    """Three regulators x' = u with one cost: tanh(T) |x0|^2."""
    s, x0 = Symbols(3, 3), [1.0, -0.5, 0.25]
    problem = stated(
        s, s.u, horizon=0.5, controls=(-2, 2), stage=ca.sumsqr(s.x) + ca.sumsqr(s.u)
    )
    optimum = np.tanh(0.5) * float(np.square(x0).sum())
    return known("three regulators", problem, x0, optimum, "tanh(T) |x0|^2")


def transfers() -> list[KnownOptimum]:
    """Return the transfers with the least integral of u^2."""
    return [
        transfer(
            "double integrator to a soft end", CHAIN, [1, 0], [0, 0],
            horizon=1.0, most=20, weight=10,
        ),
        transfer(
            "double integrator to rest", CHAIN, [1, 0], [0, 0], horizon=2.0, most=3
        ),
        transfer(
            "oscillator to rest with least energy", OSCILLATOR, [1, 0.5], [0, 0],
            horizon=2.0, most=4,
        ),
        transfer(
            "three integrators to rest", LONGER_CHAIN, [1, 0, 0], [0, 0, 0],
            horizon=2.0, most=12,
        ),
    ]  # fmt: skip


def regulators() -> list[KnownOptimum]:
    """Return the regulators with a Riccati equation."""
    unstable = np.array([[0.5, 1.0], [0.3, 0.2]])
    return [
        riccati("double integrator regulator", CHAIN, np.eye(2), [1, 0], horizon=2.0),
        riccati(
            "oscillator regulator", OSCILLATOR, np.diag([2.0, 0.5]), [1, -1],
            horizon=1.5, R=0.5, P=1.0,
        ),
        riccati(
            "unstable regulator", unstable, np.eye(2), [0.5, 0.5], horizon=1.0, P=2.0
        ),
    ]  # fmt: skip


def family() -> list[KnownOptimum]:
    """Return all linear problems with a given horizon."""
    return [
        *transfers(),
        *regulators(),
        farthest(),
        driven_up(),
        fuel_to_rest(),
        shear(),
        to_a_disc(),
        three_regulators(),
    ]
