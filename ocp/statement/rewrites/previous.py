"""Previous controls: states that the end of an interval sets to the controls."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.changed import (
    Appended,
    controls_before,
    with_states,
)
from swarmstart.ocp.statement.rewrites.rewrite import Rewrite


@dataclass(frozen=True, slots=True)
class Previous(Rewrite):
    """Expressions with the previous controls -> states that remember them."""

    role = "previous"
    is_remembered = True

    def accepts(self, problem: OptimalControlProblem) -> bool:
        """Return whether the previous controls are used."""
        return bool(problem.previous.numel())

    def apply(self, problem: OptimalControlProblem) -> OptimalControlProblem:
        """Return the problem with states in place of the previous controls."""
        names = tuple(f"previous {name}" for name in problem.model.control_names)
        states = problem.previous
        appended = Appended(states=states, after=problem.model.controls, names=names)
        return with_states(problem, appended, previous=ca.SX(0, 1))

    def start(
        self, problem: OptimalControlProblem, x0: Array, previous: ArrayLike | None
    ) -> Array:
        """Return the controls before the horizon."""
        del x0
        return controls_before(problem, previous)[:, -1]

    def along(
        self, problem: OptimalControlProblem, start: Array, controls: Array, at: Array
    ) -> Array:
        """Return the controls of the interval before each of the times `at`."""
        del problem
        return np.hstack([start[:, None], controls])[:, at.astype(int)]
