"""Problems whose end time is decided; least times in closed form or by one root."""

import casadi as ca
import numpy as np
from scipy.optimize import brentq

from swarmstart.ocp import Free
from swarmstart.tests.ocp.lower_bound.known_optimum import (
    KnownOptimum,
    Symbols,
    known,
    stated,
)


def least_time(x: float, v: float, accelerate: float, brake: float) -> float:
    """Return the least time of x'' = u in [-accelerate, brake] from x > 0 to rest.

    The state must be on the right of the curve on which only the brake is needed.
    """
    fastest = np.sqrt(
        (x + v * v / (2 * accelerate)) * 2 * accelerate * brake / (accelerate + brake)
    )
    return float((v + fastest) / accelerate + fastest / brake)


def to_rest(
    x: float, v: float, *, accelerate: float = 1.0, brake: float = 1.0, name: str
) -> KnownOptimum:
    """Return the double integrator that is brought to rest at zero soonest."""
    s, best = Symbols(2), least_time(x, v, accelerate, brake)
    problem = stated(
        s, [s.x[1], s.u], horizon=Free(0.1, 1.5 * best, best),
        controls=(-accelerate, brake), stage=1.0, terminal=[s.x],
    )  # fmt: skip
    return known(name, problem, [x, v], best, "one switch (Bryson and Ho, 1975, 3.9)")


def scalar_time() -> KnownOptimum:
    """x' = -x + u, |u| <= 1, from 2 to 1/2: log 2."""
    s = Symbols(1)
    problem = stated(
        s, s.u - s.x, horizon=Free(0.1, 2), controls=(-1, 1), stage=1.0,
        terminal=[s.x - 0.5],
    )  # fmt: skip
    return known("least time, one state", problem, 2.0, np.log(2), "u = -1: log 2")


def faster_outside() -> KnownOptimum:
    """x' = u (1 + x^2), |u| <= 1, from 0 to 1: pi / 4."""
    s = Symbols(1)
    problem = stated(
        s, s.u * (1 + s.x**2), horizon=Free(0.1, 2), controls=(-1, 1), stage=1.0,
        terminal=[s.x - 1],
    )  # fmt: skip
    return known("faster outside", problem, 0.0, np.pi / 4, "u = 1: arctan 1")


def oscillator() -> KnownOptimum:
    """x'' = -x + u, |u| <= 1, from (2, 0): half a turn about (1, 0) with u = 1."""
    s = Symbols(2)
    problem = stated(
        s, [s.x[1], s.u - s.x[0]], horizon=Free(0.5, 4.5, 3.0), controls=(-1, 1),
        stage=1.0, terminal=[s.x],
    )  # fmt: skip
    return known(
        "oscillator to rest",
        problem,
        [2.0, 0.0],
        np.pi,
        "Bushaw (1958): half a turn",
    )


def current() -> KnownOptimum:
    """Zermelo: a boat of speed 1 in a steady current of 1/2, to (1, 1)."""
    s = Symbols(2)
    problem = stated(
        s, [ca.cos(s.u) + 0.5, ca.sin(s.u)], horizon=Free(0.1, 3, 1.0),
        controls=(-np.pi, np.pi), stage=1.0, terminal=[s.x - 1],
    )  # fmt: skip
    best = (np.sqrt(7) - 1) / 1.5  # Of (1 - T / 2)^2 + 1 = T^2.
    return known("Zermelo, steady current", problem, [0.0, 0.0], best, "straight way")


def energy_and_time() -> KnownOptimum:
    """x' = u from 0 to 1, 1 + u^2: T + 1 / T."""
    s = Symbols(1)
    problem = stated(
        s, s.u, horizon=Free(0.2, 4, 1.5), controls=(-4, 4), stage=1 + s.u**2,
        terminal=[s.x - 1],
    )  # fmt: skip
    return known("energy and time", problem, 0.0, 2.0, "T + 1 / T at T = 1")


def energy_and_time_to_rest() -> KnownOptimum:
    """x'' = u from rest to rest, a distance of 1, 1 + u^2: T + 12 / T^3."""
    s = Symbols(2)
    problem = stated(
        s, [s.x[1], s.u], horizon=Free(0.5, 4, 2.0), controls=(-3, 3),
        stage=1 + s.u**2, terminal=[s.x],
    )  # fmt: skip
    best = 4 / 3 * np.sqrt(6)
    return known(
        "energy and time to rest", problem, [1.0, 0.0], best, "T + 12 / T^3, T^4 = 36"
    )


def brachistochrone() -> KnownOptimum:
    """x' = v sin a, v' = cos a from (0, 1) to x = 1: a cycloid that ends level.

    Its depth is v^2 / 2 = r (1 - cos q), x = r (q - sin q) + const, time sqrt(r) q.
    """
    s = Symbols(2)
    problem = stated(
        s, [s.x[1] * ca.sin(s.u), ca.cos(s.u)], horizon=Free(0.1, 2, 0.8),
        controls=(0, np.pi), stage=1.0, terminal=[s.x[0] - 1],
    )  # fmt: skip

    def radius(q: float) -> float:
        return float(0.5 / (1 - np.cos(q)))

    q = brentq(lambda q: radius(q) * (np.pi - q + np.sin(q)) - 1, 0.1, 3.1, xtol=1e-14)
    best = np.sqrt(radius(q)) * (np.pi - q)
    return known("brachistochrone", problem, [0.0, 1.0], best, "cycloid, one root")


def family() -> list[KnownOptimum]:
    """Return all problems whose end time is decided."""
    return [
        to_rest(1.0, 0.0, name="to rest in the least time"),
        to_rest(1.0, 1.0, name="to rest in the least time, on the way out"),
        to_rest(1.0, 0.0, brake=2.0, name="to rest, with stronger brakes"),
        scalar_time(),
        faster_outside(),
        oscillator(),
        current(),
        energy_and_time(),
        energy_and_time_to_rest(),
        brachistochrone(),
    ]
