"""The one-call way through: search, polish, verify."""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.heuristics import (
    Algorithm,
    Budget,
    Order,
    default_algorithm,
    static_penalty,
)
from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.fitness import Known
from swarmstart.ocp.planner import Planner, SearchSettings
from swarmstart.ocp.polish import IpoptOptions
from swarmstart.ocp.problem import OptimalControlProblem
from swarmstart.ocp.solution import Solution, verified

Array = NDArray[np.float64]


def solve(  # noqa: PLR0913 - the whole way in one call
    problem: OptimalControlProblem,
    x0: ArrayLike,
    *,
    search: Algorithm | Literal["default"] | None = "default",
    budget: Budget | None = None,
    order: Order | None = None,
    polish: IpoptOptions | None = None,
    guess: Array | None = None,
    parameters: ArrayLike = (),
    signals: ArrayLike = (),
    rng: np.random.Generator,
) -> Solution:
    """Solve an optimal-control problem from an initial state.

    Args:
        problem: The problem.
        x0: Initial state, shape (nx,).
        search: Settings of a population search; "default" means what
            `heuristics.default_algorithm` takes for the budget, None means none.
        budget: What the search may cost; None means 20,000 evaluations.
        order: How individuals are ordered; None means a static penalty of 1e4 per
            unit of violation.
        polish: Options of IPOPT; None means no polish.
        guess: Controls to start from, shape (nu, N); None means none is known.
        parameters: Shape (np,).
        signals: Shape (ns, nodes).
        rng: Source of all randomness.

    Raises:
        InvalidProblemError: If there is neither a search nor a polish, or a shape is
            not the problem's.
    """
    if search is None and polish is None:
        raise InvalidProblemError("solve needs a search, a polish or both, got neither")
    settings = None
    if search is not None:
        budget = budget or Budget(evaluations=20_000)
        settings = SearchSettings(
            algorithm=default_algorithm(budget.evaluations)
            if search == "default"
            else search,
            budget=budget,
            order=order or static_penalty(1e4),
        )
    planner = Planner(problem, search=settings, polish=polish)
    known = Known(parameters=parameters, signals=signals)
    plan = planner.plan(x0, known=known, guess=guess, rng=rng)
    return verified(problem, plan, x0, known)
