"""A case: one problem in CasADi, beside it the same in NumPy, and what is known of it.

Numbers (limits, horizon, initial state) are given once, formulas twice. A case is
stated in its own units; `in_units` states it in others:

    x~ = sx x,  u~ = su u,  J~ = sj J,  constraints and terminal constraints times sx
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
    found = case.formulas(x, u)
    path, terminal = found.path, found.terminal
    count = 0 if path is None else path.numel()
    limits = truth.path.lower[:count], truth.path.upper[:count]
    ends = truth.terminal
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=found.ode),
        horizon=truth.horizon,
        intervals=truth.intervals,
        stage_cost=ca.SX(found.stage_cost),
        terminal_cost=ca.SX(found.terminal_cost),
        bounds=Bounds(controls=truth.controls, states=case.states),
        constraints=[]
        if path is None
        else [PathConstraint(expression=path, lower=limits[0], upper=limits[1])],
        terminal=[]
        if terminal is None
        else [
            TerminalConstraint(expression=terminal, lower=ends.lower, upper=ends.upper)
        ],
        substeps=case.substeps,
        integrator=case.integrator,
        checks=case.checks,
    )


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
