"""The NLP is the rollout with its states as variables."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.ocp import (
    Bounds,
    Fitness,
    Known,
    OptimalControlProblem,
    TerminalConstraint,
)
from swarmstart.ocp.fitness import flatten
from swarmstart.ocp.transcription import multiple_shooting

Array = NDArray[np.float64]
Posed = tuple[OptimalControlProblem, Array, Known]


@pytest.fixture(scope="module")
def demanding(crossing: Posed) -> Posed:
    """`crossing` with a terminal constraint and every constraint at points."""
    problem, x0, known = crossing
    constraints = [replace(c, along="points") for c in problem.constraints]  # type: ignore[type-var]
    end = TerminalConstraint(expression=problem.model.states[2:], lower=-40, upper=40)
    return replace(problem, constraints=constraints, terminal=[end]), x0, known


def test_rolled_out_point_has_the_rollouts_cost_and_no_defects(
    demanding: Posed,
) -> None:
    problem, x0, known = demanding
    program, fitness = multiple_shooting(problem), Fitness(problem)
    values = ca.Function(
        "nlp",
        [program.nlp["x"], program.nlp["p"]],
        [program.nlp["f"], program.nlp["g"]],
    )
    rng, (lower, upper) = np.random.default_rng(0), problem.control_limits
    signals = flatten(np.asarray(known.signals))
    for _ in range(20):
        controls = rng.uniform(lower, upper, (3, 2)).T
        states = fitness.states(controls, x0, known)
        w = np.concatenate([flatten(controls), flatten(states[:, 2::2])])
        f, g = values(w, np.concatenate([x0, signals]))
        rows = np.array(g).ravel()
        assert float(f) == pytest.approx(
            fitness.value(controls, x0, known)[0], rel=1e-13
        )
        np.testing.assert_allclose(rows[:12], 0, atol=1e-12)
        # Per node: disc and separations; the disc's margin is the search's alone.
        other = states[2:] - np.asarray(known.signals)[4:]
        centre = states[2:] - np.array([[15.0], [1.0]])
        gaps = [
            (limit**2 - (relative**2).sum(axis=0)) / (2 * limit)
            for relative, limit in ((centre, 4.0), (other, 3.0), (other, 6.0))
        ]
        np.testing.assert_allclose(rows[12:30], flatten(np.array(gaps)[:, 1:]), 1e-9)
        # Speeds between the intervals' ends, then the terminal rows.
        np.testing.assert_allclose(rows[30:33], states[0, 1::2], 1e-12)
        np.testing.assert_allclose(rows[33:], states[2:, -1], 1e-12)


def test_limits_stand_beside_their_rows(demanding: Posed) -> None:
    program = multiple_shooting(demanding[0])
    inf = np.inf
    free = [-inf] * 3
    assert program.lower.tolist() == [-5, -1] * 3 + [0, *free] * 3
    assert program.upper.tolist() == [5, 1] * 3 + [12, inf, inf, inf] * 3
    lower_g = [0] * 12 + [-inf] * 18 + [0] * 3 + [-40] * 2
    assert program.lower_g.tolist() == lower_g
    assert program.upper_g.tolist() == [0] * 12 + [0] * 18 + [12] * 3 + [40] * 2
    assert program.nlp["x"].numel() == program.lower.size
    assert program.nlp["g"].numel() == program.lower_g.size


def test_problem_without_constraints_has_defects_only(
    lq: OptimalControlProblem,
) -> None:
    program = multiple_shooting(lq)
    assert program.nlp["g"].numel() == 20
    assert np.isinf(program.lower).all()
    bounded = replace(lq, bounds=Bounds(states=(-1, 1)), checks=1)
    assert multiple_shooting(bounded).nlp["g"].numel() == 20


def test_defects_couple_neighbouring_intervals_only(lq: OptimalControlProblem) -> None:
    program = multiple_shooting(lq)
    pattern = ca.jacobian(program.nlp["g"], program.nlp["x"]).sparsity()
    rows, columns = np.array(pattern.get_triplet())
    interval_of = np.concatenate([np.arange(10), np.repeat(np.arange(10), 2)])
    distance = rows // 2 - interval_of[columns]
    assert set(distance[columns < 10]) == {0}
    assert set(distance[columns >= 10]) == {0, 1}
