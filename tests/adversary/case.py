"""A case: one problem in CasADi, beside it the same in NumPy, and what is known of it.

Numbers (limits, horizon, initial state) are given once, formulas twice. A case is
stated in its own units; `in_units` states it in others:

    x~ = sx x,  u~ = su u,  J~ = sj J,  constraints and terminal constraints times sx

A case may be stated from another origin: with x~ = x + o in its problem and in x0,
while its truth stays as it is. So its answer is judged in the units of its truth.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Model,
    OptimalControlProblem,
    PathConstraint,
    TerminalConstraint,
)
from swarmstart.tests.adversary.judge import Rate, Rows, Truth


class Formulas(NamedTuple):
    """A problem's expressions in CasADi.

    Attributes:
        ode: Right-hand side, shape (nx, 1).
        stage_cost: Scalar.
        terminal_cost: Scalar in the states.
        path: What the truth's path rows limit, shape (m, 1), without the states.
        terminal: What the truth's terminal rows limit, shape (m, 1).
    """

    ode: ca.SX
    stage_cost: ca.SX | float = 0.0
    terminal_cost: ca.SX | float = 0.0
    path: ca.SX | None = None
    terminal: ca.SX | None = None


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Case:
    """One problem with an answer known otherwise.

    Attributes:
        name: Unique among all cases.
        kind: The class it counts in.
        formulas: (x, u) -> expressions.
        truth: The same in NumPy; bounded states are the last rows of its path.
        states: Lower and upper bounds of the states, each (nx,); None: unbounded.
        checks: Of each interval.
        substeps: Of the integrator in each check.
        integrator: A key of INTEGRATORS.
        best: Controls of a right answer, shape (nu, N); None if only its cost is known.
        is_counted: Whether it counts in the shares.
        origin: The o of the problem's states, shape (nx,); None: 0.
    """

    name: str
    kind: str
    formulas: Callable[[ca.SX, ca.SX], Formulas]
    truth: Truth
    states: tuple[Array, Array] | None = None
    checks: int = 1
    substeps: int = 4
    integrator: str = "rk4"
    best: Array | None = None
    is_counted: bool = True
    origin: Array | None = None

    @property
    def start(self) -> Array:
        """The problem's initial state, from its origin, shape (nx,)."""
        return self.truth.x0 if self.origin is None else self.truth.x0 + self.origin


def limits(lower: ArrayLike, upper: ArrayLike) -> tuple[Array, Array]:
    """Return bounds as arrays; a number is one of one control or row."""
    return np.atleast_1d(np.asarray(lower, dtype=np.float64)), np.atleast_1d(
        np.asarray(upper, dtype=np.float64)
    )


def equal(value: Rate, target: ArrayLike) -> Rows:
    """Return the rows value(x, u) = target."""
    lower, upper = limits(target, target)
    return Rows(value=value, lower=lower, upper=upper)


def known(case: Case, optimum: float, *, relative: float = 2e-3) -> Case:
    """Return the case with its optimum, right to so much of it."""
    room = relative * abs(optimum) + 1e-5
    truth = replace(case.truth, lowest=optimum - 5 * room, highest=optimum + room)
    return replace(case, truth=truth)


def unsolvable(case: Case) -> Case:
    """Return the case as one that has no solution."""
    return replace(case, truth=replace(case.truth, is_solvable=False))


class Units(NamedTuple):
    """By what states, controls and costs are multiplied."""

    states: float = 1.0
    controls: float = 1.0
    cost: float = 1.0


UNITS = (Units(), Units(1e-3, 1e2, 1e-6), Units(1e3, 1e-2, 1e6))


def problem_of(case: Case) -> OptimalControlProblem:
    """Return a case as the package takes it."""
    truth = case.truth
    x, u = ca.SX.sym("x", truth.x0.size), ca.SX.sym("u", truth.controls[0].size)
    origin = np.zeros(truth.x0.size) if case.origin is None else case.origin
    found, plain = case.formulas(x - origin, u), case.formulas(x, u)
    rows = [
        None
        if moved is None or own is None
        else _from_origin((moved, own), limits, x, origin)
        for moved, own, limits in (
            (found.path, plain.path, truth.path),
            (found.terminal, plain.terminal, truth.terminal),
        )
    ]
    bounds = case.states
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=found.ode),
        horizon=truth.horizon,
        intervals=truth.intervals,
        stage_cost=ca.SX(found.stage_cost),
        terminal_cost=ca.SX(found.terminal_cost),
        bounds=Bounds(
            controls=truth.controls,
            states=bounds and (bounds[0] + origin, bounds[1] + origin),
        ),
        constraints=[
            PathConstraint(expression=values, lower=lower, upper=upper)
            for values, lower, upper in filter(None, rows[:1])
        ],
        terminal=[
            TerminalConstraint(expression=values, lower=lower, upper=upper)
            for values, lower, upper in filter(None, rows[1:])
        ],
        substeps=case.substeps,
        integrator=case.integrator,
        checks=case.checks,
    )


def _from_origin(
    values: tuple[ca.SX, ca.SX], limits: Rows, x: ca.SX, origin: Array
) -> tuple[ca.SX, Array, Array]:
    """Return rows with the limits of a user who counts from that origin.

    A linear row is one of x~, and its limits move; others contain x~ - o.

    Args:
        values: In x~ - o and in x~, shape (m, 1).
        limits: In x; only the first m count.
        x: Symbols of the states, x~.
        origin: The o, shape (nx,).
    """
    moved, own = values
    count = own.numel()
    lower, upper = limits.lower[:count].copy(), limits.upper[:count].copy()
    found = ca.SX(moved)
    slopes = ca.jacobian(own, x)
    for row in range(count):
        if slopes[row, :].is_constant() and origin.any():
            offset = float(ca.mtimes(slopes[row, :], origin))
            found[row] = own[row]
            lower[row] += offset
            upper[row] += offset
    return found, lower, upper


def in_units(case: Case, units: Units) -> Case:
    """Return the same case stated in other units; formulas and truth alike."""
    sx, su, sj = units
    truth, formulas = case.truth, case.formulas

    def stated(x: ca.SX, u: ca.SX) -> Formulas:
        own = formulas(x / sx, u / su)
        return Formulas(
            ode=sx * own.ode,
            stage_cost=sj * own.stage_cost,
            terminal_cost=sj * own.terminal_cost,
            path=None if own.path is None else sx * own.path,
            terminal=None if own.terminal is None else sx * own.terminal,
        )

    def times(rate: Rate) -> Rate:
        return lambda x, u: sx * np.asarray(rate(x / sx, u / su))

    def rows(own: Rows) -> Rows:
        return Rows(value=times(own.value), lower=sx * own.lower, upper=sx * own.upper)

    lower, upper = truth.controls
    return replace(
        case,
        name=case.name + ("" if units == Units() else f" x{sx:g}"),
        formulas=stated,
        states=None
        if case.states is None
        else (sx * case.states[0], sx * case.states[1]),
        best=None if case.best is None else su * case.best,
        origin=None if case.origin is None else sx * case.origin,
        truth=replace(
            truth,
            dynamics=times(truth.dynamics),
            stage_cost=lambda x, u: sj * truth.stage_cost(x / sx, u / su),
            terminal_cost=lambda x: sj * truth.terminal_cost(x / sx),
            path=rows(truth.path),
            terminal=rows(truth.terminal),
            kinks=times(truth.kinks),
            end_kinks=times(truth.end_kinks),
            controls=(su * lower, su * upper),
            x0=sx * truth.x0,
            sizes=sx * truth.sizes,
            cost_size=sj * truth.cost_size,
            lowest=sj * truth.lowest,
            highest=sj * truth.highest,
        ),
    )
