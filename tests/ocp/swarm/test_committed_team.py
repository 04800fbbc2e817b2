"""Vehicles of any model never meet, whatever is lost, and arrive."""

import itertools
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.ocp.swarm.committed_team import CommittedDecision, begin_as
from swarmstart.ocp.swarm.plans import no_plans
from swarmstart.tests.ocp.swarm.bodies import DISTANCE, Made, body, together, vehicle

LOSSY = ss.Links(most_delay=2, loss=0.3)
GOALS = [[4.0, 0.0], [-4.0, 0.0], [0.0, -4.0]]
STARTS = [[-4.0, 0.2], [4.0, 0.0], [0.0, 4.0]]
LINE = [[6.0], [-6.0]]


def starts_of(places: Sequence[Sequence[float]]) -> Array:
    return np.concatenate([[*place, *np.zeros(len(place))] for place in places])


@pytest.fixture(scope="module")
def three() -> list[Made]:
    return [vehicle(goal, 2) for goal in GOALS]


@pytest.fixture(scope="module")
def line() -> list[Made]:
    """Return two vehicles on a line, which cannot pass each other."""
    return [vehicle(goal, 1, intervals=8) for goal in LINE]


def team_of(made: Sequence[Made], **changes: Any) -> ss.CommittedTeam:
    options = {"sets": [one.near for one in made], "distance": DISTANCE, **changes}
    return ss.CommittedTeam(ss.Team([one.agent for one in made]), **options)


def flown(
    made: Sequence[Made],
    team: ss.CommittedTeam,
    x0: Array,
    *,
    steps: int = 60,
    seed: int = 0,
    push: Any = None,
) -> tuple[ss.Trajectory, CommittedDecision]:
    model = together([one.model for one in made], pushed=push is not None)
    plant = ss.Plant(model, dt=team.dt, substeps=8, parameters=push)
    run = ss.simulate(plant, team, x0, steps=steps, seed=seed)
    last = run.decisions[-1]
    assert isinstance(last, CommittedDecision)
    return run, last


def least(run: ss.Trajectory, vehicles: int) -> float:
    """Return the least distance on the fine path [m]."""
    path = run.dense_states.reshape(vehicles, 4, -1)[:, :2]
    pairs = itertools.combinations(path, 2)
    return min(float(np.linalg.norm(a - b, axis=0).min()) for a, b in pairs)


def verdict(text: str, folder: Path) -> str:
    """Return the last line of the independent checker."""
    file = folder / "flight.certificate.json"
    file.write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "swarmstart.terminal_set.check", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout.strip().splitlines()[-1]


@pytest.mark.parametrize("seed", range(3))
def test_three_cross_with_losses_and_the_checker_proves_their_distances(
    three: list[Made], seed: int, tmp_path: Path
) -> None:
    run, last = flown(
        three, team_of(three, links=LOSSY), starts_of(STARTS), steps=80, seed=seed
    )
    assert last.vehicles.have_arrived.all()
    ends = run.states[:, -1].reshape(3, 4)
    np.testing.assert_allclose(ends[:, :2], GOALS, atol=1e-3)
    assert least(run, 3) >= DISTANCE
    assert min(last.vehicles.apart) >= DISTANCE
    assert last.vehicles.tracking_error < 1e-9
    assert "no two of 3 vehicles" in verdict(last.vehicles.certificate(), tmp_path)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("delay", "loss"), [(3, 0.05), (6, 0.3)])
def test_from_random_starts_all_arrive_and_none_meet(
    three: list[Made], delay: int, loss: float, seed: int, tmp_path: Path
) -> None:
    team = team_of(three, links=ss.Links(most_delay=delay, loss=loss))
    rng = np.random.default_rng([7, seed])
    apart, starts = 0.0, np.empty((3, 2))
    while apart < 1.3 * DISTANCE:
        starts = rng.uniform(-5.0, 5.0, (3, 2))
        pairs = itertools.combinations(starts, 2)
        apart = min(float(np.linalg.norm(a - b)) for a, b in pairs)
    x0 = starts_of(starts.tolist())
    run, last = flown(three, team, x0, steps=120, seed=seed)
    assert last.vehicles.have_arrived.all()
    assert least(run, 3) >= DISTANCE
    assert "no two of 3 vehicles" in verdict(last.vehicles.certificate(), tmp_path)


def test_the_same_vehicles_would_meet_if_each_were_alone() -> None:
    paths = []
    for goal, start in zip(GOALS[:2], STARTS[:2], strict=True):
        alone = vehicle(goal, 0)
        run, _ = flown([alone], team_of([alone]), starts_of([start]), steps=40)
        paths.append(run.dense_states[:2])
    assert np.linalg.norm(paths[0] - paths[1], axis=0).min() < DISTANCE / 4


def test_the_same_seed_gives_the_same_flight(three: list[Made]) -> None:
    first, second = (
        flown(three, team_of(three, links=LOSSY), starts_of(STARTS), steps=12)[0].states
        for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)


def test_one_vehicle_ends_where_a_receding_horizon_ends() -> None:
    made = vehicle([4.0, 0.0], 0)
    run, last = flown([made], team_of([made]), starts_of([[-4.0, 0.2]]))
    assert last.vehicles.have_arrived.all()
    np.testing.assert_allclose(run.states[:2, -1], [4.0, 0.0], atol=1e-3)
    first, final = run.decisions[0].plans[0], run.decisions[-1].plans[0]
    assert first.source.name == "COMMITTED" and first.feasible
    assert final.source.name == "LINEAR" and run.decisions[-1].mode is ss.Mode.LINEAR


def test_who_is_silent_for_ever_stops_at_the_end_of_its_plan(
    three: list[Made],
) -> None:
    links = ss.Links(silences={0: (0.0, np.inf)})
    run, last = flown(three, team_of(three, links=links), starts_of(STARTS))
    assert not last.vehicles.have_arrived[0]
    assert np.abs(run.states[2:4, -1]).max() < 1e-2
    assert least(run, 3) >= DISTANCE


def test_who_has_rested_for_long_parts_from_its_rest(
    three: list[Made], tmp_path: Path
) -> None:
    # Vehicle 0 is not heard for longer than the plans of the start have samples.
    team = team_of(three, links=ss.Links(silences={0: (0.0, 20.0)}))
    far = starts_of([[-9.0, 0.2], [9.0, 0.0], [0.0, 9.0]])
    run, last = flown(three, team, far, steps=120)
    log = last.vehicles.log()
    assert log.parting[3] * team.dt > 20.0
    assert last.vehicles.have_arrived.all()
    assert least(run, 3) >= DISTANCE
    assert "no two of 3 vehicles" in verdict(last.vehicles.certificate(), tmp_path)


def test_a_plan_that_parts_from_a_rest_contains_the_path_in_its_tube() -> None:
    plans = no_plans(2, 4)
    plans.samples[0], plans.bulges[0] = 0.0, 0.1
    plans.samples[0, :, 0] = [5.0, 4.0, 3.0, 2.0, 1.5]
    plans.bulges[0, 4] = 0.02
    plans.first[1] = 3
    plans.samples[1], plans.bulges[1] = 0.0, 0.3
    plans.samples[1, :, 0] = [9.0, 9.0, 1.51, 1.0, 0.5]
    begin_as(1, 0, 2, plans)
    assert plans.samples[1, :, 0].tolist() == [2.0, 1.5, 1.5, 1.0, 0.5]
    np.testing.assert_allclose(plans.bulges[1], [0.1, 0.02, 0.31, 0.3, 0.3])


def test_pushed_vehicles_keep_the_distance_within_the_tracking_error(
    three: list[Made],
) -> None:
    def gusts(times: Array) -> Array:
        wave = 0.15 * np.sin(2.0 * times + np.arange(12)[:, None])
        return np.where((np.arange(12) % 4 >= 2)[:, None], wave, 0.0)

    team = team_of(three, links=LOSSY, tracking_error=0.2)
    assert team.plan_distance == DISTANCE + 0.4
    run, last = flown(three, team, starts_of(STARTS), push=gusts, steps=80)
    assert 0.01 < last.vehicles.tracking_error <= team.tracking_error
    assert least(run, 3) >= DISTANCE


def test_who_cannot_pass_waits(line: list[Made]) -> None:
    run, last = flown(line, team_of(line, links=LOSSY), starts_of([[-6.0], [6.0]]))
    path = run.dense_states.reshape(2, 2, -1)[:, 0]
    assert (path[1] - path[0]).min() >= DISTANCE
    assert not last.vehicles.have_arrived.all()
    # What saves nothing is not proposed again and again.
    assert len(last.vehicles.log().vehicle) < 10


def test_vehicles_that_start_too_near_are_named(line: list[Made]) -> None:
    with pytest.raises(ss.InvalidProblemError, match="starts of vehicles 0 and 1 must"):
        flown(line, team_of(line), starts_of([[0.0], [0.5]]))
    # Both move towards each other, and cannot stop in time.
    x0 = np.array([0.0, 3.0, 1.2, -3.0])
    with pytest.raises(ss.InvalidProblemError, match="first plan of vehicle 1 must be"):
        flown(line, team_of(line), x0)


def test_a_first_plan_that_ends_in_no_set_is_named() -> None:
    made = [vehicle(goal, 1, terminal=[], intervals=8) for goal in ([60.0], [-60.0])]
    with pytest.raises(ss.NoRestError, match="vehicle 0: a plan must end in"):
        flown(made, team_of(made), starts_of([[-60.0], [60.0]]))


def test_vehicles_beyond_the_range_of_all_others_are_named(line: list[Made]) -> None:
    links = ss.Links(radio_range=5.0)
    with pytest.raises(ss.InvalidProblemError, match="vehicles 0 and 1"):
        flown(line, team_of(line, links=links), starts_of([[-6.0], [6.0]]))


def test_decisions_of_others_and_old_ones_are_refused(line: list[Made]) -> None:
    team, x0 = team_of(line), starts_of([[-6.0], [6.0]])
    rng = np.random.default_rng(0)
    first = team.decide(0.0, x0, None, rng=rng)
    with pytest.raises(ss.InvalidProblemError, match="state must be finite"):
        team.decide(team.dt, np.where(x0 > 0, np.nan, x0), first, rng=rng)
    team.decide(team.dt, x0, first, rng=rng)
    with pytest.raises(ss.InvalidProblemError, match="of step 2, got that of step 1"):
        team.decide(team.dt, x0, first, rng=rng)
    other = ss.Decision(control=np.zeros(2), plans=())
    with pytest.raises(ss.InvalidProblemError, match="must be a CommittedDecision"):
        team.decide(team.dt, x0, other, rng=rng)


def uncertified(made: Made) -> ss.TerminalSet:
    near = made.near
    return ss.TerminalSet(
        K=near.K, P=near.P, alpha=near.alpha, x_ref=near.x_ref, u_ref=near.u_ref,
        dt=near.dt, design="user",
    )  # fmt: skip


def test_teams_that_do_not_fit_are_refused(line: list[Made]) -> None:
    one, two = line
    few = vehicle([6.0], 0, intervals=8)
    shown = ss.Agent(controller=one.agent.controller, shows=())
    hurried = ss.Agent(controller=replace(one.agent.controller, within=0.1), shows=(0,))
    cases: list[tuple[str, list[ss.Agent], dict[str, Any]]] = [
        ("a terminal set for each of the 2", [], {"sets": [one.near]}),
        ("certified for inputs held", [], {"sets": [uncertified(one), two.near]}),
        ("vehicles 0 to 1, got \\[2\\]", [], {"links": ss.Links(silences={2: (0, 1)})}),
        ("at least 3 signals", [few.agent, two.agent], {}),
        ("show 1 to 3 rows", [shown, two.agent], {}),
        ("expected within=None", [hurried, two.agent], {}),
        ("goals of vehicles 0 and 1 must be 1 m", [], {"sets": [one.near] * 2}),
    ]
    for match, agents, changes in cases:
        options = {"sets": [one.near, two.near], "distance": DISTANCE, **changes}
        with pytest.raises(ss.InvalidProblemError, match=match):
            ss.CommittedTeam(ss.Team(agents or [one.agent, two.agent]), **options)


def test_problems_that_decide_more_than_controls_are_refused(line: list[Made]) -> None:
    model = body(1)
    cost = model.states[0] ** 2
    problem = ss.OptimalControlProblem(
        model, horizon=ss.Free(0.5, 6.0), intervals=8, stage_cost=cost,
        bounds=ss.Bounds(controls=(-1, 1)), signals=ca.SX.sym("more"),
    )  # fmt: skip
    planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    loop = ss.RecedingHorizon(planner=planner, period=0.5)
    team = ss.Team([ss.Agent(controller=loop, shows=(0,))])
    with pytest.raises(ss.InvalidProblemError, match="without a free end time"):
        ss.CommittedTeam(team, sets=[line[0].near], distance=1.0)


def test_a_model_that_depends_on_signals_is_refused() -> None:
    x, v, u, s = (ca.SX.sym(name) for name in "xvus")
    windy = ss.Model(
        states=ca.vertcat(x, v), controls=u, ode=ca.vertcat(v, u + s), signals=s
    )
    made = vehicle([6.0], 0, body(1), intervals=8)
    problem = ss.OptimalControlProblem(
        windy, horizon=4.0, intervals=8, stage_cost=x**2 + u**2,
        bounds=ss.Bounds(controls=(-1, 1)), signals=ca.vertcat(s, ca.SX.sym("more")),
    )  # fmt: skip
    planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    agent = ss.Agent(controller=ss.RecedingHorizon(planner=planner), shows=(0,))
    with pytest.raises(ss.InvalidProblemError, match="signals or a time"):
        ss.CommittedTeam(ss.Team([agent]), sets=[made.near], distance=1.0)
