"""Ripples and pulses in time whose period divides the steps, and jumps at and off them.

    x' = u + g(t),  t' = 1,  J = integral of (x - 1)^2 + u^2 / 10

The steps of the problem see the same phase of g at every one of their points, and so
would steps of a tenth. With four steps in an interval of length h, the points of a step
of Runge and Kutta are its ends and its middle, h/8 apart.

    ripple   g = A cos(2 pi m t / (h/8))^2         m periods from point to point
    pulse    g = A exp(k (cos(2 pi t / (h/4) - p) - 1))   narrow, and at a phase p
    jump     g = A before a time at the grid or off it, -A/3 after it

What is asked is that no answer is confirmed whose cost is not that of its controls.
"""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.tests.adversary.case import Case, Formulas
from swarmstart.tests.adversary.judge import Truth

Shape = Callable[[Any, Any], Any]
"""(time, CasADi or NumPy) -> g."""

KIND = "aliases"
INTERVALS = 8


def _case(name: str, g: Shape, jump: float | None, length: float) -> Case:
    """Return a case of one g."""

    def formulas(x: ca.SX, u: ca.SX) -> Formulas:
        ode = ca.vertcat(u + g(x[1], ca), 1.0)
        return Formulas(ode=ode, stage_cost=(x[0] - 1) ** 2 + u**2 / 10)

    def rate(x: Array, u: Array) -> Array:
        return np.array([u[0] + g(x[1], np), 1.0])

    def kinks(x: Array, u: Array) -> Array:
        del u
        return np.empty(0) if jump is None else np.array([x[1] - jump])

    truth = Truth(
        dynamics=rate,
        stage_cost=lambda x, u: float((x[0] - 1) ** 2 + u[0] ** 2 / 10),
        kinks=kinks,
        controls=(np.full(1, -60.0), np.full(1, 60.0)),
        x0=np.zeros(2),
        horizon=length * INTERVALS,
        intervals=INTERVALS,
        sizes=np.array([1.0, length * INTERVALS]),
    )
    return Case(name=name, kind=KIND, formulas=formulas, truth=truth, is_counted=False)


def _ripple(size: float, turn: float) -> Shape:
    return lambda t, by: size * by.cos(turn * t) ** 2


def _pulses(size: float, turn: float, sharpness: float, phase: float) -> Shape:
    return lambda t, by: size * by.exp(sharpness * (by.cos(turn * t - phase) - 1))


def _jump(size: float, place: float) -> Shape:
    return lambda t, by: size * (4 / 3 * (t < place) - 1 / 3)


def cases() -> list[Case]:
    """Return all cases of the class, the same on every call."""
    rng = np.random.default_rng(33)
    made = []
    # Of a tenth of the distance of two points, too: m = 10.
    for number, m in enumerate((1, 2, 5, 10, 1, 2, 10, 20, 40, 10)):
        h, size = float(rng.uniform(0.1, 0.8)), float(rng.uniform(3.0, 20.0))
        g = _ripple(size, 2 * np.pi * m / (h / 8))
        made.append(_case(f"ripple {number}", g, None, h))
    for number in range(8):
        h, size = float(rng.uniform(0.1, 0.8)), float(rng.uniform(3.0, 20.0))
        sharpness, phase = float(rng.uniform(30, 300)), float(rng.uniform(1, 2))
        g = _pulses(size, 8 * np.pi / h, sharpness, phase)
        made.append(_case(f"pulse {number}", g, None, h))
    for number, part in enumerate((2, 5, 3.5, 4.25, 1.1, 6.77, 7, 0.5)):
        h, size = float(rng.uniform(0.1, 0.8)), float(rng.uniform(3.0, 20.0))
        made.append(_case(f"jump {number}", _jump(size, part * h), part * h, h))
    return made
