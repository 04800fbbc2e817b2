"""Figures of plans for several values of uncertain parameters.

The plant is one system. Its figures are those of one member's problem, with plans
as that member has them; one more figure shows the states of all members.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from swarmstart.cases.drawing.panels import (
    Labels,
    panels_figure,
    panels_of,
    stacked_limits,
)
from swarmstart.cases.drawing.plan_figures import PlanPath, with_plans
from swarmstart.cases.format.kind import Flight
from swarmstart.cases.kinds.problem.stated.posed import ProblemPosed
from swarmstart.ocp import OptimalControlProblem, Plan, Trajectory
from swarmstart.ocp.statement import END_TIME, Lowered, lowered

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def of_one_member(
    trajectory: Trajectory, problem: OptimalControlProblem, every: OptimalControlProblem
) -> Trajectory:
    """Return a run whose plans are the first member's, without states.

    Args:
        trajectory: The run.
        problem: Of one member.
        every: Of all members, which plans were made for.
    """
    many, nu = lowered(every), problem.model.nu
    start = _places(many, problem.model.nx, len(problem.periodic))

    def own(plan: Plan) -> Plan:
        return replace(
            plan,
            controls=plan.controls[:nu],
            states=np.empty((0, 0)),
            start=plan.x0[start],
        )

    made: dict[int, Plan] = {}  # A plan that is used again stays the same object.
    return replace(
        trajectory,
        decisions=tuple(
            replace(
                decision,
                plans=tuple(
                    made.setdefault(id(plan), own(plan)) for plan in decision.plans
                ),
            )
            for decision in trajectory.decisions
        ),
    )


def _places(many: Lowered, nx: int, copies: int) -> list[int]:
    """Return which states of all members' core are those of the first one's."""
    found = many.places
    return [
        *found["states"][:nx],
        *found[END_TIME],
        *found["decided"],
        *found["copies"][:copies],
        *found["previous"],
    ]


def member_figures(
    flight: Flight[ProblemPosed],
    trajectory: Trajectory,
    labels: Labels,
    problem: OptimalControlProblem,
) -> "Iterator[tuple[str, Figure]]":
    """Yield the states of all members of the first plan, beneath the simulated ones.

    Args:
        flight: The run.
        trajectory: Its path.
        labels: The words.
        problem: Of one member.
    """
    answer, nx = flight.answer(trajectory), problem.model.nx
    limits, _ = stacked_limits([problem])
    panels = panels_of(
        labels.states,
        labels,
        trajectory.dense_times,
        trajectory.dense_states,
        limits,
    )
    rows = answer.path.states[: answer.problem.model.nx]
    paths = [
        PlanPath(times=answer.path.times, states=member)
        for member in np.split(rows, len(rows) // nx)
    ]
    drawn = with_plans(panels, paths, name="members of the plan")
    yield "g_members", panels_figure({"states": drawn}, labels)
