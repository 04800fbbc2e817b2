"""Local teams: which agents are seen, in which signal rows, by which planner."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.heuristics import Budget, DifferentialEvolution, feasibility_first
from swarmstart.ocp import (
    Agent,
    Bounds,
    Controller,
    Decision,
    InvalidProblemError,
    Known,
    LocalAgent,
    LocalTeam,
    Model,
    OptimalControlProblem,
    Plan,
    Planner,
    Plant,
    RecedingHorizon,
    SearchSettings,
    Separation,
    Source,
    Start,
    Team,
    simulate,
    stack_models,
)
from swarmstart.ocp.common.presentation import ProgressCallback, tell_nothing
from swarmstart.ocp.loop.local_team import FAR
from swarmstart.ocp.rollout.fitness import NOTHING

EVERYWHERE = np.inf


class Told(NamedTuple):
    """Arguments of a planner for one plan."""

    x0: list[float]
    parameters: list[float]
    rows: list[list[float]]
    candidates: Array | None


class Recorded(Planner):
    """A planner that records its arguments and adds a push to the guess, if any."""

    def __init__(self, problem: OptimalControlProblem, push: float) -> None:
        super().__init__(problem, search=None)
        self.push = push
        self.told: list[Told] = []

    def plan(  # noqa: PLR0913 - as in Planner
        self,
        x0: ArrayLike,
        *,
        known: Known = NOTHING,
        guess: Array | Start | None = None,
        candidates: Array | None = None,
        near: bool = False,
        last_cost: float | None = None,
        in_loop: bool = False,
        is_new: bool = False,
        rng: np.random.Generator,
        progress: ProgressCallback = tell_nothing,
    ) -> Plan:
        del near, last_cost, in_loop, is_new, progress
        start, parameters, rows = (
            np.asarray(part).tolist() for part in (x0, *known[:2])
        )
        self.told.append(Told(start, parameters, rows, candidates))
        given = guess.controls if isinstance(guess, Start) else guess
        controls = np.zeros((1, 2)) if given is None else given
        return self.evaluated(
            controls + self.push, x0, known=known, source=Source.GUESS
        )


def recorded(
    model: Model, *, links: int = 0, room: int, push: float = 0.0, shown: int = 1
) -> Recorded:
    """A planner with signals for a state, links and others, with `shown` rows each."""
    told = replace(model, parameters=ca.SX.sym("p"))
    signals = ca.SX.sym("signals", 2 + shown * (links + room))
    problem = OptimalControlProblem(told, horizon=1.0, intervals=2, signals=signals)
    return Recorded(problem, push)


def at_rest(place: float) -> Any:
    """Return a reference that stays at a place."""
    return lambda times: np.stack([place + 0 * times, 0 * times])


def local_team(
    agents: Sequence[LocalAgent], planners: Mapping[int, Planner], **how: Any
) -> LocalTeam:
    whole: dict[str, Any] = {
        "order": range(len(agents)),
        "range": EVERYWHERE,
        "position": (0,),
    }
    return LocalTeam(agents, planners=planners, **(whole | how))


def members(count: int, **links: tuple[int, ...]) -> list[LocalAgent]:
    """Agents whose parameter is their number; the first has a reference."""
    return [
        LocalAgent(
            parameters=[float(i)],
            links=links.get(f"of_{i}", ()),
            reference=at_rest(-7.0) if i == 0 else None,
        )
        for i in range(count)
    ]


def decided(team: Controller, states: ArrayLike, time: float = 0.0) -> Decision:
    state = np.ravel(np.asarray(states, dtype=np.float64))
    return team.decide(time, state, None, rng=np.random.default_rng(0))


def test_signals_are_the_leaders_plan_the_links_and_those_before_in_order(
    double_integrator: Model,
) -> None:
    planner = recorded(double_integrator, links=2, room=3)
    agents = members(4, of_3=(0,), of_1=(3, 0), of_2=(1,))
    team = local_team(agents, {3: planner}, order=(0, 3, 1, 2), links=2)
    decided(team, [[0, 1], [10, 2], [20, 3], [30, 4]])
    assert [told.parameters for told in planner.told] == [[0], [3], [1], [2]]
    assert [told.x0 for told in planner.told] == [[0, 1], [30, 4], [10, 2], [20, 3]]
    # x + v t at 0, 0.5 and 1 s: no agent accelerates.
    leader, far = [[0, 0.5, 1], [1, 1, 1]], [FAR] * 3
    zero, one, three = leader[0], [10, 11, 12], [30, 32, 34]
    assert [told.rows for told in planner.told] == [
        [[-7, -7, -7], [0, 0, 0], far, far, far, far, far],
        [*leader, zero, far, zero, far, far],
        [*leader, three, zero, zero, three, far],
        [*leader, one, far, zero, three, one],
    ]


def test_those_out_of_range_are_not_seen_and_the_smallest_planner_is_taken(
    double_integrator: Model,
) -> None:
    planners = {k: recorded(double_integrator, room=k) for k in (1, 2, 4)}
    team = local_team(members(5), planners, range=5.0)
    decided(team, [0, 0, 5, 0, 9, 0, 4.5, 0, 100, 0])
    others = {
        told.parameters[0]: (room, [row[0] for row in told.rows[2:]])
        for room, planner in planners.items()
        for told in planner.told
    }
    assert others == {
        0: (1, [FAR]),
        1: (1, [0]),  # at the very range
        2: (1, [5]),  # 9 m from the first: out of it
        3: (4, [0, 5, 9, FAR]),  # three in range
        4: (1, [FAR]),
    }


@settings(deadline=None)
@given(
    st.lists(st.tuples(*[st.floats(-50, 50)] * 4), min_size=2, max_size=12),
    st.floats(1, 40),
)
def test_who_is_within_range_is_whom_a_double_loop_finds(
    double_integrator: Model,
    places: list[tuple[float, float, float, float]],
    reach: float,
) -> None:
    """Plans from one place to another; being near at either end counts."""
    number = len(places) // 2
    shown = {j: np.reshape(place, (2, 2)) for j, place in enumerate(places)}
    apart = {
        j: min(float(np.hypot(*(plan - shown[number])[:, k])) for k in (0, 1))
        for j, plan in shown.items()
    }
    assume(min(abs(distance - reach) for distance in apart.values()) > 1e-9)
    planners = {11: crowded(double_integrator)}
    team = local_team(members(len(places)), planners, range=reach, position=(0, 1))
    states = np.array([plan[:, 0] for plan in shown.values()])
    expected = [j for j in shown if apart[j] <= reach and j != number]
    assert team.within_range(shown, states, number) == expected
    assert team.within_range({number: shown[number]}, states, number) == []
    # An agent without a last plan is assumed to stay.
    del shown[number]
    still = [
        np.hypot(*(plan - states[number][:, None])).min() for plan in shown.values()
    ]
    assume(min(abs(distance - reach) for distance in still) > 1e-9)
    seen = [j for j, distance in zip(shown, still, strict=True) if distance <= reach]
    assert team.within_range(shown, states, number) == seen


@functools.cache
def crowded(model: Model) -> Recorded:
    return recorded(model, room=11, shown=2)


def test_links_are_seen_out_of_range_too(double_integrator: Model) -> None:
    planner = recorded(double_integrator, links=1, room=1)
    team = local_team(members(2, of_1=(0,)), {1: planner}, range=5.0, links=1)
    decided(team, [[0, 1], [30, 0]])
    assert planner.told[-1].rows[2:] == [[0, 0.5, 1], [FAR] * 3]


def test_references_are_at_absolute_times(double_integrator: Model) -> None:
    planner = recorded(double_integrator, room=2)
    agents = [
        LocalAgent(parameters=[0.0], reference=lambda t: np.stack([3 * t, 0 * t + 3])),
        LocalAgent(parameters=[0.0], reference=lambda t: np.stack([-t, 0 * t - 1])),
        LocalAgent(parameters=[0.0]),
    ]
    team = local_team(agents, {2: planner})
    assert team.dt == 0.5
    decided(team, np.zeros((3, 2)), time=4.0)
    assert [told.rows[:2] for told in planner.told] == [
        [[12, 13.5, 15], [3, 3, 3]],
        [[-4, -4.5, -5], [-1, -1, -1]],
        [[0, 0, 0], [0, 0, 0]],  # the first one's plan, not its reference
    ]


def test_candidates_are_passed_on_to_their_own_search_only(
    double_integrator: Model,
) -> None:
    planner = recorded(double_integrator, room=1)
    looked_at = np.ones((1, 2, 3))
    agents = [*members(1), LocalAgent(parameters=[1.0], candidates=looked_at)]
    decided(local_team(agents, {1: planner}), np.zeros((2, 2)))
    first, second = planner.told
    assert first.candidates is None
    np.testing.assert_array_equal(second.candidates, looked_at)


def planned(planner: Planner, *controls: Sequence[float]) -> Decision:
    """Return a decision whose plans have these controls."""
    problem = planner.problem
    known = Known([0.0], np.zeros((problem.ns, problem.nodes)))
    plans = tuple(
        planner.evaluated(np.array([row]), [0, 0], known=known, source=Source.GUESS)
        for row in controls
    )
    return Decision(control=np.array([row[0] for row in controls]), plans=plans)


def test_every_agent_goes_on_from_its_own_last_plan_with_its_end_held(
    double_integrator: Model,
) -> None:
    planner = recorded(double_integrator, room=1)
    team = local_team(members(2), {1: planner})
    previous = planned(planner, [1.0, 2.0], [3.0, 4.0])
    decision = team.decide(0.5, np.zeros(4), previous, rng=np.random.default_rng(0))
    assert [p.controls.tolist() for p in decision.plans] == [[[2, 2]], [[4, 4]]]
    assert decision.control.tolist() == [2, 4]


def test_of_those_who_plan_later_the_last_plans_are_seen_shifted(
    double_integrator: Model,
) -> None:
    planner = recorded(double_integrator, room=2, push=1.0)
    team = local_team(members(3), {2: planner}, order=(0, 2, 1), range=50.0)
    previous = planned(planner, [9.0, 0.0], [9.0, 4.0], [9.0, -8.0])
    states = np.array([0.0, 1, 20, 2, -40, 3])
    team.decide(0.5, states, previous, rng=np.random.default_rng(0))
    assert [told.x0 for told in planner.told] == [[0, 1], [-40, 3], [20, 2]]
    # From the present states, x + v t + a t^2 / 2 at 0, 0.5 and 1 s: a = 4 and -8 if
    # the last plan continues, and 1 more than 0 in the first one's new plan.
    one, two, fresh = [20, 21.5, 24], [-40, -39.5, -41], [0, 0.625, 1.5]
    assert [told.rows[2:] for told in planner.told] == [
        [one, two],
        [fresh, [FAR] * 3],  # 60 m from the second
        [fresh, [FAR] * 3],
    ]


# --- the same as a team of ocp.Team in which all agents see each other

SLOTS = np.array([[0.0, 0], [-4, 4], [-4, -4], [-8, 0]])
STARTS = np.array([[0.0, 0], [-4, -4], [-8, 0], [-4, 4]])
ORDER, LINKS = (0, 2, 1, 3), {2: 0, 1: 2, 3: 1}
PLANE = (0, 1)


def leaders_way(times: Array) -> Array:
    return np.stack([times, 0 * times])


def point_planner(room: int) -> Planner:
    """A planner of a point (x' = u) to its slot, away from the others."""
    x, u, slot = ca.SX.sym("x", 2), ca.SX.sym("u", 2), ca.SX.sym("slot", 2)
    leader, link = ca.SX.sym("leader", 2), ca.SX.sym("link", 2)
    others = [ca.SX.sym(f"other{k}", 2) for k in range(room)]
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u, parameters=slot),
        horizon=2.0,
        intervals=2,
        stage_cost=ca.sumsqr(x - leader - slot) + 1e-6 * ca.sumsqr(x - link),
        bounds=Bounds(controls=(-3, 3)),
        constraints=[
            Separation(relative=x - other, distance=1.0, along="segments")
            for other in others
        ],
        signals=ca.vertcat(leader, link, *others),
        quadrature="right",
        checks=4,
        substeps=1,
    )
    search = SearchSettings(
        algorithm=DifferentialEvolution(size=20), budget=Budget(evaluations=600),
        order=feasibility_first(),
    )  # fmt: skip
    return Planner(problem, search=search)


@functools.cache
def point_planners() -> dict[int, Planner]:
    return {room: point_planner(room) for room in range(4)}


def local_points() -> LocalTeam:
    agents = [
        LocalAgent(
            parameters=slot,
            links=(LINKS[i],) if i else (),
            reference=None if i else leaders_way,
        )
        for i, slot in enumerate(SLOTS)
    ]
    return LocalTeam(
        agents, planners=point_planners(), order=ORDER, range=EVERYWHERE,
        position=PLANE, links=1,
    )  # fmt: skip


def team_points() -> Team:
    """Return the same four agents, each of which watches all that plan before it."""

    def with_nobody(times: Array) -> Array:
        """The leader's signals in a team: its path, and an unused link."""
        return np.vstack([leaders_way(times), np.full((2, times.size), FAR)])

    def agent(i: int, slot: Array) -> Agent:
        place = ORDER.index(i)
        controller = RecedingHorizon(
            planner=point_planners()[place],
            reference=None if i else with_nobody,
            parameters=lambda time: slot,
            append="last",
        )
        watches = (0, LINKS[i], *ORDER[:place]) if i else ()
        return Agent(controller=controller, watches=watches, shows=PLANE)

    return Team([agent(i, slot) for i, slot in enumerate(SLOTS)], order=ORDER)


def test_the_first_plans_with_room_and_range_for_all_are_a_teams_bit_for_bit() -> None:
    local, team = local_points(), team_points()
    rng = np.random.default_rng(0)
    for seed in range(3):
        state = STARTS.ravel() + rng.normal(size=8)
        one, other = (
            controller.decide(2.0, state, None, rng=np.random.default_rng(seed))
            for controller in (local, team)
        )
        assert np.array_equal(one.control, other.control)
        for mine, theirs in zip(one.plans, other.plans, strict=True):
            assert np.array_equal(mine.controls, theirs.controls)
            assert np.array_equal(mine.states, theirs.states)
            assert (mine.cost, mine.violation) == (theirs.cost, theirs.violation)


def test_they_arrive_apart_from_each_other() -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 2)
    plant = stack_models([Model(states=x, controls=u, ode=u)] * 4)
    flown = simulate(
        Plant(plant, dt=1.0, substeps=4), local_points(), STARTS.ravel(), steps=4,
        rng=np.random.default_rng(0),
    )  # fmt: skip
    end = flown.states[:, -1].reshape(4, 2)
    assert np.abs(end - end[0] - SLOTS).max() < 0.1
    positions = flown.dense_states.reshape(4, 2, -1)
    apart = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    assert apart[np.triu_indices(4, 1)].min() >= 1.0 - 1e-9


def test_short_sight_makes_no_difference_to_those_who_are_far_apart(
    double_integrator: Model,
) -> None:
    planners = {k: recorded(double_integrator, room=k) for k in (1, 3)}
    far_apart = [[0, 1], [100, 2], [200, 3], [300, 4]]
    near, wide = (
        decided(local_team(members(4), planners, range=reach), far_apart)
        for reach in (10.0, EVERYWHERE)
    )
    assert np.array_equal(near.control, wide.control)
    assert len(planners[1].told) == 4 + 2  # all, and the first two of those who see


# --- errors


def test_refuses_an_order_that_is_none(double_integrator: Model) -> None:
    planners = {1: recorded(double_integrator, room=1)}
    for order in ((0,), (0, 0), (1, 2)):
        with pytest.raises(
            InvalidProblemError,
            match=r"^order must name each of the 2 agents once, got",
        ):
            local_team(members(2), planners, order=order)
    with pytest.raises(InvalidProblemError, match="each of the 0 agents once"):
        local_team([], planners)


def test_refuses_a_link_to_who_plans_later(double_integrator: Model) -> None:
    planners = {2: recorded(double_integrator, links=1, room=2)}
    with pytest.raises(
        InvalidProblemError, match=r"^agent 1 is linked to \[2\], who plan after it$"
    ):
        local_team(members(3, of_1=(2,)), planners, links=1)


def test_refuses_more_links_than_there_are_signals_for(
    double_integrator: Model,
) -> None:
    planners = {2: recorded(double_integrator, links=1, room=2)}
    with pytest.raises(
        InvalidProblemError,
        match=r"^agent 2 must have at most 1 links, got \(0, 1\)$",
    ):
        local_team(members(3, of_2=(0, 1)), planners, links=1)


def test_refuses_a_first_planner_that_follows_nobody(double_integrator: Model) -> None:
    planners = {1: recorded(double_integrator, room=1)}
    with pytest.raises(
        InvalidProblemError, match=r"^agent 1, the first planner, needs a reference$"
    ):
        local_team(members(2), planners, order=(1, 0))


def test_refuses_planners_without_room_for_all(double_integrator: Model) -> None:
    planners = {k: recorded(double_integrator, room=k) for k in (1, 2)}
    said = r"^one planner needs room for all 3 others, got \[1, 2\]$"
    with pytest.raises(InvalidProblemError, match=said):
        local_team(members(4), planners)
    with pytest.raises(InvalidProblemError, match=r"all 1 others, got \[\]$"):
        local_team(members(2), {})


def test_refuses_a_planner_with_other_signals(double_integrator: Model) -> None:
    planners = {2: recorded(double_integrator, room=3)}
    with pytest.raises(
        InvalidProblemError,
        match=r"^the planner for 2 others must have 4 signals, got 5$",
    ):
        local_team(members(3), planners)
    with pytest.raises(InvalidProblemError, match=r"must have 6 signals, got 5$"):
        local_team(members(3), planners, links=2)


def test_refuses_planners_on_different_grids(double_integrator: Model) -> None:
    small, large = (recorded(double_integrator, room=room) for room in (1, 2))
    finer = replace(large.problem, checks=2)
    with pytest.raises(InvalidProblemError, match="planners must share intervals"):
        local_team(members(3), {1: small, 2: Recorded(finer, 0.0)})
