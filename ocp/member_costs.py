"""The cost of each member of an ensemble along given controls."""

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.integrators import integrate
from swarmstart.ocp.shooting import Shooting

Array = NDArray[np.float64]


def member_costs(
    shooting: Shooting, controls: Array, x0: Array, parameters: Array, signals: Array
) -> Array:
    """Return the members' costs on the problem's grid, shape (M,); empty without any.

    Args:
        shooting: The functions of the ensemble's problem.
        controls: Shape (nu, N).
        x0: Initial state of the core, shape (nx,).
        parameters: Those of the core, shape (np,).
        signals: Those of the core at the nodes, shape (ns, nodes).
    """
    problem, risk = shooting.problem, shooting.problem.risk
    if risk is None:
        return np.empty(0)
    interval, checks = _interval(shooting), problem.checks
    known = [problem.symbols()[role] for role in ("states", "parameters", "signals")]
    ends = ca.Function("ends", known, [risk.initial, risk.terminal])
    x, costs = x0, np.array(ends(x0, parameters, signals[:, 0])[0]).ravel()
    for k in range(problem.intervals):
        nodes = signals[:, k * checks : (k + 1) * checks + 1]
        after, spent = interval(x, controls[:, k], parameters, nodes)
        x, costs = np.array(after).ravel(), costs + np.array(spent).ravel()
    return costs + np.array(ends(x, parameters, signals[:, -1])[1]).ravel()


def _interval(shooting: Shooting) -> ca.Function:
    """Return (x, u, p, s at the nodes) -> (x after an interval, the members' costs)."""
    problem = shooting.problem
    model, risk, duration = problem.model, problem.risk, problem.dt / problem.checks
    symbols = [*problem.symbols().values()]
    x, u, p = (ca.SX.sym(n, s.numel()) for n, s in zip("xup", symbols, strict=False))
    s = ca.SX.sym("s", problem.ns, problem.checks + 1)
    both = [] if risk is None else [risk.stage, risk.step]
    stage, step = (ca.Function("cost", symbols, [cost]) for cost in both)
    costs = step(x, u, p, s[:, 0])
    if problem.quadrature == "left":
        costs += problem.dt * stage(x, u, p, s[:, 0])
    y = ca.vertcat(x, costs)
    for k in range(problem.checks):
        start, end = s[:, k], s[:, k + 1]

        def rate(t: float, y: ca.SX, a: ca.SX = start, b: ca.SX = end) -> ca.SX:
            at, state = a + t / duration * (b - a), y[: model.nx]
            spent = stage(state, u, p, at)
            if problem.quadrature != "integral":
                spent = ca.SX.zeros(spent.numel())
            return ca.vertcat(shooting.dynamics(state, u, p, at[: model.ns]), spent)

        y = integrate(
            problem.integrator, rate, y, start=0.0, duration=duration,
            steps=problem.substeps, after_jump=k == 0,
        )  # fmt: skip
    after, costs = y[: model.nx], y[model.nx :]
    if model.jumps:
        after = shooting.jump(after, u, p, s[: model.ns, -1])
    if problem.quadrature == "right":
        costs += problem.dt * stage(after, u, p, s[:, -1])
    return ca.Function("interval", [x, u, p, s], ca.cse([after, costs]))
