"""python-control's solver solves the problem that all others solve, on its grid."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.cases.campaign.trials.building import Trial
from swarmstart.cases.campaign.trials.peers import PeerError
from swarmstart.cases.campaign.trials.result import PlanResult
from swarmstart.cases.campaign.trials.solver_names import (
    UnknownSolverError,
    solver_of,
)
from swarmstart.cases.campaign.trials.trial import answered
from swarmstart.cases.format.kind import PlanningProblem
from swarmstart.ocp import (
    Bounds,
    Free,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
)

X, U, T, P = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("t"), ca.SX.sym("p")


def posed(**options: Any) -> PlanningProblem:
    """A cart that must not be too fast, in a wind that changes with time."""
    model = Model(
        states=X,
        controls=U,
        ode=ca.vertcat(X[1], P * U + 0.2 * ca.cos(T)),
        time=T,
        parameters=P,
    )
    settings: dict[str, Any] = {
        "horizon": 2.0, "intervals": 6, "stage_cost": U**2 + 0.1 * X[1] ** 2,
        "terminal_cost": (X[0] - 1) ** 2, "bounds": Bounds(controls=(-2, 2)),
        "terminal": [(X[1], 0)],
    }  # fmt: skip
    problem = OptimalControlProblem(model, **(settings | options))
    known = Known(parameters=[1.5], time=0.3)
    return PlanningProblem(problem=problem, x0=np.zeros(2), known=known)


def answer(name: str, problem: PlanningProblem, **budget: Any) -> PlanResult:
    trial = Trial(
        solver=solver_of(name), budget=budget or {"seconds": 60.0}, seed=0, search=None
    )
    return answered(problem, trial)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"checks": 3, "constraints": [PathConstraint(expression=X[1], upper=0.55)]},
        {"constraints": [PathConstraint(expression=U + X[1], upper=0.9)]},
        {"constraints": [PathConstraint(expression=U - X[1], upper=0.3)]},
        {"quadrature": "right", "step_cost": 0.1 * U**2, "maximize": False},
        {"control_shape": "continuous"},
        {"terminal_cost": 0, "terminal": [X[0] >= 1, (X[1], 0)]},
    ],
    ids=["plain", "speed", "mixed", "begins", "costs", "linear", "end"],
)
def test_it_finds_what_ipopt_finds(options: dict[str, Any]) -> None:
    problem = posed(**options)
    theirs, ours = answer("python-control", problem), answer("ipopt", problem)
    assert theirs.feasible and ours.feasible
    assert theirs.verified_cost == pytest.approx(ours.verified_cost, rel=2e-5)
    assert theirs.stopped_by == "itself"
    assert theirs.evaluations is not None and theirs.evaluations > 20


def test_a_budget_ends_it_and_its_best_iterate_is_the_answer() -> None:
    ended = answer("python-control", posed(), evaluations=40)
    assert ended.stopped_by == "evaluations" and ended.evaluations == 40
    few = answer("python-control[maxiter=1]", posed())
    assert few.stopped_by == "itself"
    whole = answer("python-control", posed())
    assert few.claimed_cost is not None
    assert few.evaluations is not None and whole.evaluations is not None
    assert few.evaluations < whole.evaluations


def test_problems_that_decide_more_than_controls_are_refused() -> None:
    for options in (
        {"horizon": Free(1, 3)},
        {"bounds": Bounds(controls=(-2, 2), integer=[0])},
        {"decided": {"p": Free(1, 2)}},
    ):
        with pytest.raises(PeerError, match="python-control decides controls only"):
            answer("python-control", posed(**options))


def test_its_options_are_those_of_the_package() -> None:
    solver = solver_of("python-control[maxiter=20,method=trust-constr]")
    assert dict(solver.options) == {"maxiter": 20, "method": "trust-constr"}
    assert solver.is_deterministic
    with pytest.raises(UnknownSolverError, match="maxiter to be an integer of at"):
        solver_of("python-control[maxiter=0]")
    with pytest.raises(UnknownSolverError, match="a search with an NLP solver after"):
        solver_of("python-control+ipopt")
    with pytest.raises(PeerError, match="python-control cannot be run"):
        answer("python-control[method=nonsense]", posed())
