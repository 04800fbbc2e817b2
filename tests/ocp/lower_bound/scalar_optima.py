"""Problems with one state whose optimum is known in closed form, or by one root."""

import math

import casadi as ca
import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar

from swarmstart.tests.ocp.lower_bound.known_optimum import (
    KnownOptimum,
    Symbols,
    known,
    stated,
)


def regulator(x0: float = 1.0, horizon: float = 1.0) -> KnownOptimum:
    """x' = u, x^2 + u^2: P' = P^2 - 1 from P(T) = 0."""
    s = Symbols(1)
    problem = stated(
        s, s.u, horizon=horizon, controls=(-5, 5), stage=s.x**2 + s.u**2
    )  # fmt: skip
    optimum = np.tanh(horizon) * x0**2
    return known("regulator", problem, x0, optimum, "Riccati: tanh(T) x0^2")


def saturated_regulator() -> KnownOptimum:
    """The same with |u| <= 1/2: at its bound first, as x tanh(T - t) falls."""
    s, x0, T, most = Symbols(1), 2.0, 2.0, 0.5
    problem = stated(s, s.u, horizon=T, controls=(-most, most), stage=s.x**2 + s.u**2)
    t = brentq(lambda t: (x0 - most * t) * np.tanh(T - t) - most, 0, T, xtol=1e-14)
    left = x0 - most * t
    cost = (x0**3 - left**3) / (3 * most) + most**2 * t + left**2 * np.tanh(T - t)
    return known(
        "saturated regulator", problem, x0, cost, "one switch, then the Riccati law"
    )


def energy() -> KnownOptimum:
    """x' = u from 0 to 1 with the least integral of u^2."""
    s = Symbols(1)
    problem = stated(
        s, s.u, horizon=1.0, controls=(-3, 3), stage=s.u**2, terminal=[s.x - 1]
    )
    return known("energy", problem, 0.0, 1.0, "u = 1, by Cauchy and Schwarz")


def energy_against_decay() -> KnownOptimum:
    """x' = -x + u from 0 to 1: u grows as e^t."""
    s, T = Symbols(1), 1.0
    problem = stated(
        s, s.u - s.x, horizon=T, controls=(-4, 4), stage=s.u**2, terminal=[s.x - 1]
    )
    optimum = 2 / (1 - np.exp(-2 * T))
    return known("energy against decay", problem, 0.0, optimum, "Gramian")


def decay() -> KnownOptimum:
    """x' = -u x, x(T) least: u = 1 always."""
    s, T = Symbols(1), 1.5
    problem = stated(s, -s.u * s.x, horizon=T, controls=(0, 1), end=s.x)
    return known("decay", problem, 1.0, np.exp(-T), "u = 1: exp(-T)")


def dottie() -> KnownOptimum:
    """x' = u x, x^2 + u^2; of z = log x: u^2 - x^2 is constant.

    u(T) = 0, so that T = integral of dx / (x sqrt(x^2 - m^2)), m = x(T) = cos(m T) x0.
    """
    s = Symbols(1)
    problem = stated(s, s.u * s.x, horizon=1.0, controls=(-2, 2), stage=s.x**2 + s.u**2)
    m = brentq(lambda m: np.cos(m) - m, 0, 1, xtol=1e-15)
    optimum = 2 * np.sqrt(1 - m * m) - m * m
    return known("dottie", problem, 1.0, optimum, "an energy that is kept; cos m = m")


def catch() -> KnownOptimum:
    """x' = x - u to 0, each catch worth sqrt(u): the integral of e^-t u is 1."""
    s, T = Symbols(1), 1.0
    problem = stated(
        s, s.x - s.u, horizon=T, controls=(0.1, 6), stage=ca.sqrt(s.u),
        terminal=[s.x], maximize=True,
    )  # fmt: skip
    return known(
        "catch", problem, 1.0, math.sqrt(math.e - 1), "u = e^2t / (e - 1): sqrt(e - 1)"
    )


def reinvestment() -> KnownOptimum:
    """x' = u x, (1 - u) x is consumed: invest until one second before the end."""
    s, T = Symbols(1), 2.0
    problem = stated(
        s, s.u * s.x, horizon=T, controls=(0, 1), stage=(1 - s.u) * s.x, maximize=True
    )
    return known("reinvestment", problem, 1.0, np.exp(T - 1), "one switch: e^(T - 1)")


def fishing(start: float, name: str) -> KnownOptimum:
    """x' = x (1 - x) - u with 0 <= u <= 1, x(T) >= 1/2: the catch is largest.

    The catch is x0 - x(T) + the integral of x (1 - x), which is largest at x = 1/2.
    """
    s, T = Symbols(1), 3.0
    problem = stated(
        s, s.x * (1 - s.x) - s.u, horizon=T, controls=(0, 1), stage=s.u,
        terminal=[s.x >= 0.5], maximize=True,
    )  # fmt: skip
    time, _ = quad(lambda x: 1 / (1 - x + x * x), 0.5, start, epsabs=1e-14)
    optimum = time + (T - time) / 4
    return known(name, problem, start, optimum, "nearest way to x = 1/2, by quadrature")


def to_zero() -> KnownOptimum:
    """x' = u, |u| <= 1, the integral of x^2: to zero, and stay (singular)."""
    s = Symbols(1)
    problem = stated(s, s.u, horizon=2.0, controls=(-1, 1), stage=s.x**2)
    return known("to zero and stay", problem, 1.0, 1 / 3, "1/3")


def fuel() -> KnownOptimum:
    """x' = -x + u, 0 <= u <= 1, x(T) >= 1/2 with the least integral of u: late."""
    s = Symbols(1)
    problem = stated(
        s, s.u - s.x, horizon=2.0, controls=(0, 1), stage=s.u, terminal=[s.x >= 0.5]
    )
    return known("fuel", problem, 0.0, np.log(2), "u = 1 for the last log 2 s")


def in_time() -> KnownOptimum:
    """x' = u + sin t, u^2 and 5 (x(T) - 2)^2: explicit time."""
    s, T = Symbols(1), 2.0
    problem = stated(
        s, s.u + ca.sin(s.t), horizon=T, controls=(-2, 2), stage=s.u**2,
        end=5 * (s.x - 2) ** 2,
    )  # fmt: skip
    far = 2 - (1 - np.cos(T))
    return known(
        "a rate of time", problem, 0.0, 5 * far**2 / (1 + 5 * T), "u is constant"
    )


def discounted() -> KnownOptimum:
    """x' = -u, e^-t log(1 + u) is worth most, x(T) >= 0; u > 0 all along."""
    s, T, x0 = Symbols(1), 1.0, 1.5
    problem = stated(
        s, -s.u, horizon=T, controls=(0, 4), stage=ca.exp(-s.t) * ca.log(1 + s.u),
        terminal=[s.x >= 0], maximize=True,
    )  # fmt: skip
    # 1 + u = e^-t / p with the integral of u = x0.
    price = (1 - np.exp(-T)) / (x0 + T)
    worth, _ = quad(lambda t: np.exp(-t) * (-t - np.log(price)), 0, T, epsabs=1e-14)
    return known("discounted", problem, x0, worth, "constant costate, by quadrature")


def two_controls() -> KnownOptimum:
    """x' = u1 + 2 u2 from 0 to 1: u along (1, 2)."""
    s = Symbols(1, 2)
    problem = stated(
        s, s.u[0] + 2 * s.u[1], horizon=1.0, controls=(-1, 1), stage=ca.sumsqr(s.u),
        terminal=[s.x - 1],
    )  # fmt: skip
    return known("two controls", problem, 0.0, 0.2, "1/5, by Cauchy and Schwarz")


def negative() -> KnownOptimum:
    """x' = u, |u| <= 1, the integral of x: a negative cost."""
    s = Symbols(1)
    problem = stated(s, s.u, horizon=2.0, controls=(-1, 1), stage=s.x)
    return known("negative cost", problem, 0.0, -2.0, "u = -1: -T^2 / 2")


def nothing_to_do() -> KnownOptimum:
    """The regulator that begins at its target."""
    s = Symbols(1)
    problem = stated(s, s.u, horizon=1.0, controls=(-1, 1), stage=s.x**2 + s.u**2)
    return known("nothing to do", problem, 0.0, 0.0, "u = 0")


def two_wells() -> KnownOptimum:
    """x' = u, u^2 / 10 and an end cost with two wells: the nearer one is worse."""
    s, T, x0 = Symbols(1), 1.0, 0.3
    problem = stated(
        s, s.u, horizon=T, controls=(-4, 4), stage=s.u**2 / 10,
        end=(s.x**2 - 1) ** 2 + 0.4 * s.x,
    )  # fmt: skip

    def cost(y: float) -> float:
        return float((y - x0) ** 2 / 10 / T + (y * y - 1) ** 2 + 0.4 * y)

    tight = {"xatol": 1e-12}
    best = min(
        float(minimize_scalar(cost, bounds=well, method="bounded", options=tight).fun)
        for well in ((-2, 0), (0, 2))
    )
    return known("two wells", problem, x0, best, "constant u, then one variable")


def waves() -> KnownOptimum:
    """x' = u, |u| <= 1, the integral of 1 + cos x from 0: as fast as it can to pi."""
    s, T = Symbols(1), 4.0
    problem = stated(s, s.u, horizon=T, controls=(-1, 1), stage=1 + ca.cos(s.x))
    return known("waves", problem, 0.0, np.pi, "to pi, and stay: pi")


def unstable() -> KnownOptimum:
    """x' = x^3 / 5 + u with the cost made for the value 1 - cos x + x^2: inverse."""
    s = Symbols(1)
    x, u = s.x, s.u
    value, rate = 1 - ca.cos(x) + x**2, x**3 / 5
    slope = ca.sin(x) + 2 * x
    problem = stated(
        s, rate + u, horizon=1.0, controls=(-3, 3),
        stage=u**2 + slope**2 / 4 - slope * rate, end=value,
    )  # fmt: skip
    x0 = 1.2
    return known(
        "unstable", problem, x0, 1 - np.cos(x0) + x0**2, "a cost made for its value"
    )


def family() -> list[KnownOptimum]:
    """Return all problems with one state and a given horizon."""
    return [
        regulator(),
        saturated_regulator(),
        energy(),
        energy_against_decay(),
        decay(),
        dottie(),
        catch(),
        reinvestment(),
        fishing(0.5, "fishing from the best stock"),
        fishing(0.8, "fishing from a larger stock"),
        to_zero(),
        fuel(),
        in_time(),
        discounted(),
        two_controls(),
        negative(),
        nothing_to_do(),
        two_wells(),
        waves(),
        unstable(),
    ]
