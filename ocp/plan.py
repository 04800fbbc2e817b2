"""A plan: controls over one horizon, where they come from, and what they are worth."""

from dataclasses import dataclass, field
from enum import Enum
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.ocp.account import Lanes, StartsAccount
from swarmstart.ocp.duals import Duals
from swarmstart.ocp.optimality import NlpPoint
from swarmstart.ocp.polish_options import PolishStatus
from swarmstart.ocp.problem import OptimalControlProblem

Array = NDArray[np.float64]


class Source(Enum):
    """Where a plan comes from."""

    GUESS = "the guess itself"
    SEARCH = "the search"
    POLISH = "the polish"
    SHIFTED = "the last plan, shifted, since no feasible one was found"
    LINEAR = "the linear law of the terminal set"


@dataclass(frozen=True, slots=True, eq=False)
class SearchReport:
    """What a population search found, before any polish.

    Attributes:
        cost: Cost of its own answer; NaN without a search.
        violation: Violation of that answer; NaN without a search.
        history: Cost of its best point after each generation, shape (generations,);
            empty without a search.
        evaluations: Evaluations spent until then, same shape.
        lanes: What local solves in lanes found, of a search that uses them; None: it
            does not.
        without_lanes: Why it did not, though it is such a search; empty: it did, or is
            another.
    """

    cost: float = np.nan
    violation: float = np.nan
    history: Array = field(default_factory=lambda: np.empty(0))
    evaluations: Array = field(default_factory=lambda: np.empty(0))
    lanes: Lanes | None = None
    without_lanes: str = ""

    def lines(self, sense: float = 1.0) -> list[str]:
        """Return what local solves in lanes did in the search; empty without any.

        Args:
            sense: -1 where costs are gains.
        """
        if self.lanes is not None:
            return [f"  searched    {self.lanes.line(sense)}"]
        if self.without_lanes:
            return [f"  searched    without lanes: {self.without_lanes}"]
        return []

    def told(self, sense: float = 1.0) -> dict[str, Any] | None:
        """Return the same as JSON has it; None where the search uses no lanes.

        Args:
            sense: -1 where costs are gains.
        """
        if self.lanes is None and not self.without_lanes:
            return None
        lanes = None if self.lanes is None else self.lanes.told(sense)
        return {"lanes": lanes, "without_lanes": self.without_lanes}


NO_SEARCH = SearchReport()


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Plan:
    """A control sequence over one horizon, and what it is worth.

    Attributes:
        controls: Shape (nu, N).
        states: At the nodes, shape (nx, nodes).
        cost: Cost on the problem's evaluator, which is minimised.
        violation: Summed violation there.
        feasible: Whether the violation is within the problem's tolerance.
        source: Where the plan comes from.
        search: What the search found; `NO_SEARCH` without one.
        evaluations: Evaluations spent, those of the polish included.
        polish_status: How the polish ended; None without one.
        start_excess: By how much the start breaks bounds of states and path
            constraints that no control enters, in parts of their scales; 0: inside.
        point: The stationary point of the NLP that it is; None: not shown to be one.
        relaxed_cost: Cost with any numbers where controls take whole numbers, from a
            local solver; NaN: not known.
        start: Initial state of a plan whose states are not kept; None: they are.
        starts: Where it comes from and what other starts led to; None: there were not
            many.
        duals: Multipliers of a plan whose point is not kept; None: it is, or there are
            none.
    """

    controls: Array
    states: Array
    cost: float
    violation: float
    feasible: bool
    source: Source
    search: SearchReport = NO_SEARCH
    evaluations: int = 0
    polish_status: PolishStatus | None = None
    start_excess: float = 0.0
    point: NlpPoint | None = None
    relaxed_cost: float = np.nan
    start: Array | None = None
    starts: StartsAccount | None = None
    duals: Duals | None = None

    @property
    def is_searched(self) -> bool:
        """Whether a population search took part in it, or a warm start was enough."""
        return self.search.evaluations.size > 0

    @property
    def x0(self) -> Array:
        """Initial state, with what was decided about it, shape (nx,)."""
        if self.start is not None and not self.states.size:
            return self.start
        return self.states[:, 0]

    def __repr__(self) -> str:
        """Return cost, violation and source in one line."""
        kind = "feasible" if self.feasible else "infeasible"
        return (
            f"Plan: {kind}, cost {self.cost:.9g}, violation {self.violation:.3g}, "
            f"{self.controls.shape[1]} intervals, from {self.source.value}, "
            f"{self.evaluations} evaluations"
        )


def start_of(problem: OptimalControlProblem, plan: Plan, x0: ArrayLike) -> ArrayLike:
    """Return where a plan starts: what is decided about it is the plan's.

    Args:
        problem: The problem that it is a plan of.
        plan: The plan.
        x0: Initial state as given, shape (nx,).
    """
    return plan.x0 if problem.nlp_starts else x0


class Account(TypedDict, total=False):
    """What a plan took, as in Plan; all of it may be left out."""

    search: SearchReport
    evaluations: int
    polish_status: PolishStatus | None
    point: NlpPoint | None
    relaxed_cost: float
    starts: StartsAccount | None


class PlanningInterrupted(KeyboardInterrupt):
    """Ctrl-C while planning.

    Attributes:
        partial: The best plan so far.
    """

    def __init__(self, partial: Plan) -> None:
        """Keep the best plan so far."""
        super().__init__("planning was interrupted before its end")
        self.partial = partial
