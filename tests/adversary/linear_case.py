"""Cases of linear systems: formulas in CasADi, the same in NumPy, the exact optimum.

The optimum with path rows at the ends of the intervals only is a lower bound of the
cost; that with the rows at many points more is an upper one.
"""

from dataclasses import replace

import casadi as ca
import numpy as np

from swarmstart.tests.adversary.case import Case, Formulas, unsolvable
from swarmstart.tests.adversary.exact.convex import solve_convex
from swarmstart.tests.adversary.exact.held_linear import Linear, program_of
from swarmstart.tests.adversary.judge import Rows, Truth

ROOM = 2e-3
"""Relative: an answer is right up to this much above the optimum."""
SLACK = 1e-2
"""Relative: what tolerances of the constraints can bring, so much below at most."""
DENSE = 9
"""Points in each interval at which path rows hold in the upper bound."""
FINE = 0.05
"""The longest step of the integrator, in 1 / |A|: an error of 1e-6 or less in all."""


def formulas_of(linear: Linear, x: ca.SX, u: ca.SX) -> Formulas:
    """Return a linear problem's expressions in CasADi."""
    m = ca.mtimes
    path, end = linear.path, linear.end
    return Formulas(
        ode=m(ca.DM(linear.A), x) + m(ca.DM(linear.B), u) + ca.DM(linear.c),
        stage_cost=ca.bilin(ca.DM(linear.Q), x, x)
        + ca.bilin(ca.DM(linear.R), u, u)
        + ca.dot(ca.DM(linear.q), x)
        + ca.dot(ca.DM(linear.r), u),
        terminal_cost=ca.bilin(ca.DM(linear.P), x, x) + ca.dot(ca.DM(linear.p), x),
        path=m(ca.DM(path.C), x) + m(ca.DM(path.D), u) if path is not None else None,
        terminal=None if end is None else m(ca.DM(end.E), x),
    )


def truth_of(linear: Linear) -> Truth:
    """Return a linear problem in NumPy; what is known of its answer is not in it."""
    p, rows, end = linear, linear.rows, linear.ends
    sizes = np.maximum(np.abs(p.x0), 1.0)
    return Truth(
        dynamics=lambda x, u: p.A @ x + p.B @ u + p.c,
        stage_cost=lambda x, u: float(x @ p.Q @ x + u @ p.R @ u + p.q @ x + p.r @ u),
        terminal_cost=lambda x: float(x @ p.P @ x + p.p @ x),
        path=Rows(
            value=lambda x, u: rows.C @ x + rows.D @ u,
            lower=rows.lower,
            upper=rows.upper,
        ),
        terminal=Rows(value=lambda x, _: end.E @ x, lower=end.lower, upper=end.upper),
        controls=p.controls,
        x0=p.x0,
        horizon=p.horizon,
        intervals=p.intervals,
        sizes=sizes,
    )


def substeps_of(linear: Linear, checks: int) -> int:
    """Return how many steps of RK4 a check needs."""
    length = linear.horizon / linear.intervals / checks
    return max(2, int(np.ceil(float(np.linalg.norm(linear.A, 2)) * length / FINE)))


def linear_case(
    kind: str,
    name: str,
    linear: Linear,
    *,
    checks: int = 1,
    absolute: float = 1e-5,
    is_counted: bool = True,
) -> Case:
    """Return the case of a linear problem, with its exact optimum.

    Args:
        kind: The class it counts in.
        name: Its name in this class.
        linear: The problem.
        checks: Of each interval.
        absolute: How far off the optimum is right besides the relative tolerance.
        is_counted: Whether it counts in the shares.

    Raises:
        UnsolvedError: If it has no solution.
    """
    least = most = solve_convex(program_of(linear))
    if linear.rows.lower.size:
        most = solve_convex(program_of(linear, points=DENSE))
    lowest = least.cost - least.gap - SLACK * abs(least.cost) - absolute
    return Case(
        name=f"{kind}/{name}",
        kind=kind,
        formulas=lambda x, u: formulas_of(linear, x, u),
        truth=replace(
            truth_of(linear),
            lowest=lowest,
            highest=most.cost + ROOM * abs(most.cost) + absolute,
        ),
        states=linear.states,
        checks=checks,
        substeps=substeps_of(linear, checks),
        best=most.point.reshape((-1, linear.intervals), order="F"),
        is_counted=is_counted,
    )


def unsolvable_case(kind: str, name: str, linear: Linear, *, checks: int = 1) -> Case:
    """Return the case of a linear problem that has no solution; see `linear_case`."""
    case = Case(
        name=f"{kind}/{name}",
        kind=kind,
        formulas=lambda x, u: formulas_of(linear, x, u),
        truth=truth_of(linear),
        states=linear.states,
        checks=checks,
        substeps=substeps_of(linear, checks),
    )
    return unsolvable(case)
