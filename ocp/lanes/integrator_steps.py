"""The steps of an integrator in scaled numbers, with their derivatives.

An interval leads from (x, u) to F(x, u) by equal steps y+ = f(y, u), each of which
costs l(y, u). With the costate p behind a step, and all derivatives by (y, u),

    h = l + p'f,   p before = dh/dy,   dF/dz by the chain of the f
    second derivatives of sum(l) + p'F:   sum over the steps of Z' (d2h) Z

where Z is the derivative of (y, u) by z = (x, u).
"""

from dataclasses import dataclass, replace

import casadi as ca

from swarmstart.ocp.integration.integrators import INTEGRATORS
from swarmstart.ocp.lanes.kernels import lower
from swarmstart.ocp.lanes.posed import NoLanesError
from swarmstart.ocp.nlp.nlp_assembly import inputs_of
from swarmstart.ocp.nlp.transcription import NonlinearProgram
from swarmstart.ocp.rollout.shooting import Shooting


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class IntegratorSteps:
    """The steps of an interval; numbers are divided by sizes, the cost by `unit`.

    The arguments are y, u, p (parameters), unit, and the signals at both ends of a
    step; s of `shared` are the sizes, as in the NLP.

    Attributes:
        value: (y, u, p, unit, shared, a, b) -> (f, l).
        adjoint: The same with the costate after u -> gradient of h by (y, u).
        slopes: As `value` -> (f, Jacobian of f, gradient of l, l).
        bend: As `adjoint` -> lower triangle of the second derivatives of h.
        count: Number of steps between two checks.
    """

    value: ca.Function
    adjoint: ca.Function
    slopes: ca.Function
    bend: ca.Function
    count: int


def integrator_steps(shooting: Shooting, program: NonlinearProgram) -> IntegratorSteps:
    """Return the steps of an interval.

    Raises:
        NoLanesError: If an interval does more than equal steps.
    """
    problem, part = shooting.problem, program.parts.interval
    inside = [at for at in part.rows.at if at not in (0, problem.checks)]
    reasons = {
        "its model moves in whole intervals only": problem.model.is_discrete,
        "it has constraints within an interval: take checks=1": bool(inside),
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

    plain, pulled = [y, u, *rest], [y, u, lam, *rest]
    return IntegratorSteps(
        value=function("step", plain, [f, l]),
        adjoint=function("adjoint", pulled, [ca.gradient(h, z)]),
        slopes=function(
            "slopes", plain, [f, ca.vec(ca.jacobian(f, z)), ca.gradient(l, z), l]
        ),
        bend=function("bend", pulled, [lower(ca.hessian(h, z)[0])]),
        count=problem.substeps,
    )
