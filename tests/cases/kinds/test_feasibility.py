"""Which control steps count as having found the plan they looked for."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.cases.kinds.feasibility import found_plans, planned
from swarmstart.ocp import (
    Decision,
    Mode,
    Model,
    OptimalControlProblem,
    Plan,
    Planner,
    Source,
)


@pytest.fixture(scope="module")
def planner() -> Planner:
    """x' = u, x(1) = 1."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=1.0, intervals=1, terminal=[x - 1]
    )
    return Planner(problem, search=None, backend="casadi")


def plan(planner: Planner, control: float, source: Source) -> Plan:
    return planner.evaluated(np.array([[control]]), [0.0], source=source)


def test_plans_are_found_if_all_are_feasible_and_none_is_the_last_one_shifted(
    planner: Planner,
) -> None:
    good, bad = (plan(planner, u, Source.SEARCH) for u in (1.0, 0.5))
    shifted = plan(planner, 1.0, Source.SHIFTED)
    for plans, found in (
        ((good, good), True),
        ((good, bad), False),
        ((shifted, good), False),
        ((plan(planner, 0.5, Source.SHIFTED),), False),
    ):
        assert found_plans(Decision(control=np.ones(1), plans=plans)) is found


def test_step_under_the_linear_law_is_not_planned(planner: Planner) -> None:
    plans = (plan(planner, 1.0, Source.LINEAR),)
    decisions = (
        Decision(control=np.ones(1), plans=plans, mode=mode)
        for mode in (Mode.PLANNED, Mode.LINEAR)
    )
    assert [planned(decision) for decision in decisions] == [True, False]
