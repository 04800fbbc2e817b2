"""Free end time T: a decided parameter; rates and stage cost are multiplied by T.

The horizon is 1 then. Source: the time transformation t = T tau of any text on direct
methods, such as Betts (2010), Practical Methods for Optimal Control, 4.
"""

from dataclasses import dataclass, replace

import casadi as ca

from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import symbol_names
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.changed import with_equations
from swarmstart.ocp.statement.rewrites.rewrite import Rewrite

END_TIME = "end time"
"""Name of the parameter, and then of the state, that is a free end time."""


def with_length(
    problem: OptimalControlProblem,
) -> tuple[OptimalControlProblem, ca.SX]:
    """Return a problem and the length of its horizon [s], a parameter if it is free.

    Args:
        problem: The problem; the horizon is left as it is.
    """
    if not isinstance(problem.horizon, Free):
        return problem, ca.SX(problem.length)
    parameters = problem.model.parameters
    if END_TIME in problem.decided:
        return problem, parameters[symbol_names(parameters).index(END_TIME)]
    T = ca.SX.sym(END_TIME)
    model = with_equations(problem.model, parameters=ca.vertcat(T, parameters))
    decided = {END_TIME: problem.horizon, **problem.decided}
    return replace(problem, model=model, decided=decided), T


@dataclass(frozen=True, slots=True)
class EndTime(Rewrite):
    """A free end time -> a horizon of length 1 and a decided parameter."""

    role = END_TIME

    def accepts(self, problem: OptimalControlProblem) -> bool:
        """Return whether the end time is decided."""
        return isinstance(problem.horizon, Free)

    def apply(self, problem: OptimalControlProblem) -> OptimalControlProblem:
        """Return the problem over a horizon of length 1.

        Raises:
            InvalidProblemError: If the model is in discrete time.
        """
        if problem.model.is_discrete:
            raise InvalidProblemError(
                "a discrete-time model has no end time to decide: its horizon must be "
                "a number"
            )
        problem, T = with_length(problem)
        risk = problem.risk
        return replace(
            problem,
            model=with_equations(problem.model, ode=T * problem.model.ode),
            horizon=1.0,
            stage_cost=T * problem.stage_cost,
            constraints=[
                *problem.stated,
                # A weight is per second, and the core integrates over its own time.
                *[
                    replace(
                        c, weight=T * c.weights[0], quadratic_weight=T * c.weights[1]
                    )
                    for c in problem.soft
                ],
            ],
            risk=None if risk is None else replace(risk, stage=T * risk.stage),
        )
