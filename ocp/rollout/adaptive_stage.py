"""A control interval integrated with step size control.

    begin   z from the state at the start: state, integrals and step size as one column
    ticks   z -> z by trial steps, from one check to the next, for each check
    close   cost and violation of the interval, from the states at its checks

integration/rodas.py explains z and a trial step (tick). The arguments are those of an
interval (shooting.py): state x, controls u, parameters p, signals S at the interval's
nodes. The last entries of p are the natural sizes of the integrated quantities.
"""

from collections.abc import Callable

import casadi as ca

from swarmstart.ocp.integration.rodas import (
    Rate,
    column_at_begin,
    column_at_check,
    followed,
    ticked,
    values_of,
)
from swarmstart.ocp.statement.decisions import whole_symbols
from swarmstart.ocp.statement.problem import OptimalControlProblem

Rates = Callable[[ca.SX, ca.SX, tuple[ca.SX, ca.SX]], Rate]
"""(u, p, signals at both ends of a check) -> rate of the integrated quantities."""


def tick_of(
    problem: OptimalControlProblem, rates: Rates, *, tolerance: float
) -> ca.Function:
    """Return the function (z, u, p, s) -> z after one trial step.

    z has, as one column, the states and integrals, their largest absolute values so
    far, the time left until the next check, and the step size. s are the signals at the
    two checks between which the step lies.

    Args:
        problem: The problem.
        rates: The rates of the problem.
        tolerance: Allowed relative error of a step.
    """
    model, size = problem.model, problem.model.nx + problem.integrals
    z, given = ca.SX.sym("z", 2 * size + 2), ca.SX.sym("u", model.nu)
    p = ca.SX.sym("p", model.np + problem.automatic)
    s = ca.SX.sym("s", problem.ns, 2)
    u = whole_symbols(given, problem.integer, problem.control_limits)
    after = ticked(
        rates(u, p[: model.np, 0], (s[:, 0], s[:, 1])),
        z,
        p[p.numel() - size :, 0],
        duration=problem.dt / problem.checks,
        tolerance=tolerance,
    )
    return ca.Function("tick", [z, given, p, s], ca.cse([after]))


def adaptive_stage(
    problem: OptimalControlProblem, tick: ca.Function, close: ca.Function
) -> ca.Function:
    """Return the function of one control interval, which calls the trial step.

    It is (x, u, p, S) -> (states at the checks, cost, violation), with S the signals at
    the interval's nodes.

    Args:
        problem: The problem.
        tick: The trial step, as `tick_of` returns it.
        close: Function (x, u, p, S, states at the checks, integrals) -> the outputs of
            the result.
    """
    names = ["x", "u", "p", "signals"]
    x, u, p, s = (ca.MX.sym(name, *close.size_in(i)) for i, name in enumerate(names))
    follow, nx = followed(tick), problem.model.nx
    z = column_at_begin(x, integrals=problem.integrals, steps=problem.substeps)
    reached = []
    for k in range(problem.checks):
        z = column_at_check(z) if k else z  # The first one begins at a check already.
        z = follow(z, u, p, s[:, k : k + 2])
        reached.append(z[:nx])
    integrals = values_of(z)[nx:]
    outputs = close(x, u, p, s, ca.horzcat(*reached), integrals)
    return ca.Function(
        "stage", [x, u, p, s], list(outputs), names, ["states", "cost", "violation"]
    )
