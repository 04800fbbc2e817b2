"""Pickling and copying of objects with expressions."""

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.ocp.rollout.shooting import shooting_of
from swarmstart.tests.ocp.feature_pairs.features import FEATURES, drawn


def again(thing: Any) -> Any:
    return pickle.loads(pickle.dumps(thing))


def pendulum(kind: Any = ca.SX) -> ss.OptimalControlProblem:
    """Return a swing-up, whose optimum depends on model, cost and constraints."""
    x, u, p = kind.sym("x", 2), kind.sym("u"), kind.sym("p")
    model = ss.Model(
        states=x, controls=u, parameters=p, ode=ca.vertcat(x[1], u - p * ca.sin(x[0])),
        outputs={"height": -ca.cos(x[0])},
    )  # fmt: skip
    return ss.OptimalControlProblem(
        model, horizon=1.5, intervals=10, stage_cost=u**2 + x[1] ** 2,
        bounds=ss.Bounds(controls=(-9, 9)), terminal=[(x[0], 1.5)],
        constraints=[ss.PathConstraint(expression=x[1] + u / 9, upper=2.0)],
    )  # fmt: skip


def controls_of(problem: ss.OptimalControlProblem) -> Array:
    known = ss.Known(parameters=[9.81])
    found = ss.solve(
        problem, [0, 0], known=known, search=None, lanes=0, repair=False, seed=0
    )
    return found.controls


def values(problem: ss.OptimalControlProblem) -> list[Array]:
    """Return cost and violation at drawn arguments."""
    rollout, rng = shooting_of(problem).rollout, np.random.default_rng(0)
    arguments = [0.5 + rng.random(rollout.size_in(i)) for i in range(rollout.n_in())]
    return [np.array(value) for value in rollout.call(arguments)]


@pytest.mark.parametrize("feature", FEATURES)
def test_a_problem_with_any_feature_has_the_same_values_again(feature: str) -> None:
    problem = drawn((feature,), np.random.default_rng(3)).problem()
    for other in (again(problem), copy.deepcopy(problem)):
        assert repr(other) == repr(problem)
        np.testing.assert_array_equal(values(other), values(problem))


@pytest.mark.parametrize("kind", [ca.SX, ca.MX])
@pytest.mark.parametrize("copied", [again, copy.copy, copy.deepcopy])
def test_a_problem_has_the_same_answer_again(kind: Any, copied: Any) -> None:
    problem = pendulum(kind)
    _ = controls_of(problem)  # Its functions and planners are kept, and left behind.
    assert problem.kept
    other = copied(problem)
    assert not other.kept
    np.testing.assert_array_equal(controls_of(other), controls_of(problem))


def test_copies_have_the_symbols_of_the_original_and_loaded_ones_their_own() -> None:
    model = pendulum().model
    for copied in (copy.copy(model), copy.deepcopy(model)):
        assert ca.is_equal(copied.ode, model.ode, 9)
        assert copied.outputs.keys() == {"height"}
    own = again(model)
    assert not ca.depends_on(own.ode, model.states)
    assert ca.depends_on(own.ode, own.states)


def test_problems_that_share_a_model_share_it_again() -> None:
    problem = pendulum()
    longer = ss.phases([problem_without_parameters(), problem_without_parameters()])
    both = again([problem, problem.model, problem, longer])
    assert both[0] is both[2]
    assert both[3].start([0.0]).tolist() == longer.start([0.0]).tolist()


def problem_without_parameters() -> ss.OptimalControlProblem:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    return ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u), horizon=0.5, intervals=2,
        stage_cost=u**2, bounds=ss.Bounds(controls=(-4, 4)), terminal=[(x, 1)],
    )  # fmt: skip


def test_contexts_of_casadi_that_a_user_has_opened_stay_open() -> None:
    problem, x = pendulum(), ca.SX.sym("x")
    with ca.global_pickle_context():
        pickled = pickle.dumps([x, problem, x**2])
    with ca.global_unpickle_context():
        own, loaded, square = pickle.loads(pickled)
    assert ca.is_equal(ca.substitute(square, own, ca.SX(3)), ca.SX(9), 9)
    np.testing.assert_array_equal(values(loaded), values(problem))


def test_threads_pickle_at_once() -> None:
    problems = [pendulum() for _ in range(8)]
    expected = values(problems[0])
    with ThreadPoolExecutor(4) as pool:
        for loaded in pool.map(again, problems * 4):
            np.testing.assert_array_equal(values(loaded), expected)


def test_a_problem_is_pickled_while_it_is_solved() -> None:
    seen: list[bytes] = []
    problem = pendulum()

    def progress(done: int, of: int, what: str) -> None:
        seen.append(pickle.dumps(problem))

    ss.solve(
        problem, [0, 0], known=ss.Known(parameters=[9.81]), lanes=0, seed=0,
        search=ss.SearchSettings(
            algorithm=ss.DifferentialEvolution(), when="always",
            budget=ss.Budget(evaluations=500),
        ),
        progress=progress,
    )  # fmt: skip
    assert seen
    np.testing.assert_array_equal(values(pickle.loads(seen[-1])), values(problem))


@pytest.mark.parametrize("left", [0.1, 0.5, 0.9])
def test_bytes_that_are_cut_off_are_refused(left: float) -> None:
    pickled = pickle.dumps(pendulum())
    with pytest.raises((pickle.UnpicklingError, EOFError)):
        pickle.loads(pickled[: int(left * len(pickled))])


def test_what_a_user_has_changed_after_the_call_is_not_pickled() -> None:
    agents = [ss.Agent(controller=ss.RecedingHorizon(planner=planner()))]
    team = ss.Team(agents)
    agents.clear()
    assert len(again(team).agents) == 1


def planner() -> ss.Planner:
    return ss.Planner(
        problem_without_parameters(), search=ss.RandomSearch(), polish=ss.IpoptOptions()
    )


def test_a_planner_keeps_the_budget_that_it_was_given_later() -> None:
    smaller = planner().with_budget(ss.Budget(evaluations=123))
    loaded = again(smaller)
    assert loaded.search.budget.evaluations == 123
    rng = np.random.default_rng
    first, second = (one.plan([0.0], rng=rng(1)) for one in (smaller, loaded))
    np.testing.assert_array_equal(first.controls, second.controls)
    assert first.evaluations == second.evaluations


def test_a_target_of_a_maximised_cost_keeps_its_sign() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=2,
        terminal_cost=x, maximize=True, bounds=ss.Bounds(controls=(-1, 1)),
    )  # fmt: skip
    settings = ss.SearchSettings(
        algorithm=ss.RandomSearch(), budget=ss.Budget(evaluations=100, target=0.25)
    )
    made = ss.Planner(problem, search=settings)
    changed = made.with_budget(ss.Budget(evaluations=50, target=-0.5))
    for one in (made, changed):
        assert one.search is not None
        assert again(one).search.budget == one.search.budget


def test_a_lambda_is_refused_by_its_name() -> None:
    loop = ss.RecedingHorizon(
        planner=planner(), candidates=lambda time: np.zeros((1, 2, 1))
    )
    with pytest.raises(
        (AttributeError, pickle.PicklingError), match=r"local object .*<lambda>"
    ):
        pickle.dumps(loop)
