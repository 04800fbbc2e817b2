"""Populations: the same bits as one by one, for any size and memory layout."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Fitness,
    InvalidProblemError,
    Known,
    Model,
    OptimalControlProblem,
)
from swarmstart.ocp.compiled.backend import CasadiMap
from swarmstart.ocp.rollout.fitness import (
    NOTHING,
    Arguments,
    flatten,
    replay,
    unflatten,
)
from swarmstart.ocp.rollout.shooting import Shooting

Posed = tuple[OptimalControlProblem, Array, Known]


def population_of(size: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).uniform(-5, 5, size=(6, size))


def test_population_is_evaluated_as_each_individual_is(
    crossing: Posed, crossing_fitness: Fitness
) -> None:
    _, x0, known = crossing
    objective = crossing_fitness.objective(x0, known)
    for size in (1, 2, 20, 7):
        population = population_of(size, seed=size)
        cost, violation = objective(population)
        assert cost.shape == violation.shape == (size,)
        one_by_one = [
            crossing_fitness.value(unflatten(population[:, i], 2), x0, known)
            for i in range(size)
        ]
        np.testing.assert_array_equal(np.array([cost, violation]).T, one_by_one)


@given(cut=st.integers(1, 19))
def test_values_do_not_depend_on_the_split(
    crossing: Posed, crossing_fitness: Fitness, cut: int
) -> None:
    objective = crossing_fitness.objective(*crossing[1:])
    population = population_of(20)
    parts = [objective(population[:, :cut]), objective(population[:, cut:])]
    np.testing.assert_array_equal(np.hstack(parts), objective(population))


def test_memory_order_and_strides_make_no_difference(
    crossing: Posed, crossing_fitness: Fitness
) -> None:
    objective = crossing_fitness.objective(*crossing[1:])
    population = population_of(8)
    expected = objective(population)
    strided = np.repeat(population, 2, axis=1)[:, ::2]
    locked = population.copy()
    locked.flags.writeable = False
    for same in (np.asfortranarray(population), strided, locked):
        np.testing.assert_array_equal(objective(same), expected)
    np.testing.assert_array_equal(population, population_of(8))


def test_results_outlive_the_next_call(
    crossing: Posed, crossing_fitness: Fitness
) -> None:
    objective = crossing_fitness.objective(*crossing[1:])
    first = objective(population_of(5))
    kept = np.array(first)
    objective(population_of(5, seed=9))
    np.testing.assert_array_equal(first, kept)


def test_objectives_of_two_initial_states_do_not_disturb_each_other(
    crossing: Posed, crossing_fitness: Fitness
) -> None:
    _, x0, known = crossing
    here = crossing_fitness.objective(x0, known)
    there = crossing_fitness.objective(x0 + 1, known)
    expected = here(population_of(5))
    assert not np.array_equal(there(population_of(5)), expected)
    np.testing.assert_array_equal(here(population_of(5)), expected)


def test_initial_state_is_copied(crossing: Posed, crossing_fitness: Fitness) -> None:
    x0 = crossing[1].copy()
    objective = crossing_fitness.objective(x0, crossing[2])
    expected = objective(population_of(5))
    x0 += 3
    np.testing.assert_array_equal(objective(population_of(5)), expected)


def test_compiled_map_is_the_function(crossing: Posed) -> None:
    problem, x0, known = crossing
    function = Shooting(problem).rollout
    shared = (x0, np.empty(0), flatten(np.asarray(known.signals)))
    evaluate = CasadiMap(function).bind(shared)
    population = population_of(3)
    found = evaluate(population)
    assert found.shape == (2, 3)
    for i in range(3):
        values = [float(v) for v in function(population[:, i], *shared)]
        np.testing.assert_array_equal(found[:, i], values)


def test_backend_agrees_with_casadis_own_evaluation(
    crossing: Posed, crossing_fitness: Fitness
) -> None:
    """Both may differ by the rounding of sin and cos."""
    problem, x0, known = crossing
    function = Shooting(problem).rollout
    population = population_of(50)
    shared = (x0, np.empty(0), flatten(np.asarray(known.signals)))
    expected = [
        [float(v) for v in function(population[:, i], *shared)] for i in range(50)
    ]
    found = crossing_fitness.objective(x0, known)(population)
    np.testing.assert_allclose(np.array(found).T, expected, rtol=1e-11, atol=1e-11)


@given(
    hnp.arrays(np.float64, st.tuples(st.integers(1, 4), st.integers(1, 5))).filter(
        lambda a: not np.isnan(a).any()
    )
)
def test_unflatten_takes_flatten_back(sequence: Array) -> None:
    vector = flatten(sequence)
    rows, columns = sequence.shape
    np.testing.assert_array_equal(vector, np.concatenate([*sequence.T]))
    back = unflatten(vector, rows)
    assert back.shape == (rows, columns)
    np.testing.assert_array_equal(back, sequence)


def test_refuses_shapes_that_are_not_the_problems(
    crossing: Posed, crossing_fitness: Fitness
) -> None:
    _, x0, known = crossing
    fitness, signals = crossing_fitness, np.asarray(known.signals)
    with pytest.raises(InvalidProblemError, match=r"x0 must have shape \(4,\)"):
        fitness.objective(x0[:3], known)
    with pytest.raises(InvalidProblemError, match="x0 must be finite"):
        fitness.objective(x0 * np.nan, known)
    with pytest.raises(InvalidProblemError, match=r"parameters must have shape \(0,\)"):
        fitness.objective(x0, Known(parameters=[1.0], signals=signals))
    with pytest.raises(InvalidProblemError, match=r"signals must have shape \(6, 7\)"):
        fitness.objective(x0, Known(signals=signals.T))
    words = (
        r"\(6, 7\), got \(0,\): Known\(signals=\.\.\.\), a row for each of .*, with "
    )
    with pytest.raises(InvalidProblemError, match=words + "its values at the 7 nodes"):
        fitness.objective(x0)
    objective = fitness.objective(x0, known)
    for wrong in (np.zeros((1, 4)), np.zeros(6), np.zeros((4, 6))):
        with pytest.raises(InvalidProblemError, match=r"must have shape \(6, size\)"):
            objective(wrong)
    with pytest.raises(InvalidProblemError, match=r"controls must have shape \(2, 3\)"):
        fitness.value(np.zeros((3, 2)), x0, known)
    with pytest.raises(InvalidProblemError, match=r"controls must have shape \(2, 3\)"):
        fitness.states(np.zeros((3, 2)), x0, known)


def test_sizes_along_a_stiff_trajectory_are_those_its_states_reach() -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    model = Model(states=x, controls=u, ode=ca.vertcat(u, u - 1e5 * x[1] ** 2))

    def sizes(integrator: str) -> Array:
        problem = OptimalControlProblem(
            model,
            horizon=4.0,
            intervals=2,
            stage_cost=ca.sumsqr(x),
            bounds=Bounds(controls=(-1, 1)),
            integrator=integrator,
        )
        states = np.array([[0.0, 1.0, 3.0], [0.0, 0.003, 0.002]])
        arguments = Arguments(Shooting(problem))
        return arguments.sizes_along(np.ones((1, 2)), states, [0, 0], NOTHING).states

    np.testing.assert_allclose(sizes("stiff"), [3.0, 0.003])
    np.testing.assert_allclose(sizes("rk4"), [4.0, 4.0])


def test_cost_of_a_stiff_problem_is_sized_by_the_states_that_it_reaches() -> None:
    """Robertson's third state is 0.3; its rate at the start suggests 1e9."""
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    made, lost, burnt = 0.04 * u * x[0], 1e4 * x[1] * x[2], 3e7 * x[1] ** 2
    problem = OptimalControlProblem(
        Model(states=x, controls=u,
              ode=ca.vertcat(lost - made, made - lost - burnt, burnt)),
        horizon=40.0, intervals=10, terminal_cost=(x[2] - 0.4) ** 2,
        bounds=Bounds(controls=(0.5, 4)), integrator="stiff",
    )  # fmt: skip
    fitness, controls = Fitness(problem, backend="casadi"), np.ones((1, 10))
    x0, own = [1, 0, 0], 0.0134
    assert fitness.arguments.sizes(x0, Known()).cost > 1e12
    states = fitness.states(controls, x0)
    assert (states[2, -1] - 0.4) ** 2 == pytest.approx(own, rel=1e-2)
    along = fitness.arguments.sizes_along(controls, states, x0, Known())
    assert own < along.cost < 1e3 * own


def test_intervals_that_begin_anew_count_what_they_miss() -> None:
    """x' = u from 0 to 1 and 2: the second begins 0.3 too far, half a size of 0.6."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=2.0, intervals=2,
        stage_cost=x, scales={"x": 0.6},
    )  # fmt: skip
    ends = np.array([[0.0, 1.3, 2.3]])
    states, cost, violation = replay(problem, np.ones((1, 2)), [0.0], ends=ends)
    np.testing.assert_allclose(states, [[0.0, 1.0, 2.3]])
    assert violation == pytest.approx(0.3 / 0.6)
    assert cost == pytest.approx(0.5 + 1.8)
    assert replay(problem, np.ones((1, 2)), [0.0])[2] == 0.0
