"""Rewrite of periodic states.

Each gets a constant copy of its start as a further state, and must equal this copy at
the end.
"""

from dataclasses import dataclass

import casadi as ca
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.common.expressions import symbol_of
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.changed import Appended, with_states
from swarmstart.ocp.statement.rewrites.rewrite import Rewrite
from swarmstart.ocp.system.constraints import TerminalConstraint


@dataclass(frozen=True, slots=True)
class Periodic(Rewrite):
    """Periodic states -> copies of their start, and terminal constraints."""

    role = "copies"

    def accepts(self, problem: OptimalControlProblem) -> bool:
        """Return whether a state is periodic."""
        return bool(problem.periodic)

    def apply(self, problem: OptimalControlProblem) -> OptimalControlProblem:
        """Return the problem with terminal constraints in place of the periodicity."""
        model = problem.model
        copies = ca.vertcat(*[symbol_of(_copy_of(name)) for name in problem.periodic])
        ends = [
            TerminalConstraint(
                expression=model.states[i] - copies[k],
                name=f"{model.state_names[i]} as at the start",
            )
            for k, i in enumerate(_numbers(problem))
        ]
        return with_states(
            problem,
            Appended(states=copies),
            terminal=[*problem.terminal_constraints, *ends],
            start=_starts(problem),
            periodic=(),
        )

    def start(
        self, problem: OptimalControlProblem, x0: Array, previous: ArrayLike | None
    ) -> Array:
        """Return the initial values of the periodic states."""
        del previous
        return x0[_numbers(problem)]


def _numbers(problem: OptimalControlProblem) -> list[int]:
    """Return the numbers of the periodic states."""
    return [problem.model.state_names.index(name) for name in problem.periodic]


def _starts(problem: OptimalControlProblem) -> dict[str | tuple[str, ...], Free]:
    """Return the free starts, in which a copy starts at the same value."""
    found: dict[str | tuple[str, ...], Free] = {}
    for key, value in problem.start.items():
        names = (key,) if isinstance(key, str) else tuple(key)
        copies = [_copy_of(name) for name in names if name in problem.periodic]
        together = (*names, *copies)
        found[together[0] if len(together) == 1 else together] = value
    return found


def _copy_of(name: str) -> str:
    return f"{name} at the start"
