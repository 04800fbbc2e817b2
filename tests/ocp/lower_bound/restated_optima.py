"""Known optima stated once more: in other units, turned round, with data, or on grids.

x~ = sx x,  u~ = su u,  t~ = st t,  J~ = sj J
"""

from dataclasses import replace
from typing import NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Free,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
)
from swarmstart.ocp.system.constraints import Constraint, TerminalConstraint
from swarmstart.tests.ocp.lower_bound import (
    constrained_optima,
    inverse_optima,
    linear_optima,
    scalar_optima,
    time_optima,
)
from swarmstart.tests.ocp.lower_bound.known_optimum import (
    KnownOptimum,
    Symbols,
    known,
    stated,
)


class Units(NamedTuple):
    """By what states, controls, times and costs are multiplied."""

    states: float = 1.0
    controls: float = 1.0
    time: float = 1.0
    cost: float = 1.0


def in_units(given: KnownOptimum, units: Units, suffix: str) -> KnownOptimum:
    """Return the same problem stated in other units."""
    sx, su, st, sj = units
    problem, model = given.problem, given.problem.model

    def told(expression: ca.SX) -> ca.SX:
        symbols = ca.vertcat(model.states, model.controls, model.time)
        own = ca.vertcat(model.states / sx, model.controls / su, model.time / st)
        return ca.substitute(expression, symbols, own)

    def limit(constraint: Constraint) -> Constraint:
        if not isinstance(constraint, PathConstraint):
            raise TypeError(f"expected a PathConstraint, got {constraint!r}")
        return replace(constraint, expression=told(constraint.expression))

    def target(end: object) -> TerminalConstraint:
        if not isinstance(end, TerminalConstraint):
            raise TypeError(f"expected a TerminalConstraint, got {end!r}")
        return replace(end, expression=told(end.expression))

    stated_so = replace(
        problem,
        model=Model(
            states=model.states,
            controls=model.controls,
            time=model.time,
            ode=sx / st * told(model.ode),
        ),
        horizon=_times(problem.horizon, st),
        stage_cost=sj / st * told(problem.stage_cost),
        terminal_cost=sj * told(problem.terminal_cost),
        bounds=Bounds(
            controls=_widened(problem.control_limits, su),
            states=_widened(problem.state_limits, sx),
        ),
        constraints=[limit(c) for c in problem.constraints],  # type: ignore[arg-type]
        terminal=[target(end) for end in problem.terminal],
    )
    return replace(
        given,
        name=f"{given.name}, {suffix}",
        problem=stated_so,
        x0=sx * given.x0,
        optimum=sj * given.optimum,
    )


def _widened(limits: tuple[Array, Array], scale: float) -> tuple[Array, Array]:
    return scale * limits[0], scale * limits[1]


def _times(horizon: float | Free, scale: float) -> float | Free:
    if not isinstance(horizon, Free):
        return scale * horizon
    guess = horizon.guess
    return Free(
        scale * horizon.lower,
        scale * horizon.upper,
        None if guess is None else scale * guess,
    )


def turned(given: KnownOptimum) -> KnownOptimum:
    """Return the same problem with its cost as a worth, or the other way round."""
    problem = given.problem
    return replace(
        given,
        name=f"{given.name}, turned round",
        problem=replace(
            problem,
            stage_cost=-problem.stage_cost,
            terminal_cost=-problem.terminal_cost,
            maximize=not problem.maximize,
        ),
        optimum=-given.optimum,
    )


def on_grid(given: KnownOptimum, suffix: str, **grid: object) -> KnownOptimum:
    """Return the same problem on another grid of controls: the same optimum."""
    problem: OptimalControlProblem = replace(given.problem, **grid)  # type: ignore[arg-type]
    return replace(
        given, name=f"{given.name}, {suffix}", problem=problem, within=np.inf
    )


def with_parameters() -> KnownOptimum:
    """The soft end of the double integrator with its weight as a parameter."""
    s, weight = Symbols(2), ca.SX.sym("weight")
    problem = OptimalControlProblem(
        Model(states=s.x, controls=s.u, ode=ca.vertcat(s.x[1], s.u), parameters=weight),
        horizon=1.0,
        intervals=100,
        stage_cost=s.u**2,
        terminal_cost=weight * ca.sumsqr(s.x),
        bounds=Bounds(controls=(-20, 20)),
    )
    given = known("a parameter", problem, [1.0, 0.0], 1.1 / 0.680 * 3, "Gramian")
    return replace(given, known=Known(parameters=[10.0]))


def with_initial_cost() -> KnownOptimum:
    """The regulator with a cost at the start, which no decision changes."""
    given = scalar_optima.regulator()
    x = given.problem.model.states
    return replace(
        given,
        name="a cost at the start",
        problem=replace(given.problem, initial_cost=5 + x**2),
        optimum=given.optimum + 6,
    )


def late() -> KnownOptimum:
    """A rate of time whose horizon begins at 1 s instead of 0."""
    s, T, begin = Symbols(1), 2.0, 1.0
    problem = stated(
        s, s.u + ca.sin(s.t), horizon=T, controls=(-2, 2), stage=s.u**2,
        end=5 * (s.x - 2) ** 2,
    )  # fmt: skip
    far = 2 - (np.cos(begin) - np.cos(begin + T))
    optimum = 5 * far**2 / (1 + 5 * T)
    given = known("a late start", problem, 0.0, optimum, "u is constant")
    return replace(given, known=Known(time=begin))


def whole() -> KnownOptimum:
    """The decay with a control that takes whole numbers."""
    given = scalar_optima.decay()
    bounds = Bounds(controls=(0, 1), integer=["u"])
    return on_grid(given, "in whole numbers", bounds=bounds)


def family() -> list[KnownOptimum]:
    """Return known problems once more."""
    ball = constrained_optima.ball(1 / 9)
    soft = linear_optima.transfers()[0]
    rest = time_optima.to_rest(1.0, 0.0, name="to rest in the least time")
    pendulum = inverse_optima.family()[0]
    return [
        in_units(scalar_optima.regulator(), Units(states=1e3), "states times 1e3"),
        in_units(scalar_optima.dottie(), Units(cost=1e-6), "cost times 1e-6"),
        in_units(soft, Units(1e-3, 1e2, 1 / 3600, 1e6), "in hours"),
        in_units(rest, Units(1e3, 1e-2, 60.0, 60.0), "in other units"),
        in_units(ball, Units(1e3, 1e3, 1.0, 1e-6), "in millimetres"),
        in_units(pendulum, Units(57.3, 0.1, 1e-3, 1e3), "in other units"),
        turned(scalar_optima.regulator()),
        turned(soft),
        turned(rest),
        turned(scalar_optima.catch()),
        turned(pendulum),
        on_grid(scalar_optima.regulator(), "held", intervals=3),
        on_grid(soft, "linear controls", intervals=5, control_shape="linear"),
        with_parameters(),
        with_initial_cost(),
        late(),
        whole(),
    ]
