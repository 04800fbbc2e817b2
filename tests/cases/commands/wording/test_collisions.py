"""Collisions of a flight: told first, with the time, the UAVs and the law."""

from __future__ import annotations

from dataclasses import replace

import pytest

from swarmstart.cases.campaign.running.finished_run import Run
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.commands.wording.outcomes import (
    collisions,
    kept_constraints,
    told_status,
)
from swarmstart.cases.commands.wording.words import sentences
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.ocp import Mode, SolutionStatus


@pytest.fixture(scope="module")
def entered() -> Run:
    """UAV 1 starts 10 m before a disc, at 15 m/s: it cannot avoid it."""
    disc = "obstacles=[{x_m: 25, y_m: 65, radius_m: 10}]"
    tiny = ["steps=2", "budget.evaluations=40", disc]
    return run(resolve(read_document("formation_v"), assignments=tiny), seed=0)


def test_an_entered_obstacle_is_told_first_with_time_and_uav(entered: Run) -> None:
    clear = entered.measures["obstacle_clearance_m"]
    assert isinstance(clear, float) and clear < 0
    _, first, result, *_ = sentences(entered)
    assert first.startswith(f"COLLISION: {-clear:.3g} m inside an obstacle at ")
    assert " s (UAV 1" in first and "linear law" not in first
    assert result.startswith(("Settled", "Not settled"))


def test_a_collision_under_the_linear_law_says_so(entered: Run) -> None:
    steps = [replace(d, mode=Mode.LINEAR) for d in entered.trajectory.decisions]
    trajectory = replace(entered.trajectory, decisions=tuple(steps))
    said = collisions(replace(entered, trajectory=trajectory))
    assert said[0].endswith("), under the linear law.")


def test_a_flight_that_keeps_everything_has_no_such_line(entered: Run) -> None:
    kept = {"obstacle_clearance_m": 0.5, "min_distance_m": 3.0}
    done = replace(entered, measures={**entered.measures, **kept})
    assert collisions(done) == []
    assert "but the simulated path" not in "".join(sentences(done))


def test_feasible_plans_never_hide_a_broken_constraint(entered: Run) -> None:
    all_found = entered.ended._replace(
        found="every planned step found a feasible plan",
        more=", 3 steps under the linear law",
        all_found=True,
    )
    assert told_status(replace(entered, ended=all_found)) == (
        "simulated to the end; every planned step found a feasible plan, but the "
        "simulated path breaks a constraint, 3 steps under the linear law"
    )
    some = replace(entered, ended=all_found._replace(all_found=False))
    assert told_status(some) == some.status
    assert "but the simulated path" not in some.status


def test_a_flight_that_comes_near_nothing_without_a_feasible_plan_says_no_more(
    entered: Run,
) -> None:
    ended = entered.ended._replace(plan=SolutionStatus.INFEASIBLE)
    distances = ("min_distance_m", "obstacle_clearance_m")
    without = {name: m for name, m in entered.measures.items() if name not in distances}
    alone = replace(entered, ended=ended, measures=without)
    assert kept_constraints(alone) == ""
    assert "" not in sentences(alone)
