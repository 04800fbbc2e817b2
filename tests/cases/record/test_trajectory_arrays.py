"""Plans of a flight: each counts once; steps that found a plan are known."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from swarmstart.cases.record.trajectory_arrays import (
    effort,
    found_plans,
    new_plans,
    planned,
)
from swarmstart.ocp import (
    Decision,
    Mode,
    Model,
    OptimalControlProblem,
    Plan,
    Planner,
    Source,
)
from swarmstart.tests.cases.record.test_partial import flight


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


def test_a_plan_that_several_steps_fly_counts_once() -> None:
    """An open loop of 50 steps had 1,002,350 evaluations for 20,047."""
    made = flight(1).decisions[0]
    plans = tuple(replace(plan, evaluations=20_047) for plan in made.plans)
    flown = [Decision(control=made.control, plans=plans) for _ in range(50)]
    later = tuple(replace(plan, evaluations=3) for plan in plans)
    flown += [Decision(control=made.control, plans=(plans[0], later[1]))] * 2
    whole = replace(
        flight(len(flown)), decisions=tuple(flown), step_seconds=np.ones(len(flown))
    )
    assert effort(whole)["evaluations"] == 2 * 20_047 + 3
    assert np.argwhere(new_plans(whole.decisions)).tolist() == [[0, 0], [0, 1], [50, 1]]


def test_plans_that_are_equal_count_each() -> None:
    made = flight(1).decisions[0]
    again = replace(made, plans=tuple(replace(plan) for plan in made.plans))
    assert new_plans((made, again)).all()
