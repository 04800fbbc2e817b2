"""Nonlinear problems whose cost is made for a value function: the inverse problem.

Of x' = f + B u and a cost with r |u|^2, any V(t, x) is the value function of

    L = r |u|^2 + |B' V_x|^2 / (4 r) - V_t - V_x f,    end cost V(T, x)

with u = -B' V_x / (2 r), if the bounds do not cut that off along the path from x0.

Source: Kalman (1964), When is a linear control system optimal?
"""

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from swarmstart.tests.ocp.lower_bound.known_optimum import (
    KnownOptimum,
    Symbols,
    known,
    stated,
)

Form = Callable[[ca.SX, ca.SX], ca.SX]
"""(t, x) -> an expression."""


def inverse(  # noqa: PLR0913 - the data of a problem
    name: str,
    *,
    value: Form,
    drift: Form,
    column: Form,
    x0: Sequence[float],
    horizon: float = 1.0,
    price: float = 1.0,
    room: float = 1.3,
) -> KnownOptimum:
    """Return the problem with one control of which V is the value function.

    Args:
        name: Of the problem.
        value: V.
        drift: f, shape (n, 1).
        column: B, shape (n, 1).
        x0: Initial state.
        horizon: [s].
        price: r.
        room: Bound of |u|, in parts of the largest that the law needs from x0.
    """
    s = Symbols(len(x0))
    V, f, b = value(s.t, s.x), drift(s.t, s.x), column(s.t, s.x)
    slope = ca.gradient(V, s.x)
    law = -ca.dot(b, slope) / (2 * price)
    most = room * _largest(s, f + b * law, law, x0, horizon)
    kept = price * law**2 - ca.gradient(V, s.t) - ca.dot(slope, f)
    problem = stated(
        s, f + b * s.u, horizon=horizon, controls=(-most, most),
        stage=price * s.u**2 + kept, end=ca.substitute(V, s.t, horizon),
    )  # fmt: skip
    at = ca.Function("V", [s.t, s.x], [V])
    return known(
        name, problem, list(x0), float(at(0, list(x0))), "a cost made for its value"
    )


def _largest(
    s: Symbols, rate: ca.SX, law: ca.SX, x0: Sequence[float], horizon: float
) -> float:
    """Return the largest |u| of a law on its way, by DOP853."""
    closed = ca.Function("closed", [s.t, s.x], [rate, law])
    flown = solve_ivp(
        lambda t, x: np.asarray(closed(t, x)[0], dtype=np.float64).ravel(),
        (0, horizon), x0, method="DOP853", rtol=1e-9, atol=1e-9,
        t_eval=np.linspace(0, horizon, 101),
    )  # fmt: skip
    if not flown.success:
        raise ArithmeticError(flown.message)
    return max(
        abs(float(closed(t, x)[1])) for t, x in zip(flown.t, flown.y.T, strict=True)
    )


def drawn(rng: np.random.Generator, number: int) -> KnownOptimum:
    """Draw an oscillator with a cubic spring, and a value function with waves."""
    a, b, c, d = rng.uniform(0.3, 1.5, 4)
    return inverse(
        f"drawn {number}",
        value=lambda t, x: (
            a * ca.sumsqr(x) + b * ca.sin(x[0] + c * t) + d * x[0] * x[1] * ca.exp(-t)
        ),
        drift=lambda t, x: ca.vertcat(x[1], -c * x[0] - d * x[0] ** 3),
        column=lambda t, x: ca.SX([0, 1]),
        x0=[*map(float, rng.uniform(-1, 1, 2))],
        price=float(rng.uniform(0.2, 2.0)),
        horizon=float(rng.uniform(0.5, 1.5)),
    )


def family() -> list[KnownOptimum]:
    """Return all problems with a value function that was chosen."""
    rng = np.random.default_rng(21)
    written = [
        inverse(
            "pendulum with a known value",
            value=lambda t, x: ca.sumsqr(x) + x[0] * x[1] + 2 - 2 * ca.cos(x[0]),
            drift=lambda t, x: ca.vertcat(x[1], ca.sin(x[0])),
            column=lambda t, x: ca.SX([0, 1]),
            x0=[1.0, 0.5],
        ),
        inverse(
            "van der Pol with a known value",
            value=lambda t, x: (1 + t / 2) * ca.sumsqr(x) + ca.tanh(x[0]) / 2,
            drift=lambda t, x: ca.vertcat(x[1], (1 - x[0] ** 2) * x[1] - x[0]),
            column=lambda t, x: ca.vertcat(0, 1 + x[0] ** 2 / 4),
            x0=[0.5, -0.5],
        ),
        inverse(
            "unicycle with a known value",
            value=lambda t, x: (x[0] - 1) ** 2 + x[1] ** 2 + 1 - ca.cos(x[2]),
            drift=lambda t, x: ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), 0),
            column=lambda t, x: ca.SX([0, 0, 1]),
            x0=[0.0, 0.3, 0.5],
        ),
        inverse(
            "a value below zero",
            value=lambda t, x: -3 + 0.5 * ca.exp(x[0] / 2) - t,
            drift=lambda t, x: x / 2,
            column=lambda t, x: ca.SX(1),
            x0=[0.4],
        ),
    ]
    return written + [drawn(rng, number) for number in range(4)]
