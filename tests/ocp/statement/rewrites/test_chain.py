"""Claims about every rewrite of the chain, over problems with each feature.

The features are those of tests/ocp/feature_pairs, linear controls, and a risk. A new
rewrite without a problem here fails.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    CountedFrom,
    Free,
    InvalidProblemError,
    Known,
    Model,
    OptimalControlProblem,
    ensemble,
)
from swarmstart.ocp.rollout.fitness import core_known, replay
from swarmstart.ocp.statement.feature import Feature
from swarmstart.ocp.statement.rewrites.chain import (
    FEATURES,
    REWRITES,
    Lowered,
    lowered,
)
from swarmstart.tests.ocp.feature_pairs import features
from swarmstart.tests.ocp.feature_pairs.features import drawn

ACCRUED = ("cost of member", "threshold", "excess", "room")


class Posed(NamedTuple):
    """A problem with an initial state and known data."""

    problem: OptimalControlProblem
    x0: Array
    known: Known


def _linear(shape: str) -> Posed:
    x, u, before = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("before")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u - x), horizon=2.0, intervals=4, checks=2,
        stage_cost=x**2, step_cost=(u - before) ** 2, previous=before,
        bounds=Bounds(controls=(-2, 2)), control_shape=shape,  # type: ignore[arg-type]
    )  # fmt: skip
    return Posed(problem, np.array([1.0]), Known(previous=[0.3]))


def _risk() -> Posed:
    x, u, k = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("k")
    one = OptimalControlProblem(
        Model(states=x, controls=u, ode=u - k * x, parameters=k), horizon=1.0,
        intervals=4, stage_cost=x**2 + u**2, bounds=Bounds(controls=(-2, 2)),
    )  # fmt: skip
    every = ensemble(one, {"k": [0.5, 1.0, 2.0]}, risk="worst")
    return Posed(every, np.array([1.0]), Known())


def _counted() -> Posed:
    posed = _linear("linear")
    feature = CountedFrom({"x": 0.5})
    return posed._replace(problem=replace(posed.problem, features=[feature]))


def _drawn(name: str) -> Callable[[], Posed]:
    def posed() -> Posed:
        stated = drawn((name,), np.random.default_rng(7))
        return Posed(stated.problem(), stated.x0, stated.known)

    return posed


PROBLEMS: dict[str, Callable[[], Posed]] = {
    **{name: _drawn(name) for name in features.FEATURES},
    "linear controls": lambda: _linear("linear"),
    "continuous controls": lambda: _linear("continuous"),
    "risk": _risk,
    "counted from": _counted,
}


@cache
def _rolled(name: str) -> tuple[Lowered, Array, Array, Array]:
    """Return pair, initial state, random controls and the states they lead to."""
    problem, x0, known = PROBLEMS[name]()
    pair, rng = lowered(problem), np.random.default_rng(3)
    start = pair.start(x0, known.previous)
    lower, upper = (np.clip(side, -1.0, 1.0) for side in pair.core.control_limits)
    shape = (pair.core.model.nu, pair.core.intervals)
    controls = rng.uniform(lower[:, None], upper[:, None], shape)
    states = replay(problem, controls, start, core_known(pair, known))[0]
    return pair, start, controls, states


@pytest.mark.parametrize("name", PROBLEMS)
def test_states_that_a_rewrite_appends_are_those_of_the_rollout(name: str) -> None:
    pair, start, controls, states = _rolled(name)
    nx = pair.stated.model.nx
    at = np.arange(pair.core.nodes) / pair.core.checks
    added = pair.along(start, controls, at)
    assert added.shape == (pair.core.model.nx - nx, at.size)
    names = pair.core.model.state_names[nx:]
    kept = [i for i, n in enumerate(names) if not n.startswith(ACCRUED)]
    np.testing.assert_allclose(added[kept], states[nx:][kept], rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(added[:, 0], start[nx:])


@pytest.mark.parametrize("name", PROBLEMS)
def test_next_start_remembers_the_first_interval(name: str) -> None:
    pair, start, controls, states = _rolled(name)
    fresh = np.full(start.size, -7.0)
    found = pair.after(fresh, start, controls)
    for link in pair.links:
        expected = states[link.places, pair.core.checks]
        if not link.rewrite.is_remembered:
            expected = fresh[link.places]
        np.testing.assert_allclose(found[link.places], expected, rtol=1e-12)
    np.testing.assert_array_equal(found[: pair.stated.model.nx], -7.0)


@pytest.mark.parametrize("name", PROBLEMS)
def test_stated_states_come_first_and_controls_come_back(name: str) -> None:
    pair, start, controls, _ = _rolled(name)
    core, model = pair.core, pair.stated.model
    assert core.model.state_names[: model.nx] == model.state_names
    assert core.model.control_names == model.control_names
    again = pair.guess(start, pair.knots(controls, start))
    np.testing.assert_array_equal(again[1], controls)
    np.testing.assert_array_equal(again[0], start)


@pytest.mark.parametrize("name", PROBLEMS)
def test_guess_of_another_shape_or_with_nan_is_refused(name: str) -> None:
    pair, start, controls, _ = _rolled(name)
    for wrong in (
        controls[:, :-2],
        np.vstack([controls, controls]),
        controls[:0],
        controls.ravel(),
        np.full_like(controls, np.nan),
    ):
        with pytest.raises(InvalidProblemError, match=r"guess .*must"):
            pair.guess(start, wrong)


@pytest.mark.parametrize("name", PROBLEMS)
def test_core_has_nothing_left_to_rewrite(name: str) -> None:
    core = lowered(PROBLEMS[name]().problem).core
    assert not any(rewrite.accepts(core) for rewrite in REWRITES)
    assert lowered(core).core is core


def test_every_rewrite_of_the_chain_is_met_by_a_problem() -> None:
    met = {
        type(link.rewrite)
        for posed in PROBLEMS.values()
        for link in lowered(posed().problem).links
    }
    assert met == {*map(type, REWRITES), *FEATURES.values(), CountedFrom}


def test_end_time_is_no_name_of_a_parameter_beside_a_free_one() -> None:
    x, k = ca.SX.sym("x"), ca.SX.sym("end time")
    model = Model(states=x, controls=ca.SX.sym("u"), ode=k * x, parameters=k)
    stated = OptimalControlProblem(model, horizon=Free(1.0, 2.0), intervals=2)
    with pytest.raises(InvalidProblemError, match="must not be named 'end time'"):
        lowered(stated)
    assert lowered(replace(stated, horizon=1.0)).links == ()


def test_a_feature_that_is_no_rewrite_is_refused() -> None:
    x = ca.SX.sym("x")
    model = Model(states=x, controls=ca.SX.sym("u"), ode=x)
    stated = OptimalControlProblem(
        model, horizon=1.0, intervals=2, features=[Feature()]
    )
    with pytest.raises(InvalidProblemError, match="must be a Rewrite"):
        lowered(stated)
