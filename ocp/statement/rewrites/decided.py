"""Decided parameters: states that are constant, with a free start."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.common.expressions import symbol_names
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.changed import Appended, with_states
from swarmstart.ocp.statement.rewrites.rewrite import Rewrite


@dataclass(frozen=True, slots=True)
class Decided(Rewrite):
    """Parameters that are decided -> constant states with a free start."""

    role = "decided"

    def accepts(self, problem: OptimalControlProblem) -> bool:
        """Return whether a parameter is decided."""
        return bool(problem.decided)

    def apply(self, problem: OptimalControlProblem) -> OptimalControlProblem:
        """Return the problem with states in place of the parameters."""
        every, decided = problem.model.parameters, problem.decided
        named = dict(zip(symbol_names(every), ca.vertsplit(every), strict=True))
        known = [symbol for name, symbol in named.items() if name not in decided]
        # The symbol itself becomes a state, so expressions need no change.
        states = ca.vertcat(*[named[name] for name in decided])
        parameters = ca.vertcat(ca.SX(0, 1), *known)
        return with_states(
            problem,
            Appended(states=states),
            {"parameters": parameters},
            start={**problem.start, **decided},
            decided={},
        )

    def start(
        self, problem: OptimalControlProblem, x0: Array, previous: ArrayLike | None
    ) -> Array:
        """Return NaN for each decided parameter."""
        del x0, previous
        return np.full(len(problem.decided), np.nan)
