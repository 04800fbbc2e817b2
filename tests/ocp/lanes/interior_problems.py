"""Problems for the interior-point lanes, and how they are solved beside IPOPT."""

from typing import NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Free,
    IpoptOptions,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Planner,
    TerminalConstraint,
)
from swarmstart.ocp.lanes.answers import LaneAnswers
from swarmstart.ocp.lanes.interior import Instances, InteriorLanes


class Posed(NamedTuple):
    """A problem with its lanes.

    Attributes:
        planner: Its planner, which polishes by IPOPT.
        lanes: Its lanes.
    """

    planner: Planner
    lanes: InteriorLanes

    def instances(self, x0: Array, known: list[Known] | None = None) -> Instances:
        """Return instances of the core from initial states (nx, M) as stated."""
        M = x0.shape[1]
        columns = [
            self.planner.posed(x0[:, i], Known() if known is None else known[i])[:2]
            for i in range(M)
        ]
        return Instances(
            np.array([np.asarray(state, float) for state, _ in columns]).T,
            np.array([np.ravel(one.parameters) for _, one in columns], float).T,
            np.array([np.ravel(one.signals, "F") for _, one in columns], float).T,
        )

    def decided(self, instances: Instances) -> Array:
        """Return the decisions about the start that the initial states guess."""
        firsts = [one.states[0] for one in self.lanes.problem.free_starts]
        return instances.x0[firsts]

    def solved(self, instances: Instances, controls: Array | None = None,
               states: Array | None = None) -> LaneAnswers:  # fmt: skip
        """Return the answers from controls (nu, N, M), or from none."""
        problem = self.lanes.problem
        if controls is None:
            shape = problem.model.nu, problem.intervals, instances.x0.shape[1]
            controls = np.zeros(shape)
        return self.lanes(instances, controls, self.decided(instances), states)


def posed(problem: OptimalControlProblem, **options: float) -> Posed:
    """Return a problem with its lanes."""
    polish = IpoptOptions(tolerance=1e-10)
    planner = Planner(problem, search=None, polish=polish)
    lanes = InteriorLanes(planner.fitness.shooting, **options)  # type: ignore[arg-type]
    return Posed(planner, lanes)


def every_kind() -> OptimalControlProblem:
    """A small nonlinear problem with bounds and rows of every kind.

    The second state at the start is decided.
    """
    x, u, p = ca.SX.sym("x", 2), ca.SX.sym("u", 2), ca.SX.sym("p")
    rate = ca.vertcat(x[1] + 0.2 * u[1] * x[0], -p * ca.sin(x[0]) + u[0])
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=rate, parameters=p,
              state_names=("a", "b"), control_names=("c", "d")),
        horizon=1.2, intervals=4, substeps=1,
        stage_cost=ca.sumsqr(x - 0.3) + 0.1 * u[0] ** 2 + ca.cos(u[1]) * x[1],
        terminal_cost=2 * x[0] ** 2 * x[1] + ca.sumsqr(x),
        initial_cost=(x[1] - 0.2) ** 2 * (1 + x[0]),
        bounds=Bounds(controls=([-3, -np.inf], [3, 2]),
                      states=([-1.5, -2.0], [np.inf, 2.5])),
        start={"b": Free(-1, 1)},
        constraints=[
            PathConstraint(expression=u[0] * x[1], lower=-2.0, upper=2.0),
            PathConstraint(expression=x[0] + u[1], upper=1.8),
            PathConstraint(expression=x[0] - 0.3 * u[0], lower=-2.0),
            PathConstraint(expression=u[1] - 0.2 * u[0] * x[0], lower=0.1, upper=0.1),
            PathConstraint(expression=ca.sumsqr(x), upper=6.0),
            PathConstraint(expression=x[1], upper=0.4, weight=0.3),
        ],
        terminal=[
            (x[0] + 0.1 * x[1] ** 2, 0.5),
            TerminalConstraint(expression=x[1] * x[0], upper=0.7),
            TerminalConstraint(expression=x[1], lower=-0.9, upper=0.9),
        ],
    )  # fmt: skip
