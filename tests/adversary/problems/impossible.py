"""Nonlinear problems without a solution; a comment says why there is none."""

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np

from swarmstart.tests.adversary.case import Formulas, equal, limits
from swarmstart.tests.adversary.judge import Rate, Rows, Truth

Posed = tuple[Callable[[ca.SX, ca.SX], Formulas], Truth]


def _moving(rate: Rate, x0: list[float], control: list[float]) -> Truth:
    """Return the energy of a system for 2 s, each control within -limit and limit."""
    bound = np.array(control)
    return Truth(
        dynamics=rate, stage_cost=lambda x, u: float(u @ u), x0=np.array(x0),
        controls=limits(-bound, bound), horizon=2.0, intervals=8,
        sizes=np.ones(len(x0)),
    )  # fmt: skip


def _below(value: Rate, upper: float) -> Rows:
    """Return the row value(x, u) <= upper."""
    return Rows(value=value, lower=np.full(1, -np.inf), upper=np.array([upper]))


def _scalar() -> dict[str, Posed]:
    """Return problems of one state, x(0) = 0 except for the brakes."""
    still = replace(_moving(lambda x, u: u, [0.0], [1.0]), horizon=1.0)
    return {
        # A sine is at most 1.
        "a sine of 1.5": (
            lambda x, u: Formulas(u, u**2, terminal=ca.sin(3 * x) - 1.5),
            replace(still, terminal=equal(lambda x, _: np.sin(3 * x) - 1.5, 0.0)),
        ),
        "a square of -1": (
            lambda x, u: Formulas(u, u**2, terminal=x**2),
            replace(still, terminal=equal(lambda x, _: x * x, -1.0)),
        ),
        # The kinetic energy, 2, falls by 0.8 * 2 at most.
        "brakes too weak in power": (
            lambda v, u: Formulas(u, u**2, path=-u * v, terminal=v),
            replace(
                _moving(lambda v, u: u, [2.0], [5.0]),
                path=_below(lambda v, u: -u * v, 0.8),
                terminal=equal(lambda v, _: v, 0.0),
            ),
        ),
        # The velocity never turns round, and the target lies behind.
        "only forward": (
            lambda x, u: Formulas(ca.exp(u), u**2, terminal=x),
            replace(
                still,
                dynamics=lambda x, u: np.exp(u),
                terminal=equal(lambda x, _: x, -0.5),
            ),
        ),
    }


def _planar() -> dict[str, Posed]:
    """Return problems of several states."""
    energy = Rows(
        value=lambda x, _: x, lower=np.array([1.0, 0.0]), upper=np.array([1.0, 0.4])
    )
    return {
        # Cauchy and Schwarz: the energy is at least x(T)^2 / T = 1 / 2.
        "too little energy": (
            lambda x, u: Formulas(ca.vertcat(u, u**2), u**2, terminal=x),
            replace(
                _moving(lambda x, u: np.array([u[0], u[0] * u[0]]), [0.0, 0.0], [2.0]),
                terminal=energy,
            ),
        ),
        # At speed 1 it takes 2.5 s, and there are 2 s.
        "a unicycle too slow": (
            lambda x, u: Formulas(
                ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), u), u**2, terminal=x[:2]
            ),
            replace(
                _moving(
                    lambda x, u: np.array([np.cos(x[2]), np.sin(x[2]), u[0]]),
                    [0.0, 0.0, 0.0],
                    [2.0],
                ),
                terminal=equal(lambda x, _: x[:2], [1.5, 2.0]),
            ),
        ),
        # The disc around the start that may not be left does not hold the target.
        "a target beyond the fence": (
            lambda x, u: Formulas(u, ca.sumsqr(u), path=ca.sumsqr(x), terminal=x),
            replace(
                _moving(lambda x, u: u, [0.0, 0.0], [2.0, 2.0]),
                path=_below(lambda x, u: np.array([x @ x]), 1.0),
                terminal=equal(lambda x, _: x, [1.0, 1.0]),
            ),
        ),
        # Its energy E = speed^2 / 2 + 9.81 (1 - cos(angle)) has to come to 19.62, but
        # E' = u speed gives sqrt(E)' <= 0.36, so that E is at most 0.6 after 2 s.
        "a pendulum that cannot be lifted": (
            lambda x, u: Formulas(
                ca.vertcat(x[1], u - 9.81 * ca.sin(x[0])), u**2, terminal=x[0] - ca.pi
            ),
            replace(
                _moving(
                    lambda x, u: np.array([x[1], u[0] - 9.81 * np.sin(x[0])]),
                    [0.0, 0.0],
                    [0.5],
                ),
                terminal=equal(lambda x, _: x[:1] - np.pi, 0.0),
            ),
        ),
    }


def impossible() -> dict[str, Posed]:
    """Return all of them by name, in CasADi and in NumPy."""
    return _scalar() | _planar()
