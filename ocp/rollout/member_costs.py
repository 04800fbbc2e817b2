"""Cost of each member of an ensemble for given controls."""

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.integration.integrators import integrate
from swarmstart.ocp.integration.rodas import (
    Rate,
    Symbolic,
    column_at_begin,
    column_at_check,
    follower,
    values_of,
)
from swarmstart.ocp.rollout.shooting import Shooting
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.risk import Risk


def member_costs(
    shooting: Shooting, controls: Array, x0: Array, parameters: Array, signals: Array
) -> Array:
    """Return the members' costs on the problem's grid, shape (M,).

    Without a `risk` the problem has no members, and the array is empty.

    Args:
        shooting: The functions of the ensemble's problem.
        controls: Controls, shape (nu, N).
        x0: Initial state of the problem after all rewrites (core), shape (nx,).
        parameters: Parameters of the core, shape (np,).
        signals: Signals of the core at the nodes, shape (ns, nodes).
    """
    problem, risk = shooting.problem, shooting.problem.risk
    if risk is None:
        return np.empty(0)
    checks = problem.checks
    known = [problem.symbols()[role] for role in ("states", "parameters", "signals")]
    ends = ca.Function("ends", known, [risk.initial, risk.terminal])
    x, costs = x0, np.array(ends(x0, parameters, signals[:, 0])[0]).ravel()
    interval, p = _interval(shooting, risk), parameters
    if problem.is_adaptive:
        # The allowed errors of the steps are relative to these sizes.
        sizes = shooting.sizing(x0, parameters, signals)
        p = np.concatenate([p, sizes.states, np.full(costs.size, sizes.cost)])
    for k in range(problem.intervals):
        nodes = signals[:, k * checks : (k + 1) * checks + 1]
        after, spent = interval(x, controls[:, k], p, nodes)
        x, costs = np.array(after).ravel(), costs + np.array(spent).ravel()
    return costs + np.array(ends(x, parameters, signals[:, -1])[1]).ravel()


def _interval(shooting: Shooting, risk: Risk) -> ca.Function:
    """Return (x, u, p, s at the nodes) -> (x after an interval, the members' costs).

    p holds the parameters and, with step size control, the sizes of states and costs.
    """
    problem, symbols = shooting.problem, [*shooting.problem.symbols().values()]
    stage, step = (ca.Function("c", symbols, [c]) for c in (risk.stage, risk.step))
    if problem.is_adaptive:
        return _adaptive_interval(shooting, stage, step)
    x, u, p = (ca.SX.sym(n, s.numel()) for n, s in zip("xup", symbols, strict=False))
    s = ca.SX.sym("s", problem.ns, problem.checks + 1)
    y = ca.vertcat(x, _at_begin(problem, stage, step, (x, u, p, s[:, 0])))
    for k in range(problem.checks):
        y = integrate(
            problem.integrator, _rate(shooting, stage, (u, p, s[:, k : k + 2])), y,
            start=0.0, duration=problem.dt / problem.checks, steps=problem.substeps,
            after_jump=k == 0,
        )  # fmt: skip
    after, costs = _at_end(shooting, stage, y, (u, p, s[:, -1]))
    return ca.Function("interval", [x, u, p, s], ca.cse([after, costs]))


def _adaptive_interval(
    shooting: Shooting, stage: ca.Function, step: ca.Function
) -> ca.Function:
    """Return the same function with step size control."""
    problem, model = shooting.problem, shooting.problem.model
    x, u = ca.MX.sym("x", model.nx), ca.MX.sym("u", model.nu)
    known = ca.MX.sym("p", model.np + model.nx + stage.numel_out(0))
    s = ca.MX.sym("s", problem.ns, problem.checks + 1)
    p, follow = known[: model.np, 0], _follower(shooting, stage)
    y = ca.vertcat(x, _at_begin(problem, stage, step, (x, u, p, s[:, 0])))
    z = column_at_begin(y, integrals=0, steps=problem.substeps)
    for k in range(problem.checks):
        z = follow(column_at_check(z) if k else z, u, known, s[:, k : k + 2])
    after, costs = _at_end(shooting, stage, values_of(z), (u, p, s[:, -1]))
    return ca.Function("interval", [x, u, known, s], [after, costs])


def _at_begin(
    problem: OptimalControlProblem,
    stage: ca.Function,
    step: ca.Function,
    at: tuple[Symbolic, Symbolic, Symbolic, Symbolic],
) -> Symbolic:
    """Return the members' costs at the start of an interval, at (x, u, p, s)."""
    costs = step(*at)
    if problem.quadrature == "left":
        costs += problem.dt * stage(*at)
    return costs


def _at_end(
    shooting: Shooting,
    stage: ca.Function,
    y: Symbolic,
    at: tuple[Symbolic, Symbolic, Symbolic],
) -> tuple[Symbolic, Symbolic]:
    """Return state and costs after the end of an interval, at (u, p, s)."""
    problem, (u, p, s) = shooting.problem, at
    nx = problem.model.nx
    after, costs = y[:nx], y[nx:]
    # Before the cost, which is that of the state after the jump.
    if problem.model.jumps:
        after = shooting.jump(after, u, p, s[: problem.model.ns])
    if problem.quadrature == "right":
        costs += problem.dt * stage(after, u, p, s)
    return after, costs


def _follower(shooting: Shooting, stage: ca.Function) -> ca.Function:
    """Return (z, u, (p, sizes), s at both ends) -> z after a check; see rodas.py."""
    problem = shooting.problem
    model, size = problem.model, problem.model.nx + stage.numel_out(0)
    u, known = ca.SX.sym("u", model.nu), ca.SX.sym("p", model.np + size)
    s = ca.SX.sym("s", problem.ns, 2)
    return follower(
        _rate(shooting, stage, (u, known[: model.np, 0], s)),
        [u, known, s],
        known[model.np :, 0],
        duration=problem.dt / problem.checks,
        tolerance=problem.integrator_tolerance or 0.0,
    )


def _rate(
    shooting: Shooting, stage: ca.Function, known: tuple[ca.SX, ca.SX, ca.SX]
) -> Rate:
    """Return the rate of states and costs, from u, p, and s at both ends of a check."""
    problem, (u, p, s) = shooting.problem, known
    model, duration = problem.model, problem.dt / problem.checks
    ends = s[:, 0], s[:, 1]

    def rate(t: float, y: ca.SX) -> ca.SX:
        at, state = shooting.signals_at(ends, t / duration), y[: model.nx]
        spent = stage(state, u, p, at)
        if problem.quadrature != "integral":
            # Such costs are added at an interval's ends.
            spent = ca.SX.zeros(spent.numel())
        return ca.vertcat(shooting.dynamics(state, u, p, at[: model.ns]), spent)

    return rate
