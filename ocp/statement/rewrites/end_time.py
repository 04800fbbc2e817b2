"""Free end time T: a decided parameter; rates and stage cost are multiplied by T.

The new horizon is 1. Source: the time transformation t = T tau of any text on direct
methods, such as Betts (2010), Practical Methods for Optimal Control, 4.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import casadi as ca

from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import symbol_names
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.changed import with_equations
from swarmstart.ocp.statement.rewrites.rewrite import Rewrite

END_TIME = "end time"
"""Name of the parameter, and then of the state, that is a free end time."""
GIVEN_LENGTH = "length given with the plan"
"""Name of the state that is the length of a horizon which shrinks."""


class Length(NamedTuple):
    """Length of a horizon, and a problem's parameters; a free length is one of them.

    Attributes:
        seconds: The length [s], an expression.
        parameters: The model's parameters and, if the length is free, the length.
        decided: The decided parameters by name and, if it is free, the length.
    """

    seconds: ca.SX
    parameters: ca.SX
    decided: Mapping[str, Free]


def length_of(problem: OptimalControlProblem) -> Length:
    """Return the length of a problem's horizon, with the problem's parameters.

    The length is a number if it is fixed, a decided parameter if it is free, and a
    state if it is given with each plan.
    """
    parameters, decided = problem.model.parameters, problem.decided
    if GIVEN_LENGTH in problem.model.state_names:
        place = problem.model.state_names.index(GIVEN_LENGTH)
        return Length(problem.model.states[place], parameters, decided)
    if not isinstance(problem.horizon, Free):
        return Length(ca.SX(problem.length), parameters, decided)
    if END_TIME in decided:  # Another rewrite needed it already.
        place = symbol_names(parameters).index(END_TIME)
        return Length(parameters[place], parameters, decided)
    T = ca.SX.sym(END_TIME)
    every = {END_TIME: problem.horizon, **decided}
    return Length(T, ca.vertcat(T, parameters), every)


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
        T, parameters, decided = length_of(problem)
        ode, fields = stretched(problem, T)
        return replace(
            problem,
            model=with_equations(problem.model, ode=ode, parameters=parameters),
            decided=decided,
            **fields,
        )


def stretched(problem: OptimalControlProblem, T: ca.SX) -> tuple[ca.SX, dict[str, Any]]:
    """Return the rates of a problem over a horizon of length 1, and changed fields.

    Args:
        problem: The problem.
        T: Length of the horizon of `problem` [s].
    """
    risk = problem.risk
    return T * problem.model.ode, {
        "horizon": 1.0,
        "stage_cost": T * problem.stage_cost,
        "constraints": [
            *problem.stated,
            # A weight is per second, and the core integrates over its own time.
            *[
                replace(c, weight=T * c.weights[0], quadratic_weight=T * c.weights[1])
                for c in problem.soft
            ],
        ],
        "risk": None if risk is None else replace(risk, stage=T * risk.stage),
    }
