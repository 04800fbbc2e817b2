"""Maximised costs, multiplied by -1."""

from dataclasses import dataclass, replace

from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.rewrite import Rewrite


@dataclass(frozen=True, slots=True)
class Minimised(Rewrite):
    """Costs that are maximised -> costs that are minimised."""

    role = "sense"

    def accepts(self, problem: OptimalControlProblem) -> bool:
        """Return whether the costs are maximised."""
        return problem.maximize

    def apply(self, problem: OptimalControlProblem) -> OptimalControlProblem:
        """Return the problem with costs of the other sign."""
        return replace(
            problem,
            stage_cost=-problem.stage_cost,
            step_cost=-problem.step_cost,
            initial_cost=-problem.initial_cost,
            terminal_cost=-problem.terminal_cost,
            risk=None if problem.risk is None else problem.risk.negated(),
            maximize=False,
        )
