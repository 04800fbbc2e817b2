"""Nonlinear problems with a known optimum: linear ones in other coordinates.

    z' = A z + B u + c,  x_i = phi(z_i)   gives   x' = phi'(z) * (A z + B u + c)

with z = phi^-1(x): the controls and costs of both are the same. Where phi has a pole or
ends, x escapes in finite time, overflows, or leaves the domain of a root or logarithm.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.tests.adversary.case import Case, Formulas
from swarmstart.tests.adversary.exact.convex import UnsolvedError
from swarmstart.tests.adversary.exact.held_linear import Linear
from swarmstart.tests.adversary.exact.rk4 import substeps_needed
from swarmstart.tests.adversary.judge import Rows, replay
from swarmstart.tests.adversary.linear_case import formulas_of, linear_case, truth_of


class Symbolic(NamedTuple):
    """A chart in CasADi: z of x, and dx/dz as a function of x."""

    inverse: Callable[[ca.SX], ca.SX]
    slope: Callable[[ca.SX], ca.SX]


class Numeric(NamedTuple):
    """A chart in NumPy: x of z, z of x, and dx/dz as a function of x."""

    forward: Callable[[Array], Array]
    inverse: Callable[[Array], Array]
    slope: Callable[[Array], Array]


@dataclass(frozen=True, kw_only=True, slots=True)
class Chart:
    """Coordinates x = phi(z) of each state.

    Attributes:
        symbolic: In CasADi.
        numeric: In NumPy.
        lower: Of z; phi exists above it only.
        upper: Of z; phi exists below it only.
    """

    symbolic: Symbolic
    numeric: Numeric
    lower: float = -np.inf
    upper: float = np.inf


CHARTS = {
    "x' = x^2 v": Chart(
        symbolic=Symbolic(lambda x: -1 / x, lambda x: x**2),
        numeric=Numeric(lambda z: -1 / z, lambda x: -1 / x, np.square),
        upper=0.0,
    ),
    "x' = x^3 v": Chart(
        symbolic=Symbolic(lambda x: -0.5 / x**2, lambda x: x**3),
        numeric=Numeric(
            lambda z: (-2 * z) ** -0.5, lambda x: -1 / (2 * x * x), lambda x: x * x * x
        ),
        upper=0.0,
    ),
    "x' = exp(x) v": Chart(
        symbolic=Symbolic(lambda x: -ca.exp(-x), ca.exp),
        numeric=Numeric(lambda z: -np.log(-z), lambda x: -np.exp(-x), np.exp),
        upper=0.0,
    ),
    "x' = x v": Chart(
        symbolic=Symbolic(ca.log, lambda x: x),
        numeric=Numeric(np.exp, np.log, np.asarray),
    ),
    "x' = 2 sqrt(x) v": Chart(
        symbolic=Symbolic(ca.sqrt, lambda x: 2 * ca.sqrt(x)),
        numeric=Numeric(np.square, np.sqrt, lambda x: 2 * np.sqrt(x)),
        lower=0.0,
    ),
    "x' = (1 + x^2) v": Chart(
        symbolic=Symbolic(ca.atan, lambda x: 1 + x**2),
        numeric=Numeric(np.tan, np.arctan, lambda x: 1 + np.square(x)),
        lower=-np.pi / 2,
        upper=np.pi / 2,
    ),
    "x' = cosh(x)^2 v": Chart(
        symbolic=Symbolic(ca.tanh, lambda x: ca.cosh(x) ** 2),
        numeric=Numeric(np.arctanh, np.tanh, lambda x: np.square(np.cosh(x))),
        lower=-1.0,
        upper=1.0,
    ),
    "x' = sqrt(1 + x^2) v": Chart(
        symbolic=Symbolic(ca.asinh, lambda x: ca.sqrt(1 + x**2)),
        numeric=Numeric(np.sinh, np.arcsinh, lambda x: np.hypot(1.0, x)),
    ),
}


def charted_case(
    kind: str, name: str, linear: Linear, chart: Chart, *, margin: float = 0.1
) -> Case:
    """Return the case of a linear problem in other coordinates.

    Args:
        kind: The class it counts in.
        name: Its name in this class.
        linear: The problem in z; its bounds of states become path constraints.
        chart: The coordinates.
        margin: How near the optimum may come to where the chart ends, in z.

    Raises:
        UnsolvedError: If it has no solution, or one that comes nearer.
    """
    known = linear_case(kind, name, linear, absolute=1e-4)
    if known.best is None:
        raise UnsolvedError(name)
    flown = replay(known.truth, known.best)
    low, high = chart.lower + margin, chart.upper - margin
    if flown is None or flown.states.min() < low or flown.states.max() > high:
        raise UnsolvedError(f"{name} leaves its chart")
    own, numeric, symbolic = truth_of(linear), chart.numeric, chart.symbolic
    held = own.path.value
    rows, ends = linear.rows, linear.ends

    def formulas(x: ca.SX, u: ca.SX) -> Formulas:
        z = symbolic.inverse(x)
        flat = formulas_of(linear, z, u)
        path = ca.DM(rows.C) @ z + ca.DM(rows.D) @ u if rows.lower.size else None
        return flat._replace(ode=symbolic.slope(x) * flat.ode, path=path)

    truth = replace(
        known.truth,
        dynamics=lambda x, u: numeric.slope(x) * own.dynamics(numeric.inverse(x), u),
        stage_cost=lambda x, u: own.stage_cost(numeric.inverse(x), u),
        terminal_cost=lambda x: own.terminal_cost(numeric.inverse(x)),
        path=replace(own.path, value=lambda x, u: held(numeric.inverse(x), u)),
        terminal=Rows(
            value=lambda x, _: ends.E @ numeric.inverse(x),
            lower=ends.lower,
            upper=ends.upper,
        ),
        x0=numeric.forward(linear.x0),
        sizes=np.abs(numeric.forward(flown.states)).max(axis=(0, 2)),
    )
    return replace(
        known,
        formulas=formulas,
        truth=truth,
        states=None,
        substeps=substeps_needed(truth, known.best, checks=known.checks),
    )
