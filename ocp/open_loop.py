"""One plan, flown to its end without looking again."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.controller import Decision
from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.fitness import NOTHING
from swarmstart.ocp.improving import repaired
from swarmstart.ocp.planner import Plan, Planner
from swarmstart.ocp.solution import verified

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class OpenLoop:
    """A controller that plans at the start and then flies what it planned.

    Attributes:
        planner: Plans from the first state.
        repair: Whether a plan that breaks a constraint between its checks is made
            again with a margin, as in `solve`.
    """

    planner: Planner
    repair: bool = False

    @property
    def dt(self) -> float:
        """Length of a control interval [s]."""
        return self.planner.problem.dt

    def decide(
        self,
        time: float,
        state: Array,
        previous: Decision | None,
        *,
        rng: np.random.Generator,
    ) -> Decision:
        """Return the plan's control at a time; see Controller.

        Raises:
            InvalidProblemError: If the time is after the plan's last interval.
        """
        plans = previous.plans if previous else (self._planned(state, rng),)
        number, intervals = round(time / self.dt), self.planner.problem.intervals
        if number >= intervals:
            raise InvalidProblemError(
                f"an open loop must end with its plan of {intervals} intervals, "
                f"got interval {number}"
            )
        return Decision(control=plans[0].controls[:, number], plans=plans)

    def _planned(self, state: Array, rng: np.random.Generator) -> Plan:
        """Return the plan from the first state."""
        plan = self.planner.plan(state, rng=rng)
        if not self.repair:
            return plan
        solution = verified(self.planner.problem, plan, state)
        return repaired(self.planner, solution, state, NOTHING, rng=rng).solution.plan
