"""One plan, flown to its end without looking again."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.controller import Decision, RecedingHorizon
from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.improving import repaired
from swarmstart.ocp.planner import Plan
from swarmstart.ocp.solution import verified

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class OpenLoop:
    """A controller that plans at the start and then flies what it planned.

    Attributes:
        loop: Plans from the first state.
        repair: Whether a plan that breaks a constraint between its checks is made
            again with a margin, as in `solve`.
    """

    loop: RecedingHorizon
    repair: bool = False

    @property
    def dt(self) -> float:
        """Length of a control interval [s]."""
        return self.loop.dt

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
        intervals = self.loop.planner.problem.intervals
        number = round(time / self.dt)
        if number >= intervals:
            raise InvalidProblemError(
                f"an open loop must end with its plan of {intervals} intervals, "
                f"got interval {number}"
            )
        return Decision(control=plans[0].controls[:, number], plans=plans)

    def _planned(self, state: Array, rng: np.random.Generator) -> Plan:
        """Return the plan from the first state."""
        planner, known = self.loop.planner, self.loop.known(0.0)
        plan = self.loop.plan(0.0, state, None, rng=rng)
        if not self.repair:
            return plan
        solution = verified(planner.tracer, plan, state, known)
        return repaired(planner, solution, state, known, rng=rng).solution.plan
