"""A tree of scenarios of the stirred tank, stated with what every model may have.

Each of nine tanks has controls of its own, but in the first interval all have those of
the first tank, as they cannot be told apart before it ends. A state `apart` says so: it
is 0 at the start, and the end of each interval sets it to 1.

    applied_m = u_m if apart else u_0,   a_m = applied_m of the interval before

Source: Lucia, Finkler and Engell (2013), Multi-stage nonlinear model predictive control
applied to a semi-batch polymerization reactor under uncertainty.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.benchmarks.tank import (
    BEFORE,
    CONTROL_LIMITS,
    CONTROLS,
    HOUR,
    INTERVAL,
    INTERVALS,
    PLANTS,
    STATE_LIMITS,
    STATES,
    UNITS,
    WANTED,
    WEIGHTS,
    rates,
)
from swarmstart.ocp import (
    Bounds,
    Decision,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    Planner,
)
from swarmstart.ocp.guess import shifted_controls

Array = NDArray[np.float64]
M = len(PLANTS)
_TIE = 1e-4
"""Weight on the controls that have no effect, those of the first interval but u_0."""


_MARGIN = 0.01
"""Of T_R [deg C], as it may be higher between two checks."""


def tree() -> OptimalControlProblem:
    """Return the problem: states (x_0 ... x_8, apart, a_0 ... a_8), controls (u_m).

    T_R is bounded in the middle of each interval, too, and a little lower.
    """
    x, u, a = (
        [[ca.SX.sym(f"{name}_{m}{mark}") for name in names] for m in range(M)]
        for names, mark in ((STATES, ""), (CONTROLS, ""), (CONTROLS, "_before"))
    )
    apart = ca.SX.sym("apart")
    applied = [
        [
            (1 - apart) * first + apart * own
            for first, own in zip(u[0], one, strict=True)
        ]
        for one in u
    ]
    ode = [ca.vertcat(*rates(*one)) for one in zip(x, applied, PLANTS, strict=True)]
    columns = [ca.vertcat(*[ca.vertcat(*c) for c in role]) for role in (x, applied, a)]
    off = ca.sumsqr(ca.vertcat(*[one[1] for one in x]) - WANTED) / M
    unit, weight = (ca.DM(np.tile(v, M)) for v in (UNITS, WEIGHTS))
    controls = ca.vertcat(*[ca.vertcat(*one) for one in u])
    idle = (controls - ca.repmat(ca.vertcat(*u[0]), M, 1)) / unit
    moves = (columns[1] - columns[2]) / unit
    model = Model(
        states=ca.vertcat(columns[0], apart, columns[2]),
        controls=controls,
        ode=ca.vertcat(*ode, ca.SX.zeros(1 + columns[2].numel())) / HOUR,
        next_state=ca.vertcat(columns[0], 1, columns[1]),
    )
    free = [np.inf] * (model.nx - len(STATES) * M)
    lower, upper = (np.tile(limit, M) for limit in STATE_LIMITS)
    upper[STATES.index("T_R") :: len(STATES)] -= _MARGIN
    return OptimalControlProblem(
        model,
        horizon=INTERVALS * INTERVAL * HOUR,
        intervals=INTERVALS,
        step_cost=off
        + ca.dot(weight, moves**2) / M
        + _TIE * (1 - apart) * ca.sumsqr(idle),
        terminal_cost=off,
        bounds=Bounds(
            controls=(np.tile(CONTROL_LIMITS[0], M), np.tile(CONTROL_LIMITS[1], M)),
            states=(np.append(lower, np.negative(free)), np.append(upper, free)),
        ),
        substeps=1,
        checks=2,
    )


@dataclass(frozen=True, slots=True, eq=False)
class TreeController:
    """Plans the tree at each control instant; applies what all scenarios share.

    Attributes:
        planner: Of the tree.
        dt: Length of a control interval [s].
    """

    planner: Planner
    dt: float = INTERVAL * HOUR

    def decide(
        self,
        time: float,
        state: Array,
        previous: Decision | None,
        *,
        rng: np.random.Generator,
    ) -> Decision:
        """Return the control of the first interval; see Controller."""
        del time
        guess, before = None, BEFORE
        if previous is not None:
            last, before = previous.plans[0].controls, previous.control
            guess = shifted_controls(self.planner.problem, last, "last")
            together = guess[:, 0].reshape(M, -1).mean(axis=0)
            guess[:, 0] = np.tile(together, M)
        start = np.concatenate([np.tile(state, M), [0.0], np.tile(before, M)])
        plan = self.planner.plan(start, guess=guess, near=guess is not None, rng=rng)
        return Decision(control=plan.controls[: BEFORE.size, 0], plans=(plan,))


def branching() -> TreeController:
    """Return the controller, with IPOPT alone."""
    return TreeController(Planner(tree(), search=None, polish=IpoptOptions()))
