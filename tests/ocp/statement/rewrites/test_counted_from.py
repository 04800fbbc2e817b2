"""States counted from near: the same problem, from wherever its states are counted."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    CountedFrom,
    Free,
    InvalidProblemError,
    IpoptOptions,
    Known,
    Model,
    OpenLoop,
    OptimalControlProblem,
    Planner,
    Plant,
    RecedingHorizon,
    Solution,
    SolutionStatus,
    Start,
    TransportDelay,
    ensemble,
    phases,
    simulate,
    solve,
    table,
)
from swarmstart.ocp.rollout.fitness import core_known, replay
from swarmstart.ocp.statement.rewrites.chain import lowered
from swarmstart.ocp.statement.rewrites.counted_from import FAR, from_near
from swarmstart.tests.ocp.feature_pairs import features
from swarmstart.tests.ocp.feature_pairs.features import drawn

FAR_AWAY = 1e9


def reaching(origin: float, **changes: Any) -> OptimalControlProblem:
    """Return a double integrator that moves 1 m, a wall beside its way."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], u)),
        **{
            "horizon": 2.0,
            "intervals": 8,
            "stage_cost": u**2 + (x[0] - origin) ** 2,
            "terminal": [(x[0], origin + 1), (x[1], 0)],
            "constraints": [x[0] <= origin + 1.05],
            "bounds": Bounds(controls=(-4, 4)),
            **changes,
        },
    )


def solved(problem: OptimalControlProblem, x0: Any, **more: Any) -> Solution:
    return solve(problem, x0, search=None, lanes=0, seed=0, **more)


@pytest.mark.parametrize("name", features.FEATURES)
def test_rollouts_are_the_same_with_each_feature(name: str) -> None:
    stated = drawn((name,), np.random.default_rng(11))
    problem, known = stated.problem(), stated.known
    names, x0 = problem.model.state_names, stated.x0
    # A tied start is one number, so both of its states have one origin.
    numbers = {
        n: 0.75 if name == "tied start" else 0.5 + i for i, n in enumerate(names)
    }
    moved = replace(problem, features=(*problem.features, CountedFrom(numbers)))
    found = [_rolled(one, x0, known) for one in (problem, moved)]
    for here, there in zip(*found, strict=True):
        np.testing.assert_allclose(there, here, rtol=1e-9, atol=1e-9)


def _rolled(
    problem: OptimalControlProblem, x0: Array, known: Known
) -> tuple[Array, float, float]:
    """Return the stated problem's states, the cost and the violation."""
    pair, rng = lowered(problem), np.random.default_rng(3)
    lower, upper = (np.clip(side, -1.0, 1.0) for side in pair.core.control_limits)
    shape = (pair.core.model.nu, pair.core.intervals)
    controls = rng.uniform(lower[:, None], upper[:, None], shape)
    start = pair.start(x0, known.previous)
    states, cost, violation = replay(problem, controls, start, core_known(pair, known))
    return pair.as_stated(states)[: problem.model.nx], cost, violation


def test_number_near_the_states_cancels_before_it_is_rounded() -> None:
    x, p, s = ca.SX.sym("x"), ca.SX.sym("p"), ca.SX.sym("s")
    c = FAR_AWAY + 0.25
    problem = OptimalControlProblem(
        Model(states=x, controls=ca.SX.sym("u"), ode=ca.SX(0), parameters=p), signals=s,
        horizon=1.0, intervals=1, stage_cost=2 * (x / 4 - c / 4) - 3 * (c - x),
        terminal_cost=x - p, initial_cost=-(s - x) * 1e3 + 0 * p,
        constraints=[2 * x + 1 <= 2 * c + 2], features=[CountedFrom({"x": c})],
    )  # fmt: skip
    core = lowered(problem).core
    z = 1e-12
    values = ca.Function(
        "values", [*core.symbols().values()],
        [core.stage_cost, core.terminal_cost, core.initial_cost],
    )(z, 0, c + 1, c - 1)  # fmt: skip
    exact = (3.5 * z, z - 1, 1e3 * (z + 1))
    np.testing.assert_allclose([float(v) for v in values], exact, rtol=1e-15)
    (wall,) = core.stated
    assert wall.name == "(((2.*x)+1)<=2e+09)"
    np.testing.assert_array_equal(wall.rows(wall.expression).upper, [1.0])


def test_what_no_constant_cancels_is_computed_from_the_whole_state() -> None:
    x = ca.SX.sym("x")
    curve = table(np.linspace(-2, 2, 9), np.linspace(-2, 2, 9) ** 3)
    infinite = ca.fmin(x * np.inf, 3)
    problem = OptimalControlProblem(
        Model(states=x, controls=ca.SX.sym("u"), ode=ca.sin(x)), horizon=1.0,
        intervals=1, stage_cost=x**2 + ca.atan2(x, 2 - x), terminal_cost=infinite,
        initial_cost=curve(x), features=[CountedFrom({"x": 0.5})],
    )  # fmt: skip
    core = lowered(problem).core
    costs = []
    for one in (problem, core):
        outputs = [
            one.stage_cost, one.terminal_cost, one.initial_cost, one.model.ode
        ]  # fmt: skip
        costs.append(ca.Function("costs", [*one.symbols().values()], outputs))
    for value in (-1.25, 0.25, 1.5):
        plain, moved = costs[0](value, 0, 0, 0), costs[1](value - 0.5, 0, 0, 0)
        np.testing.assert_allclose(np.ravel(moved), np.ravel(plain), rtol=1e-14)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"horizon": Free(1.0, 4.0)},
        {"control_shape": "linear"},
        {"transcription": "radau"},
        {"features": [TransportDelay({"u": 0.25})]},
        {"checks": 3},
    ],
    ids=["plain", "end time", "linear controls", "radau", "delay", "checks"],
)
def test_answer_from_far_is_that_from_here(changes: Mapping[str, Any]) -> None:
    here = solved(reaching(0.0, **changes), [0.0, 0.0])
    there = solved(reaching(FAR_AWAY, **changes), [FAR_AWAY, 0.0])
    assert not any(isinstance(f, CountedFrom) for f in here.problem.features)
    assert isinstance(there.problem.features[-1], CountedFrom)
    assert there.status is here.status is SolutionStatus.CONVERGED
    assert there.cost == pytest.approx(here.cost, rel=1e-6)
    offset = np.array([[FAR_AWAY], [0.0]])
    for far, near in ((there, here), (there.path, here.path)):
        np.testing.assert_allclose(far.states[:2] - offset, near.states[:2], atol=1e-6)
    np.testing.assert_allclose(there.controls, here.controls, atol=1e-5)


def test_states_of_optima_guesses_and_messages_are_the_users() -> None:
    x0 = [FAR_AWAY, 0.0]
    found = solve(reaching(FAR_AWAY), x0, search=None, seed=0)
    assert found.optima
    guess = found.as_guess()
    assert guess.states is not None
    polished = found.optima[0].solution()
    optima = [one.states for one in found.optima]
    for states in (*optima, polished.states, guess.states):
        np.testing.assert_array_equal(states[:, 0], x0)
    assert "x_0 1e+09 to 1e+09" in repr(found)
    linear = found.linearised(1.0)
    np.testing.assert_array_equal(linear.A, [[0, 1], [0, 0]])


def test_guess_passes_between_problems_with_different_numbers() -> None:
    first, second = (
        reaching(FAR_AWAY, intervals=N, features=[CountedFrom({"x_0": c})])
        for N, c in ((8, FAR_AWAY - 100), (16, FAR_AWAY + 50))
    )
    x0 = [FAR_AWAY, 0.0]
    found = solved(first, x0)
    guess = found.as_guess(second)
    assert guess.states is not None
    every = np.interp(np.linspace(0, 1, 17), np.linspace(0, 1, 9), found.states[0])
    np.testing.assert_allclose(guess.states[0] - FAR_AWAY, every - FAR_AWAY, atol=1e-3)
    # Without an iteration the answer is the guess.
    again = solved(second, x0, guess=guess)
    assert again.status is SolutionStatus.CONVERGED


def test_decided_start_is_counted_as_its_bounds_are() -> None:
    answers = []
    for origin in (0.0, FAR_AWAY):
        start = {"x_0": Free(origin - 0.5, origin + 0.25, guess=origin)}
        more = {"initial_cost": 0, "start": start, "terminal_cost": 0}
        problem = reaching(origin, **more)
        answers.append((solved(problem, [np.nan, 0.0]), origin))
    (here, _), (there, _) = answers
    assert here.states[0, 0] == pytest.approx(0.25, abs=1e-6)
    assert there.states[0, 0] - FAR_AWAY == pytest.approx(0.25, abs=1e-6)
    planner = Planner(there.problem, search=None, polish=IpoptOptions())
    loop = OpenLoop(loop=RecedingHorizon(planner=planner))
    decision = loop.decide(
        0.0, np.array([FAR_AWAY, 0.0]), None, rng=np.random.default_rng(0)
    )
    assert decision.start is not None
    assert decision.start[0] - FAR_AWAY == pytest.approx(0.25, abs=1e-6)
    guess = there.as_guess()
    assert guess.decided["x_0"] - FAR_AWAY == pytest.approx(0.25, abs=1e-6)
    begin = guess._replace(x0=np.array([FAR_AWAY + 0.125, 0.0]))
    _, _, posed = planner.posed([FAR_AWAY, 0.0], guess=begin)
    assert isinstance(posed, Start)
    assert posed.x0 is not None
    pair = lowered(there.problem)
    np.testing.assert_array_equal(pair.as_stated(posed.x0), begin.x0)
    begun = pair.with_decided(pair.start([np.nan, 0.0]), {"x_0": FAR_AWAY - 0.25})
    np.testing.assert_array_equal(pair.as_stated(begun), [FAR_AWAY - 0.25, 0.0])
    again = solved(there.problem, [np.nan, 0.0], guess=guess)
    assert again.states[0, 0] - FAR_AWAY == pytest.approx(0.25, abs=1e-6)


def test_ensemble_from_far_is_that_from_here() -> None:
    x, u, k = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("k")
    costs = []
    for origin in (0.0, FAR_AWAY):
        one = OptimalControlProblem(
            Model(states=x, controls=u, ode=u - k * (x - origin), parameters=k),
            horizon=1.0, intervals=4, stage_cost=(x - origin - 1) ** 2 + u**2 / 10,
            bounds=Bounds(controls=(-9, 9)),
        )  # fmt: skip
        every = ensemble(one, {"k": [0.5, 2.0]}, risk="worst")
        costs.append(solved(every, [origin]).cost)
    assert costs[1] == pytest.approx(costs[0], rel=1e-6)


@pytest.mark.parametrize("away", [0.0, FAR_AWAY])
def test_closed_loop_is_the_same_also_from_far_away_of_its_number(away: float) -> None:
    """The number is that of the problem; the measured states may be anywhere."""
    runs = []
    for origin in (0.0, FAR_AWAY):
        counted = [CountedFrom({"x_0": origin + away})] if origin else []
        problem = reaching(origin, terminal=[], features=counted)
        planner = Planner(problem, search=None, polish=IpoptOptions())
        loop = RecedingHorizon(planner=planner)
        plant = Plant(problem.model, dt=problem.dt, substeps=4)
        run = simulate(plant, loop, [origin + 0.5, 0.2], steps=4, seed=0)
        runs.append((run.states - np.array([[origin], [0.0]]), run.controls))
    # From a number that is as far away, roundings are those of the states themselves.
    room = 1e-6 if away == 0 else 1e-4
    for here, there in zip(*runs, strict=True):
        np.testing.assert_allclose(there, here, atol=room)


def test_only_starts_far_from_zero_are_counted_from_near() -> None:
    problem, sizes = reaching(0.0), np.array([2.0, 3.0])
    assert from_near(problem, np.array([0.9 * FAR * 2, 5.0]), sizes) is problem
    near = from_near(problem, np.array([1.1 * FAR * 2, -2 * FAR * 3]), sizes)
    (feature,) = near.features
    assert isinstance(feature, CountedFrom)
    for (number, x), size in zip(
        zip(feature.numbers.values(), (2.2 * FAR, -6 * FAR), strict=True), sizes,
        strict=True,
    ):  # fmt: skip
        assert abs(number - x) <= 128 * size
    # Starts beside each other have one compiled problem.
    beside = from_near(problem, np.array([1.1 * FAR * 2 + 1, -2 * FAR * 3]), sizes)
    assert beside.features == near.features
    stated = replace(problem, features=[CountedFrom({"x_0": 3.0})])
    assert from_near(stated, np.array([9 * FAR, 0.0]), sizes) is stated


def test_bound_is_that_of_the_problem_counted_from_zero() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4,
        stage_cost=x**2 + u**2, bounds=Bounds(controls=(-2, 2), states=(-2, 2)),
    )  # fmt: skip
    counted = replace(problem, features=[CountedFrom({"x": 0.5})])
    bounds = [solved(one, [1.0], bound=0.2).bound for one in (problem, counted)]
    assert bounds[0] is not None
    assert bounds[1] is not None
    assert bounds[1].kind is bounds[0].kind
    assert bounds[1].value == pytest.approx(bounds[0].value, rel=0.05)


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({"y": 1.0}, "must name states, some of x_0, x_1, got y"),
        ({"x_0": np.inf}, "number of 'x_0' must be finite, got inf"),
        ([1.0, 2.0], "must be a mapping of states to numbers"),
    ],
)
def test_wrong_numbers_are_refused(numbers: Any, words: str) -> None:
    with pytest.raises(InvalidProblemError, match=words):
        reaching(0.0, features=[CountedFrom(numbers)])


def test_states_with_one_start_need_one_number() -> None:
    start = {("x_0", "x_1"): Free(-1.0, 1.0)}
    reaching(0.0, start=start, features=[CountedFrom({"x_0": 2.0, "x_1": 2.0})])
    with pytest.raises(InvalidProblemError, match="from one number: x_0, x_1"):
        reaching(0.0, start=start, features=[CountedFrom({"x_0": 2.0})])


def test_joined_phases_are_refused() -> None:
    joined = phases([reaching(0.0, terminal=[]), reaching(0.0)]).problem
    with pytest.raises(InvalidProblemError, match="does not go with joined phases"):
        replace(joined, features=[CountedFrom({"x_0": 2.0})])
