"""Length of the horizon that is given with each plan: a state T that is constant.

Rates and stage cost are multiplied by T, and the new horizon is 1, as for a free end
time; but T is known when a plan is made. So a horizon that ends at a fixed time shrinks
from plan to plan, and nothing is built again.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.changed import Appended, with_states
from swarmstart.ocp.statement.rewrites.end_time import END_TIME, GIVEN_LENGTH, stretched
from swarmstart.ocp.statement.rewrites.rewrite import Rewrite


@dataclass(frozen=True, slots=True)
class Shrinking(Rewrite):
    """A fixed horizon -> one of length 1, and a state that is its length."""

    role = END_TIME

    def accepts(self, problem: OptimalControlProblem) -> bool:
        """Return True; raise if the end time is free.

        Raises:
            InvalidProblemError: If the end time is free.
        """
        if isinstance(problem.horizon, Free):
            raise InvalidProblemError(
                "until is for plans whose end is a fixed time: the horizon must be a "
                "number, got a free end time (a period is enough for that)"
            )
        return True

    def apply(self, problem: OptimalControlProblem) -> OptimalControlProblem:
        """Return the problem over a horizon of length 1.

        Raises:
            InvalidProblemError: If the model is in discrete time.
        """
        if problem.model.is_discrete:
            raise InvalidProblemError(
                "until needs intervals that become shorter: expected a model in "
                "continuous time, got one in discrete time"
            )
        T = ca.SX.sym(GIVEN_LENGTH)
        ode, fields = stretched(problem, T)
        return with_states(problem, Appended(states=T), {"ode": ode}, **fields)

    def start(
        self, problem: OptimalControlProblem, x0: Array, previous: ArrayLike | None
    ) -> Array:
        """Return the horizon's length; a closed loop replaces it by the time left."""
        del x0, previous
        return np.array([problem.length])
