"""Teams: the order of planning, and the plans that each agent sees."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Agent,
    Bounds,
    InvalidProblemError,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    Plan,
    Planner,
    RecedingHorizon,
    Source,
    Team,
)


def agent_of(
    model: Model,
    *,
    watches: tuple[int, ...] = (),
    intervals: int = 2,
    checks: int = 1,
    polish: bool = False,
    shows: tuple[int, ...] = (0,),
) -> Agent:
    """An agent whose target is the end position of the agents that it watches."""
    signals = ca.SX.sym("others", len(watches))
    problem = OptimalControlProblem(
        model,
        horizon=0.5 * intervals,
        intervals=intervals,
        terminal_cost=sum(
            ((model.states[0] - s) ** 2 for s in ca.vertsplit(signals)), ca.SX(0)
        )
        if watches
        else ca.SX(0),
        bounds=Bounds(controls=(-20, 20)),
        signals=signals,
        checks=checks,
    )
    planner = Planner(problem, search=None, polish=IpoptOptions() if polish else None)
    return Agent(
        controller=RecedingHorizon(planner=planner), watches=watches, shows=shows
    )


def test_agents_plan_in_order_and_see_fresh_plans(double_integrator: Model) -> None:
    watches = ((1, 2), (2,), ())
    agents = [agent_of(double_integrator, watches=w) for w in watches]
    team = Team(agents, order=(2, 1, 0))
    calls: list[tuple[int, list[float], list[list[float]]]] = []

    def make(number: int, own: Array, seen: tuple[Array, ...]) -> Plan:
        calls.append((number, own.tolist(), [row.ravel().tolist() for row in seen]))
        known = agents[number].controller.known(0.0, seen)
        return agents[number].controller.planner.evaluated(
            np.full((1, 2), float(number)), own, known=known, source=Source.GUESS
        )

    plans = team.plans(np.array([10.0, 1, 20, 2, 30, 3]), make)
    # x + v t + a t^2 / 2 at 0, 0.5 and 1 s, the acceleration being the number.
    second, first = [20, 21.125, 22.5], [30, 31.75, 34]
    assert calls == [
        (2, [30, 3], []),
        (1, [20, 2], [first]),
        (0, [10, 1], [second, first]),
    ]
    assert [plan.controls[0, 0] for plan in plans] == [0, 1, 2]


@pytest.mark.parametrize("watches", [(0, 1), (1, 0)])
def test_plans_are_seen_in_the_order_of_watches(
    double_integrator: Model, watches: tuple[int, int]
) -> None:
    """The signals follow `watches`, not the order of planning or of numbers."""
    agents = [
        *(agent_of(double_integrator) for _ in range(2)),
        agent_of(double_integrator, watches=watches),
    ]
    told: list[list[float]] = []

    def make(number: int, own: Array, seen: tuple[Array, ...]) -> Plan:
        told.append([float(states[0, 0]) for states in seen])
        known = agents[number].controller.known(0.0, seen)
        return agents[number].controller.planner.evaluated(
            np.zeros((1, 2)), own, known=known, source=Source.GUESS
        )

    Team(agents, order=(1, 0, 2)).plans(np.array([10.0, 0, 20, 0, 30, 0]), make)
    assert told == [[], [], [[10.0, 20.0][number] for number in watches]]


def test_watcher_meets_the_plan_made_at_the_same_instant(
    double_integrator: Model,
) -> None:
    watcher = agent_of(double_integrator, watches=(1,), polish=True)
    team = Team([watcher, agent_of(double_integrator)], order=(1, 0))
    decision = team.decide(
        0.0, np.array([0.0, 0, 2, -1]), None, rng=np.random.default_rng(0)
    )
    mine, other = decision.plans
    assert other.states[0, -1] == pytest.approx(1.0)
    assert mine.states[0, -1] == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_array_equal(
        decision.control, [mine.controls[0, 0], other.controls[0, 0]]
    )


def test_watcher_sees_the_rows_that_the_other_shows(double_integrator: Model) -> None:
    """Each agent chooses the rows that it shows: here its speed; the watcher none."""
    shy = agent_of(double_integrator, watches=(1,), polish=True, shows=())
    team = Team([shy, agent_of(double_integrator, shows=(1,))], order=(1, 0))
    decision = team.decide(
        0.0, np.array([0.0, 0, 2, -0.5]), None, rng=np.random.default_rng(0)
    )
    assert decision.plans[0].states[0, -1] == pytest.approx(-0.5, abs=1e-6)


def test_every_agent_goes_on_from_its_own_last_plan(double_integrator: Model) -> None:
    agents = [agent_of(double_integrator) for _ in range(2)]
    team, state = Team(agents, order=(1, 0)), np.zeros(4)
    controls = [np.array([[1.0, 2]]), np.array([[3.0, 4]])]
    plans = team.plans(
        state,
        lambda number, own, seen: agents[number].controller.planner.evaluated(
            controls[number], own, source=Source.GUESS
        ),
    )
    first = team.decide(0.0, state, None, rng=np.random.default_rng(0))
    assert first.control.tolist() == [0, 0]
    previous = type(first)(control=first.control, plans=plans)
    decision = team.decide(0.5, state, previous, rng=np.random.default_rng(0))
    assert [p.controls.tolist() for p in decision.plans] == [[[2, 0]], [[4, 0]]]


def test_state_is_split_by_the_models_sizes(
    double_integrator: Model, unicycle: Model
) -> None:
    team = Team([agent_of(double_integrator), agent_of(unicycle)], order=(0, 1))
    parts = team.split(np.arange(6.0))
    assert [part.tolist() for part in parts] == [[0, 1], [2, 3, 4, 5]]


def test_intervals_equal_but_for_rounding_are_shared(double_integrator: Model) -> None:
    """0.5 * 3 / 3 and the like need not agree in the last bit."""
    agents = []
    for horizon, intervals in ((0.1, 1), (0.7, 7)):
        problem = OptimalControlProblem(
            double_integrator, horizon=horizon, intervals=intervals
        )
        planner = Planner(problem, search=None)
        agents.append(Agent(controller=RecedingHorizon(planner=planner)))
    assert agents[0].controller.dt != agents[1].controller.dt
    assert Team(agents, order=(0, 1)).dt == pytest.approx(0.1)


def test_agents_plan_in_their_own_order_by_default(double_integrator: Model) -> None:
    agents = [agent_of(double_integrator), agent_of(double_integrator)]
    assert Team(agents).order == (0, 1)


def test_refuses_an_order_that_is_invalid(double_integrator: Model) -> None:
    agents = [agent_of(double_integrator), agent_of(double_integrator)]
    for order in ((0,), (0, 0), (1, 2)):
        with pytest.raises(InvalidProblemError, match="each of the 2 agents once"):
            Team(agents, order=order)
    with pytest.raises(InvalidProblemError, match="each of the 0 agents once"):
        Team([], order=())


def test_refuses_to_watch_who_plans_later(double_integrator: Model) -> None:
    agents = [agent_of(double_integrator, watches=(1,)), agent_of(double_integrator)]
    with pytest.raises(InvalidProblemError, match=r"agent 0 watches \[1\], who plan"):
        Team(agents, order=(0, 1))


def test_refuses_plans_on_another_grid(double_integrator: Model) -> None:
    finer = agent_of(double_integrator, checks=2)
    watcher = agent_of(double_integrator, watches=(0,))
    with pytest.raises(InvalidProblemError, match="plans have 5 nodes; its own have 3"):
        Team([finer, watcher], order=(0, 1))


def test_refuses_control_intervals_that_differ(double_integrator: Model) -> None:
    x = OptimalControlProblem(double_integrator, horizon=3.0, intervals=3)
    slow = Agent(controller=RecedingHorizon(planner=Planner(x, search=None)))
    with pytest.raises(InvalidProblemError, match="one control interval, got"):
        Team([slow, agent_of(double_integrator)], order=(0, 1))
