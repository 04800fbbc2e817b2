"""A problem whose optimum over measurable controls is known, and how it is stated."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Free,
    Known,
    Model,
    OptimalControlProblem,
    TerminalConstraint,
)
from swarmstart.ocp.common.limits import Limit
from swarmstart.ocp.rollout.fitness import NOTHING
from swarmstart.ocp.system.constraints import Constraint

Limits = tuple[Limit, Limit]
INTERVALS = 100


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class KnownOptimum:
    """A problem with at most three states, and what is known of it.

    Attributes:
        name: Unique.
        problem: The problem.
        x0: Initial state, shape (nx,).
        optimum: The least cost over all measurable controls, or the largest worth, as
            the problem states it.
        source: How it is known.
        known: Parameters and signals, where the problem has any.
        within: How far from it `solve` may end on the problem's grid, in parts of it
            (of 1, if it is zero).
    """

    name: str
    problem: OptimalControlProblem
    x0: Array
    optimum: float
    source: str
    known: Known = NOTHING
    within: float = 0.01

    @property
    def size(self) -> float:
        """Scale of a difference of costs."""
        return abs(self.optimum) or 1.0

    def excess(self, bound: float) -> float:
        """Return by how much a bound exceeds the optimum, in parts of its size.

        Of a maximised cost: by how much the optimum exceeds the bound.
        """
        return self.problem.sense * (bound - self.optimum) / self.size


class Symbols:
    """Symbols of states, controls and time."""

    def __init__(self, states: int, controls: int = 1) -> None:
        """Make them."""
        self.x, self.u = ca.SX.sym("x", states), ca.SX.sym("u", controls)
        self.t = ca.SX.sym("t")


def stated(  # noqa: PLR0913 - a problem's parts
    symbols: Symbols,
    ode: ca.SX | list[ca.SX],
    *,
    horizon: float | Free,
    controls: Limits,
    stage: ca.SX | float = 0.0,
    end: ca.SX | float = 0.0,
    states: Limits | None = None,
    path: Sequence[Constraint | ca.SX] = (),
    terminal: Sequence[ca.SX | TerminalConstraint] = (),
    maximize: bool = False,
    intervals: int = INTERVALS,
) -> OptimalControlProblem:
    """Return a problem in the symbols.

    Args:
        symbols: Of states, controls and time.
        ode: Right-hand side, shape (nx, 1).
        horizon: [s].
        controls: Bounds of the controls.
        stage: Stage cost.
        end: Terminal cost.
        states: Bounds of the states; None: unbounded.
        path: Path constraints.
        terminal: Terminal constraints.
        maximize: Whether the cost is maximised.
        intervals: Number of them.
    """
    rates = ca.vertcat(*ode) if isinstance(ode, list) else ode
    model = Model(states=symbols.x, controls=symbols.u, ode=rates, time=symbols.t)
    return OptimalControlProblem(
        model,
        horizon=horizon,
        intervals=intervals,
        stage_cost=ca.SX(stage),
        terminal_cost=ca.SX(end),
        bounds=Bounds(controls=controls, states=states),
        constraints=path,
        terminal=terminal,
        maximize=maximize,
        substeps=2,
    )


def known(
    name: str,
    problem: OptimalControlProblem,
    x0: ArrayLike,
    optimum: float,
    source: str,
    *,
    within: float = 0.01,
) -> KnownOptimum:
    """Return a problem with its optimum."""
    return KnownOptimum(
        name=name,
        problem=problem,
        x0=np.atleast_1d(np.asarray(x0, dtype=np.float64)),
        optimum=float(optimum),
        source=source,
        within=within,
    )


Family = Callable[[], list[KnownOptimum]]
