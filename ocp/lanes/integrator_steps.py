"""The steps of an integrator in scaled numbers, with their derivatives.

An interval leads from (x, u) to F(x, u) by equal steps y+ = f(y, u), each of which
costs l(y, u). Derivatives by (y, u) are carried from the last step to the first one.
With S = d(f, u)/d(y, u) and h = l + p'f, their values after a step (left) give those
before it (right):

    p    costate                                          dh/dy
    g    gradient of the costs of all later steps         dl/d(y, u) + S'g
    W    Jacobian of F                                    W S
    V    second derivatives of these costs + p'F, with    d2h/d(y, u)2 + S'V S
         p the costate after the last step

S has many zeros, which are left out.
"""

from dataclasses import dataclass, replace

import casadi as ca

from swarmstart.ocp.integration.integrators import INTEGRATORS
from swarmstart.ocp.lanes.kernels import lower, symmetric
from swarmstart.ocp.lanes.posed import NoLanesError
from swarmstart.ocp.nlp.nlp_assembly import inputs_of
from swarmstart.ocp.nlp.transcription import NonlinearProgram
from swarmstart.ocp.rollout.shooting import Shooting


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class IntegratorSteps:
    """The steps of an interval; numbers are divided by sizes, the cost by `unit`.

    The arguments are the state y, the controls u, the parameters p, unit, `shared`
    (which contains the sizes, as in the NLP), and the signals a and b at both ends of a
    step. f is the state after a step, l its cost, lam the costate after it, and h = l +
    lam'f.

    Attributes:
        value: (y, u, p, unit, shared, a, b) -> (f, l).
        adjoint: (y, u, lam, p, unit, shared, a, b) -> gradient of h by (y, u).
        before: (y, u, lam, g, W, V, p, ...) after a step -> (lam, g, W, V) before it,
            with g the gradient of the costs of all later steps, W the Jacobian of the
            last state, and V the lower triangle of the second derivatives.
        count: Number of steps between two checks.
    """

    value: ca.Function
    adjoint: ca.Function
    before: ca.Function
    count: int


def integrator_steps(shooting: Shooting, program: NonlinearProgram) -> IntegratorSteps:
    """Return the steps of an interval.

    Raises:
        NoLanesError: If the model is in discrete time, constraints have to hold within
            an interval, or the integrator has no derivatives for lanes.
    """
    problem, part = shooting.problem, program.parts.interval
    inside = [at for at in part.rows.at if at not in (0, problem.checks)]
    reasons = {
        "its model moves in whole intervals only": problem.model.is_discrete,
        "it has constraints within an interval: take checks=1, and distances at points "
        "only": bool(inside),
        f"its integrator is {problem.integrator}": problem.integrator
        not in INTEGRATORS,
    }
    for reason, is_so in reasons.items():
        if is_so:
            raise NoLanesError(reason)
    single = Shooting(
        replace(problem, checks=problem.checks * problem.substeps, substeps=1)
    )
    nx, nu = problem.model.nx, inputs_of(problem)
    y, u, lam = ca.SX.sym("y", nx), ca.SX.sym("u", nu), ca.SX.sym("lam", nx)
    p, unit = ca.SX.sym("p", problem.model.np), ca.SX.sym("unit")
    others = ca.SX.sym("shared", part.values.numel_in(1) - problem.model.np)
    a, b = ca.SX.sym("a", problem.ns), ca.SX.sym("b", problem.ns)
    size_x, size_u = others[:nx], others[nx : nx + nu]
    size_f = others[others.numel() - len(part.rows.places) - 1]
    inputs = (u * size_u)[: problem.model.nu]
    after, spent = single.check_step(y * size_x, inputs, p, (a, b))
    f, l = after / size_x, spent / size_f / unit  # noqa: E741 - as in the head
    z, h = ca.vertcat(y, u), l + ca.dot(lam, f)
    rest = [p, unit, others, a, b]

    def function(name: str, given: list[ca.SX], found: list[ca.SX]) -> ca.Function:
        return ca.Function(name, given, ca.cse([ca.densify(one) for one in found]))

    return IntegratorSteps(
        value=function("step", [y, u, *rest], [f, l]),
        adjoint=function("adjoint", [y, u, lam, *rest], [ca.gradient(h, z)]),
        before=function("before", *_carried((y, u, lam), f, l, rest)),
        count=problem.substeps,
    )


def _carried(
    at: tuple[ca.SX, ca.SX, ca.SX], f: ca.SX, cost: ca.SX, rest: list[ca.SX]
) -> tuple[list[ca.SX], list[ca.SX]]:
    """Return what is carried over a step: arguments, and values before it."""
    y, u, lam = at
    z, h = ca.vertcat(y, u), cost + ca.dot(lam, f)
    nx, nz = y.numel(), z.numel()
    g, W = ca.SX.sym("g", nz), ca.SX.sym("W", nx * nz)
    V = ca.SX.sym("V", nz * (nz + 1) // 2)
    S = ca.jacobian(ca.vertcat(f, u), z)
    bent = ca.hessian(h, z)[0] + S.T @ symmetric(V, nz) @ S
    found = [
        ca.gradient(h, y),
        ca.gradient(cost, z) + S.T @ g,
        ca.vec(ca.reshape(W, nx, nz) @ S),
        lower(bent),
    ]
    return [y, u, lam, g, W, V, *rest], found
