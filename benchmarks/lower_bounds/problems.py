"""The problems for which lower bounds are measured, with the best known costs.

Controls are free (measurable) in a bound, so the best known cost is that of free
controls too: in closed form, or of controls that are linear between many knots, from
many starts (best_known.py). The cost with controls held on the problem's own intervals
is given beside it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.ocp import (
    Bounds,
    Free,
    Known,
    Model,
    OptimalControlProblem,
    disc,
)
from swarmstart.ocp.rollout.fitness import NOTHING

GOAL = (1.5, 1.0)
DISC = ((0.75, 0.5), 0.7)
"""Centre and radius of the disc between the unicycle and its goal."""
WEIGHT = 100.0
"""Weight of the pendulum's squared error at the end."""
BEST = {
    "two_reaction_reactor": 0.13309574,
    "van_der_pol": 2.8672611,
    "pendulum": 36.323525,
    "unicycle": 0.18093102,
    "unicycle_and_disc": 0.7845594,
}
"""Costs of controls linear between 400 knots, rounded up, from `best_known.py`."""
HELD = {
    "two_reaction_reactor": 0.1355803,
    "van_der_pol": 2.869366,
    "pendulum": 36.39527,
}
"""Costs of controls held on the scenario's own intervals, from `best_known.py`."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Named:
    """A problem with its best known costs.

    Attributes:
        problem: The problem.
        x0: Initial state, shape (nx,).
        best: Least known cost of free controls.
        how: Source of that cost.
        held: Least known cost with controls held on the problem's own intervals; NaN if
            it has no grid of its own.
        goals: Goals, as pairs (CPU seconds, bound).
        known: Parameters and signals.
    """

    problem: OptimalControlProblem
    x0: Array
    best: float
    how: str
    held: float = np.nan
    goals: tuple[tuple[float, float], ...] = ()
    known: Known = NOTHING


def posed(
    ode: list[ca.SX], x: ca.SX, u: ca.SX, *, horizon: float | Free, most: float
) -> OptimalControlProblem:
    """Return a problem without costs, |u| <= most."""
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(*ode)),
        horizon=horizon,
        intervals=100,
        bounds=Bounds(controls=(-most, most)),
    )


def linear_quadratic() -> Named:
    """Double integrator, |u| <= 20, the integral of u^2 and 10 |x(1)|^2."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    bare = posed([x[1], u], x, u, horizon=1.0, most=20.0)
    return Named(
        problem=replace(bare, stage_cost=u**2, terminal_cost=10 * ca.sumsqr(x)),
        x0=np.array([1.0, 0.0]),
        best=82.5 / 17,
        how="closed form, by the Gramian: 82.5 / 17",
        goals=((30, 4.848), (60, 4.8525)),
    )


def minimum_time() -> Named:
    """Double integrator, |u| <= 1, to rest at zero in the least time."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    bare = posed([x[1], u], x, u, horizon=Free(0.1, 4.0, 2.5), most=1.0)
    return Named(
        problem=replace(bare, stage_cost=ca.SX(1), terminal=[x]),
        x0=np.array([1.0, 0.0]),
        best=2.0,
        how="closed form: one switch",
        goals=((60, 1.99),),
    )


def shipped(name: str) -> tuple[OptimalControlProblem, Array, Known]:
    """Return a shipped problem with its initial state and what is known."""
    given = first_problem(resolve(read_document(name)).posed())
    return given.problem, np.asarray(given.x0, dtype=np.float64), given.known


def two_reaction_reactor() -> Named:
    """The shipped stirred tank with two reactions (M3)."""
    problem, x0, given = shipped("two_reaction_reactor")
    return Named(
        problem=problem,
        x0=x0,
        known=given,
        best=BEST["two_reaction_reactor"],
        held=HELD["two_reaction_reactor"],
        how="linear between 400 knots; Luus and Galli (1991): 0.13309",
        goals=((120, 0.126), (300, 0.130)),
    )


def van_der_pol() -> Named:
    """The shipped van der Pol oscillator (U1)."""
    problem, x0, given = shipped("van_der_pol")
    return Named(
        problem=problem,
        x0=x0,
        known=given,
        best=BEST["van_der_pol"],
        held=HELD["van_der_pol"],
        how="linear between 400 knots; PROPT: 2.86726",
        goals=((60, 2.855), (120, 2.866)),
    )


def pendulum() -> Named:
    """The shipped swing-up (U6), its end conditions as a cost of their errors."""
    problem, x0, given = shipped("pendulum")
    errors = ca.vertcat(*[end.expression for end in problem.terminal_constraints])
    soft = replace(problem, terminal=(), terminal_cost=WEIGHT * ca.sumsqr(errors))
    best = BEST["pendulum"]
    return Named(
        problem=soft,
        x0=x0,
        known=given,
        best=best,
        held=HELD["pendulum"],
        how="linear between 400 knots, the best of many starts",
        goals=((300, 0.9 * best),),
    )


def unicycle() -> Named:
    """A unicycle of speed 1 to (1.5, 1), heading 0, in 2 s, softly."""
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    bare = posed([ca.cos(x[2]), ca.sin(x[2]), u], x, u, horizon=2.0, most=1.5)
    end = (x[0] - GOAL[0]) ** 2 + (x[1] - GOAL[1]) ** 2 + x[2] ** 2
    best = BEST["unicycle"]
    return Named(
        problem=replace(bare, stage_cost=0.1 * u**2, terminal_cost=end),
        x0=np.zeros(3),
        best=best,
        how="linear between 400 knots, the best of many starts",
        goals=((300, 0.9 * best),),
    )


def unicycle_and_disc() -> Named:
    """The same with a disc in the middle of the straight path; the trivial bound is 0.

    A quarter of the best cost is already more than the optimum without the disc: a
    bound that ignores the disc does not reach it.
    """
    free = unicycle()
    problem, (centre, radius) = free.problem, DISC
    apart = disc(problem.model.states[:2], centre=list(centre), radius=radius)
    best = BEST["unicycle_and_disc"]
    return replace(
        free,
        problem=replace(problem, constraints=[apart]),
        best=best,
        goals=((300, 0.25 * best),),
    )


NAMED: dict[str, Callable[[], Named]] = {
    "linear_quadratic": linear_quadratic,
    "minimum_time": minimum_time,
    "two_reaction_reactor": two_reaction_reactor,
    "van_der_pol": van_der_pol,
    "pendulum": pendulum,
    "unicycle": unicycle,
    "unicycle_and_disc": unicycle_and_disc,
}
