"""One plan, flown to its end without looking again."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.controller import Decision
from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.planner import Planner

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class OpenLoop:
    """A controller that plans at the start and then flies what it planned.

    Attributes:
        planner: Plans from the first state.
    """

    planner: Planner

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
        plans = previous.plans if previous else (self.planner.plan(state, rng=rng),)
        number, intervals = round(time / self.dt), self.planner.problem.intervals
        if number >= intervals:
            raise InvalidProblemError(
                f"an open loop must end with its plan of {intervals} intervals, "
                f"got interval {number}"
            )
        return Decision(control=plans[0].controls[:, number], plans=plans)
