"""Single shooting: controls -> trajectory, cost and violation.

One stage function covers one control interval; the rollout applies it N times from
the initial state. Arguments, in this order, of everything made here:

    controls    ca.vec of (nu, N): interval after interval, shape (nu * N,)
    x0          initial state, shape (nx,)
    parameters  shape (np,)
    signals     ca.vec of (ns, nodes): node after node, shape (ns * nodes,)
"""

import casadi as ca

from swarmstart.ocp.integrators import integrate
from swarmstart.ocp.model import right_hand_side
from swarmstart.ocp.problem import OptimalControlProblem

ARGUMENTS = ("controls", "x0", "parameters", "signals")


def stage(problem: OptimalControlProblem) -> ca.Function:
    """Return the function of one control interval.

    Args:
        problem: The problem.

    Returns:
        (x, u, p, S) -> (states, cost, violation), with the signals S at the nodes of
        the interval, shape (ns, checks + 1), and the states after each check, shape
        (nx, checks).
    """
    model = problem.model
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    p, signals = (
        ca.SX.sym("p", model.np),
        ca.SX.sym("s", problem.ns, problem.checks + 1),
    )
    names = problem.symbols().values()
    stage_cost = ca.Function("stage_cost", [*names], [problem.stage_cost])
    watched = [
        ca.Function("watched", [*names], [c.expression])
        for c in problem.path_constraints
    ]

    cost = ca.SX(0)
    if problem.quadrature == "left":
        cost = problem.dt * stage_cost(x, u, p, signals[:, 0])
    violation, state, states = ca.SX(0), x, []
    for k in range(problem.checks):
        s0, s1 = signals[:, k], signals[:, k + 1]
        after, spent = _check(problem, state, u, p, (s0, s1))
        for constraint, value in zip(problem.path_constraints, watched, strict=True):
            violation += constraint.excess(
                value(state, u, p, s0), value(after, u, p, s1)
            )
        cost, state = cost + spent, after
        states.append(after)
    if problem.quadrature == "right":
        cost = problem.dt * stage_cost(state, u, p, signals[:, -1])
    return ca.Function(
        "stage",
        [x, u, p, signals],
        ca.cse([ca.horzcat(*states), cost, violation]),
        ["x", "u", "p", "signals"],
        ["states", "cost", "violation"],
    )


def stage_without_path(problem: OptimalControlProblem) -> ca.Function:
    """Return the stage as a rollout needs it: only the last of its states.

    Args:
        problem: The problem.

    Returns:
        (x, u, p, S) -> (x after the interval, cost, violation); see `stage`.
    """
    whole = stage(problem)
    arguments = [
        ca.SX.sym(whole.name_in(i), *whole.size_in(i)) for i in range(whole.n_in())
    ]
    states, cost, violation = whole(*arguments)
    return ca.Function(
        "stage_without_path", arguments, ca.cse([states[:, -1], cost, violation])
    )


def _check(
    problem: OptimalControlProblem,
    x: ca.SX,
    u: ca.SX,
    p: ca.SX,
    ends: tuple[ca.SX, ca.SX],
) -> tuple[ca.SX, ca.SX]:
    """Return the state after one check, and the integral of the stage cost over it."""
    f = right_hand_side(problem.model)
    duration = problem.dt / problem.checks
    if problem.quadrature != "integral":
        held = integrate(
            problem.integrator,
            lambda _, y: f(y, u, p),
            x,
            start=0.0,
            duration=duration,
            steps=problem.substeps,
        )
        return held, ca.SX(0)
    names = problem.symbols().values()
    stage_cost = ca.Function("stage_cost", [*names], [problem.stage_cost])
    start, end = ends

    def rate(t: float, y: ca.SX) -> ca.SX:
        s = start + t / duration * (end - start)
        return ca.vertcat(f(y[:-1], u, p), stage_cost(y[:-1], u, p, s))

    both = integrate(
        problem.integrator,
        rate,
        ca.vertcat(x, 0),
        start=0.0,
        duration=duration,
        steps=problem.substeps,
    )
    return both[:-1], both[-1]


def terminal(problem: OptimalControlProblem) -> ca.Function:
    """Return (x, p, s) -> (cost, violation) at the end of the horizon."""
    symbols = problem.symbols()
    at_end = [symbols["states"], symbols["parameters"], symbols["signals"]]
    violation = ca.SX(0)
    for constraint in problem.terminal_constraints:
        violation += constraint.excess(constraint.expression)
    return ca.Function(
        "terminal",
        at_end,
        [problem.terminal_cost, violation],
        ["x", "p", "s"],
        ["cost", "violation"],
    )


def rollout(problem: OptimalControlProblem) -> ca.Function:
    """Return (controls, x0, parameters, signals) -> (cost, violation)."""
    arguments, (_, cost, violation) = _rolled(problem)
    return ca.Function(
        "rollout",
        arguments,
        ca.cse([cost, violation]),
        list(ARGUMENTS),
        ["cost", "violation"],
    )


def trajectory(problem: OptimalControlProblem) -> ca.Function:
    """Return (controls, x0, parameters, signals) -> states at the nodes (nx, nodes)."""
    arguments, (states, _, _) = _rolled(problem)
    return ca.Function(
        "trajectory", arguments, ca.cse([states]), list(ARGUMENTS), ["states"]
    )


def _rolled(
    problem: OptimalControlProblem,
) -> tuple[list[ca.SX], tuple[ca.SX, ca.SX, ca.SX]]:
    """Return the arguments, and states, cost and violation as expressions of them."""
    model, checks = problem.model, problem.checks
    controls = ca.SX.sym("controls", model.nu * problem.intervals)
    x0, p = ca.SX.sym("x0", model.nx), ca.SX.sym("p", model.np)
    flat_signals = ca.SX.sym("signals", problem.ns * problem.nodes)
    u = ca.reshape(controls, model.nu, problem.intervals)
    signals = ca.reshape(flat_signals, problem.ns, problem.nodes)

    interval = stage(problem)
    x, cost, violation, states = x0, ca.SX(0), ca.SX(0), [x0]
    for k in range(problem.intervals):
        known = signals[:, k * checks : (k + 1) * checks + 1]
        after, spent, broken = interval(x, u[:, k], p, known)
        x, cost, violation = after[:, -1], cost + spent, violation + broken
        states.append(after)
    end_cost, end_violation = terminal(problem)(x, p, signals[:, -1])
    return [controls, x0, p, flat_signals], (
        ca.horzcat(*states),
        cost + end_cost,
        violation + end_violation,
    )
