"""A plan: controls over one horizon, with their origin, cost and violation."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.nlp.duals import Duals
from swarmstart.ocp.nlp.optimality import NlpPoint
from swarmstart.ocp.nlp.polish_options import PolishStatus
from swarmstart.ocp.search.account import Lanes, StartsAccount
from swarmstart.ocp.statement.problem import OptimalControlProblem


class Source(Enum):
    """Origin of a plan."""

    GUESS = "the guess itself"
    SEARCH = "the search"
    POLISH = "the polish"
    SHIFTED = "the last plan, shifted, since no feasible one was found"
    LINEAR = "the linear law of the terminal set"


@dataclass(frozen=True, slots=True, eq=False)
class SearchReport:
    """Result of a population search, before any polish.

    Attributes:
        cost: Cost of the search's answer; NaN without a search.
        violation: Violation of that answer; NaN without a search.
        history: Cost of the best point after each generation, shape (generations,);
            empty without a search.
        evaluations: Evaluations spent up to each generation, same shape.
        lanes: Results of local solves in lanes, if the search uses them; else None.
        without_lanes: Reason why a search that should use lanes did not; else empty.
    """

    cost: float = np.nan
    violation: float = np.nan
    history: Array = field(default_factory=lambda: np.empty(0))
    evaluations: Array = field(default_factory=lambda: np.empty(0))
    lanes: Lanes | None = None
    without_lanes: str = ""

    def lines(self, sense: float = 1.0) -> list[str]:
        """Return a line on the local solves in lanes during the search, or no line.

        Args:
            sense: 1 for a minimised cost, -1 for a maximised one.
        """
        if self.lanes is not None:
            return [f"  searched    {self.lanes.line(sense)}"]
        if self.without_lanes:
            return [f"  searched    without lanes: {self.without_lanes}"]
        return []

    def told(self, sense: float = 1.0) -> dict[str, Any] | None:
        """Return the same as a dictionary for JSON; None if the search uses no lanes.

        Args:
            sense: 1 for a minimised cost, -1 for a maximised one.
        """
        if self.lanes is None and not self.without_lanes:
            return None
        lanes = None if self.lanes is None else self.lanes.told(sense)
        return {"lanes": lanes, "without_lanes": self.without_lanes}


NO_SEARCH = SearchReport()


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Plan:
    """A control sequence over one horizon, with its cost and violation.

    Attributes:
        controls: Controls, shape (nu, N).
        states: States at the nodes, shape (nx, nodes).
        cost: Cost on the problem's evaluator; minimised.
        violation: Sum of the scaled excesses on the problem's evaluator.
        feasible: Whether the violation is within the problem's tolerance.
        source: Origin of the plan.
        search: Result of the search; `NO_SEARCH` without one.
        evaluations: Evaluations spent, including those of the polish.
        polish_status: Status of the polish; None without one.
        start_excess: Largest excess of the start over bounds of states and path
            constraints without controls, relative to their scales; 0: the start keeps
            them.
        point: The stationary point of the NLP that the plan is; None: not shown to be
            one.
        relaxed_cost: Cost of a local optimum without the requirement of whole numbers;
            NaN: not known.
        start: Initial state of a plan whose states are not kept; None if they are kept.
        starts: Account of all starts; None if there was only one.
        duals: Multipliers of a plan whose point is not kept; None if it is kept or
            there are no multipliers.
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
        """True if a population search took part; False if a warm start was enough."""
        return self.search.evaluations.size > 0

    @property
    def x0(self) -> Array:
        """Initial state, including the decisions about it, shape (nx,)."""
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
    """Return the start of a plan; its decisions about the start are used.

    Args:
        problem: The problem of the plan.
        plan: The plan.
        x0: Initial state as given, shape (nx,).
    """
    return plan.x0 if problem.nlp_starts else x0


class Account(TypedDict, total=False):
    """Effort of a plan, with the fields of Plan; all of them optional."""

    search: SearchReport
    evaluations: int
    polish_status: PolishStatus | None
    point: NlpPoint | None
    relaxed_cost: float
    starts: StartsAccount | None


class PlanningInterrupted(KeyboardInterrupt):
    """Ctrl-C during planning.

    Attributes:
        partial: The best plan so far.
    """

    def __init__(self, partial: Plan) -> None:
        """Keep the best plan so far."""
        super().__init__("planning was interrupted before its end")
        self.partial = partial
