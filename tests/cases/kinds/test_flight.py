"""A closed loop from posed agents, and the planning problem of its first step."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.cases.format.kind import (
    PlanningProblem,
    Posed,
    PosedAgent,
    PosedPlant,
    SeveralPlansError,
)
from swarmstart.cases.format.scenario import Resolved, read_document, resolve
from swarmstart.cases.kinds.flight import first_problem, flight_of
from swarmstart.ocp import (
    Fitness,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    Plan,
    Planner,
    Plant,
    SearchSettings,
    Source,
    Team,
    TrajectoryFamily,
    simulate,
)
from swarmstart.ocp.rollout.fitness import replay
from swarmstart.tests.cases.kinds.flights import build

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


def first(one: Resolved) -> PlanningProblem:
    return first_problem(one.kind.pose(one.scenario))


@pytest.mark.parametrize("name", ONE_EACH)
def test_the_first_problem_is_what_the_controller_plans_first(name: str) -> None:
    one = resolved(
        name, "polish=none", "budget.evaluations=40", "backend=casadi", search="random"
    )
    flight, question = build(one.scenario), first(one)
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
    question = first(resolved(name))
    assert question.x0.shape == (question.problem.model.nx,)


def test_only_a_transfer_poses_a_family_and_it_is_the_searched_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    searched = []
    planner = Planner.__init__

    def noted(self: Planner, *arguments: Any, **settings: Any) -> None:
        searched.append(settings["family"])
        planner(self, *arguments, **settings)

    monkeypatch.setattr(Planner, "__init__", noted)
    for name in ONE_EACH:
        one = resolved(name, "backend=casadi")
        build(one.scenario)
        assert isinstance(searched.pop(), TrajectoryFamily) is (name == "swap_5")
        assert (first(one).family is not None) is (name == "swap_5")


@pytest.mark.parametrize(
    ("name", "planning"), [("formation_obstacle", 5), ("formation_100", 99)]
)
def test_several_that_plan_have_no_single_first_problem(
    name: str, planning: int
) -> None:
    with pytest.raises(
        SeveralPlansError,
        match="expected one planning problem a step: all planned at once, or a given "
        f"plan for all but one agent; found {planning} that plan",
    ):
        first(resolved(name))


def test_one_that_plans_near_a_held_leader_has_no_single_first_problem() -> None:
    pair = (
        "uavs=[{speed_m_s: 20, heading_rad: 0, x_m: 0, y_m: 0}, "
        "{speed_m_s: 20, heading_rad: 0, x_m: 0, y_m: 20}]"
    )
    slots = "slots=[{x_m: 0, y_m: 0}, {x_m: -20, y_m: 20}]"
    with pytest.raises(SeveralPlansError, match="found 1 that plan"):
        first(resolved("formation_100", pair, slots, "leader_uav=1"))


def test_the_first_problem_sees_the_given_plans_that_a_flight_sees() -> None:
    one = resolved("formation_obstacle_uav3", "backend=casadi")
    flight, seen_first = build(one.scenario), []
    team = flight.controller
    assert isinstance(team, Team)

    def plan(number: int, state: np.ndarray, seen: tuple[np.ndarray, ...]) -> Plan:
        agent, controller = flight.posed.agents[number], team.agents[number].controller
        known = controller.known(0.0, seen)
        if agent.given is None:
            seen_first.append(known.signals)
        controls = np.zeros((2, agent.problem.intervals))
        flown = controls if agent.given is None else agent.given
        return controller.planner.evaluated(
            flown, state, known=known, source=Source.GUESS
        )

    team.plans(flight.x0, plan)
    known = np.asarray(first(one).known.signals)
    np.testing.assert_allclose(known, np.asarray(seen_first[0]), rtol=1e-12)


def test_a_given_plan_is_neither_searched_nor_polished() -> None:
    flight = build(resolved("formation_obstacle_uav3").scenario)
    team = flight.controller
    assert isinstance(team, Team)
    planners = [agent.controller.planner for agent in team.agents]
    assert [p.search is None and p.polish is None for p in planners] == [
        agent.given is not None for agent in flight.posed.agents
    ]


def test_an_open_loop_knows_its_signals_and_begins_at_its_guess() -> None:
    """A given plan is applied unchanged, and verified with the values known to it."""
    x, u, wanted = (ca.SX.sym(name) for name in ("x", "u", "wanted"))
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=2.0,
        intervals=2,
        stage_cost=(x - wanted) ** 2,
        signals=wanted,
        quadrature="right",
    )
    controls = np.array([[1.0, -3.0]])
    posed = Posed(
        agents=(
            PosedAgent(
                problem=problem,
                reference=lambda times: 10.0 + times[None],
                given=controls,
            ),
        ),
        x0=np.zeros(1),
        plant=PosedPlant(model=problem.model, substeps=3),
        open_loop=True,
    )
    flight = flight_of(posed, resolved("swap_5").scenario)
    flown = simulate(
        flight.plant,
        flight.controller,
        flight.x0,
        steps=2,
        rng=np.random.default_rng(0),
    )
    assert flown.states == pytest.approx(np.array([[0.0, 1.0, -2.0]]))
    cost = (1.0 - 11.0) ** 2 + (-2.0 - 12.0) ** 2  # against 10 + t
    assert flown.decisions[0].plans[0].cost == pytest.approx(cost)
    assert flight.answer(flown).plan.cost == pytest.approx(cost)
    one = first_problem(replace(posed, agents=(replace(posed.agents[0], given=None),)))
    assert replay(problem, controls, one.x0, one.known)[1] == pytest.approx(cost)


def planned(question: PlanningProblem, search: SearchSettings | None) -> Plan:
    planner = Planner(question.problem, search=search, polish=IpoptOptions())
    rng = np.random.default_rng(0)
    return planner.plan(question.x0, known=question.known, rng=rng)


def test_ipopt_alone_passes_the_obstacle_on_the_dear_side() -> None:
    one = resolved("passing_side")
    cold = planned(first(one), None)
    assert cold.feasible and cold.cost == pytest.approx(COLD, abs=0.5)
    assert cold.states[3].min() < 1.0 - 11.9  # below, at y = -10.9
    one = resolved("passing_side", search="lshade")
    found = planned(first(one), one.scenario.search_settings())
    assert found.feasible and found.cost == pytest.approx(FROM_THE_SWARM, abs=0.5)
    assert found.states[3].min() == 0.0  # above, never lower than at the start


def test_ipopt_alone_finds_a_dear_plan_for_the_third_uav() -> None:
    question = first(resolved("formation_obstacle_uav3"))
    assert question.problem.ns == 4 + 2 * 2  # its slot, and where 5 and 4 will be
    cold = planned(question, None)
    assert cold.feasible and cold.cost == pytest.approx(75250, rel=1e-4)
    one = resolved("formation_obstacle_uav3", search="lshade")
    found = planned(question, one.scenario.search_settings())
    assert found.feasible and found.cost == pytest.approx(30991, rel=1e-4)
