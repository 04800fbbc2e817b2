"""Risk with kinks: the members' accrued costs as states, and decisions of the NLP."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.changed import Appended, with_states
from swarmstart.ocp.statement.rewrites.rewrite import Rewrite
from swarmstart.ocp.statement.risk import Epigraph, Risk, epigraph_symbols


@dataclass(frozen=True, slots=True)
class RiskCosts(Rewrite):
    """Rewrite of a risk that is no sum over time: it becomes a terminal cost.

    For an NLP this cost also has a smooth form (`Epigraph`).
    """

    role = "risk"

    def accepts(self, problem: OptimalControlProblem) -> bool:
        """Return whether the risk, unlike a mean, needs each member's whole cost."""
        risk = problem.risk
        # A core has its epigraph already.
        if risk is None or problem.epigraph is not None:
            return False
        return bool(epigraph_symbols(risk).numel())

    def apply(self, problem: OptimalControlProblem) -> OptimalControlProblem:
        """Return the problem with the costs of the members as states."""
        risk = _risk_of(problem)
        epigraph, nx = epigraph_symbols(risk), problem.model.nx
        accrued = ca.vertcat(
            *[ca.SX.sym(f"cost of member {m}") for m in range(risk.members)]
        )
        rates, steps = _accrual(problem, risk)
        end = Epigraph(
            risk=risk,
            costs=accrued + risk.terminal,
            decided=epigraph,
            first=nx + risk.members,
            accrued=tuple(range(nx, nx + risk.members)),
        )
        return with_states(
            problem,
            Appended(
                states=ca.vertcat(accrued, epigraph),
                rates=ca.vertcat(rates, ca.SX.zeros(epigraph.numel())),
                after=None
                if steps.is_zero()
                else ca.vertcat(accrued + steps, epigraph),
            ),
            terminal_cost=end.risk.of(end.costs),
            epigraph=end,
        )

    def start(
        self, problem: OptimalControlProblem, x0: Array, previous: ArrayLike | None
    ) -> Array:
        """Return zeros: costs accrue from 0."""
        del x0, previous
        risk = _risk_of(problem)
        return np.zeros(risk.members + epigraph_symbols(risk).numel())


def _accrual(problem: OptimalControlProblem, risk: Risk) -> tuple[ca.SX, ca.SX]:
    """Return the rates of the members' costs, and their steps at an interval's end."""
    model, dt = problem.model, problem.dt
    if problem.quadrature == "right":
        after = model.next_state if model.jumps else model.states
        ends = ca.substitute(risk.stage, model.states, after)
        return ca.SX.zeros(risk.members), risk.step + dt * ends
    if problem.quadrature == "left" or model.is_discrete:
        # Held over the interval, and so the same at its end; see ensemble.py.
        return ca.SX.zeros(risk.members), risk.step + dt * risk.stage
    return risk.stage, risk.step


def _risk_of(problem: OptimalControlProblem) -> Risk:
    if problem.risk is None:
        raise ValueError("expected a problem that `accepts` has found to have a risk")
    return problem.risk
