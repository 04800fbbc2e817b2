from __future__ import annotations

from dataclasses import replace

import numpy as np

from swarmstart.cases.record.plans import effort, new_plans
from swarmstart.ocp import Decision
from swarmstart.tests.cases.record.test_partial import flight


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
