"""A stated problem whose controls are linear between knots, written by hand.

Each control is a state `now` with a rate, and a state `knot` that the end of an
interval sets: what the library does with control_shape, for a peer that knows none.
"""

from dataclasses import replace

import casadi as ca
import numpy as np

from swarmstart.tests.ocp.feature_pairs.stated import Limited, Stated, nothing


def with_lines(s: Stated) -> Stated:
    """Return a problem of a fixed end time with states for its linear controls."""
    nx, nu = s.states.numel(), s.controls.numel()
    now, knot = (
        ca.vertcat(*[ca.SX.sym(f"{name} {i}") for i in range(nu)])
        for name in ("now", "knot")
    )

    def step(expression: ca.SX) -> ca.SX:
        if not s.before.numel():
            return expression
        return ca.substitute(expression, s.before, knot)

    def along(expression: ca.SX) -> ca.SX:
        return step(ca.substitute(expression, s.controls, now))

    path = [replace(c, expression=along(c.expression)) for c in s.path]
    if s.ceiling is not None:
        path.append(Limited(now[0] - s.ceiling, -np.inf, 0.0, moves=True))
    after = along(s.next_state) if s.next_state.numel() else s.states
    rates = (s.controls - knot) / (s.horizon / s.intervals)
    solved = s.solved
    if solved is not None:
        solved = solved[0], along(solved[1]), along(solved[2])
    first = {
        (nx + j, nx + nu + j): (float(s.limits[0][j]), float(s.limits[1][j]))
        for j in range(nu)
    }
    return replace(
        s,
        states=ca.vertcat(s.states, now, knot),
        ode=ca.vertcat(along(s.ode), rates, ca.SX.zeros(nu)),
        next_state=ca.vertcat(after, now, s.controls),
        stage=along(s.stage),
        step=step(s.step),
        path=path,
        ceiling=None,
        before=nothing(),
        previous=np.empty(0),
        start=s.start | first,
        x0=np.append(s.x0, np.zeros(2 * nu)),
        solved=solved,
    )
