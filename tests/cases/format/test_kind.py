"""The planning problem that a scenario poses is the one that its controller plans."""

from __future__ import annotations

import numpy as np
import pytest

from swarmstart.cases.format.kind import Posed, SeveralPlansError
from swarmstart.cases.format.registry import KINDS, load
from swarmstart.cases.format.scenario import Resolved, read_document, resolve
from swarmstart.cases.kinds.formation_flight.build import pose as pose_formation
from swarmstart.cases.kinds.reconfiguration.build import pose as pose_reconfiguration
from swarmstart.ocp import (
    Fitness,
    IpoptOptions,
    Plan,
    Planner,
    Plant,
    SearchSettings,
    TrajectoryFamily,
)
from swarmstart.ocp.fitness import replay

ONE_EACH = [
    "passing_side",
    "formation_obstacle_uav3",
    "close_formation",
    "reconfiguration",
    "swap_5",
]
COLD, FROM_THE_SWARM = 1810.2, 446.7  # of passing_side, below the obstacle and above


def resolved(name: str, *assignments: str, search: str | None = None) -> Resolved:
    return resolve(read_document(name), search=search, assignments=assignments)


def posed(one: Resolved) -> Posed:
    return one.kind.pose(one.scenario)


@pytest.mark.parametrize("name", ONE_EACH)
def test_the_posed_problem_is_what_the_controller_plans_first(name: str) -> None:
    one = resolved(
        name, "polish=none", "budget.evaluations=40", "backend=casadi", search="random"
    )
    flight, question = one.kind.build(one.scenario), posed(one)
    rng = np.random.default_rng(0)
    plans = flight.controller.decide(0.0, flight.x0, None, rng=rng).plans
    plan = plans[0]  # With given plans the first UAV is the one that plans.
    assert plan.evaluations == 40
    assert all(other.evaluations == 0 for other in plans[1:])
    states, cost, violation = replay(
        question.problem, plan.controls, question.x0, question.known
    )
    assert cost == pytest.approx(plan.cost, rel=1e-9)
    assert violation == pytest.approx(plan.violation, rel=1e-9, abs=1e-12)
    np.testing.assert_allclose(states, plan.states, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ONE_EACH)
def test_posing_compiles_neither_planner_nor_plant(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("compiled")

    monkeypatch.setattr(Fitness, "__init__", refuse)
    monkeypatch.setattr(Plant, "__init__", refuse)
    question = posed(resolved(name))
    assert question.x0.shape == (question.problem.model.nx,)


def test_only_a_transfer_poses_a_family_and_it_is_the_searched_one() -> None:
    one = resolved("swap_5", "backend=casadi")
    family, flight = posed(one).family, one.kind.build(one.scenario)
    searched = flight.family  # type: ignore[attr-defined]
    assert isinstance(family, TrajectoryFamily)
    c = np.random.default_rng(0).uniform(-1.0, 1.0, 15)
    for mine, theirs in zip(
        family.trajectory(c, flight.x0, []),
        searched.trajectory(c, flight.x0, []),
        strict=True,
    ):
        np.testing.assert_array_equal(np.array(mine), np.array(theirs))
    assert all(posed(resolved(name)).family is None for name in ONE_EACH[:-1])


def test_several_planning_uavs_pose_no_single_problem() -> None:
    scenario = resolved("formation_obstacle").scenario
    with pytest.raises(
        SeveralPlansError,
        match="expected one UAV that plans, one planning problem a step; found 5 "
        "without the key 'plan'",
    ):
        pose_formation(scenario)  # type: ignore[arg-type]


def test_planning_in_turn_poses_no_single_problem() -> None:
    scenario = resolved("formation_100").scenario
    with pytest.raises(
        SeveralPlansError,
        match=r"expected planning\.name to be joint, one planning problem a step; "
        "found priority, one for each of 100 UAVs",
    ):
        pose_reconfiguration(scenario)  # type: ignore[arg-type]


def planned(question: Posed, search: SearchSettings | None) -> Plan:
    planner = Planner(question.problem, search=search, polish=IpoptOptions())
    rng = np.random.default_rng(0)
    return planner.plan(question.x0, known=question.known, rng=rng)


def test_ipopt_alone_passes_the_obstacle_on_the_dear_side() -> None:
    one = resolved("passing_side")
    cold = planned(posed(one), None)
    assert cold.feasible and cold.cost == pytest.approx(COLD, abs=0.5)
    assert cold.states[3].min() < 1.0 - 11.9  # below, at y = -10.9
    one = resolved("passing_side", search="lshade")
    found = planned(posed(one), one.scenario.search_settings())
    assert found.feasible and found.cost == pytest.approx(FROM_THE_SWARM, abs=0.5)
    assert found.states[3].min() == 0.0  # above, never lower than at the start


def test_ipopt_alone_finds_a_dear_plan_for_the_third_uav() -> None:
    question = posed(resolved("formation_obstacle_uav3"))
    assert question.problem.ns == 4 + 2 * 2  # its slot, and where 5 and 4 will be
    cold = planned(question, None)
    assert cold.feasible and cold.cost == pytest.approx(82152, rel=1e-4)
    one = resolved("formation_obstacle_uav3", search="lshade")
    found = planned(question, one.scenario.search_settings())
    assert found.feasible and found.cost == pytest.approx(30991, rel=1e-4)


@pytest.mark.parametrize("name", KINDS)
def test_a_measure_that_may_be_null_has_a_reason(name: str) -> None:
    kind = load(KINDS[name].kind)
    assert kind.undefined.keys() <= kind.measures.keys()
    null = {measure for measure, text in kind.measures.items() if "null" in text}
    assert null and null <= kind.undefined.keys()
    assert all(kind.undefined.values())
