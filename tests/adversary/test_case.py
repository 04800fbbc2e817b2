from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.tests.adversary.case import (
    UNITS,
    Case,
    Units,
    in_units,
    problem_of,
)
from swarmstart.tests.adversary.catalogue import CLASSES, chosen
from swarmstart.tests.adversary.judge import Claim, judge, replay


def points(case: Case) -> tuple[Array, Array]:
    """Return a state and a control at which a case may be evaluated."""
    rng, (lower, upper) = np.random.default_rng(0), case.truth.controls
    x = case.truth.x0 * rng.uniform(0.9, 1.1) + 1e-3 * case.truth.sizes
    return x, lower + rng.uniform(0.3, 0.7, lower.size) * (upper - lower)


def written(case: Case, x: Array, u: Array) -> tuple[Array, Array]:
    """Return all of a case's formulas at a point, in CasADi and in NumPy."""
    X, U = ca.SX.sym("x", x.size), ca.SX.sym("u", u.size)
    own, truth = case.formulas(X, U), case.truth
    bounded = ca.SX(0, 1)
    if case.states is not None:
        limited = np.flatnonzero(np.isfinite(case.states).any(axis=0))
        bounded = ca.vertcat(*[X[int(row)] for row in limited])
    parts = [
        own.ode, own.stage_cost, own.terminal_cost, own.path, bounded, own.terminal
    ]  # fmt: skip
    symbolic = ca.vertcat(*[ca.SX(part) for part in parts if part is not None])
    ours = np.array(ca.Function("formulas", [X, U], [symbolic])(x, u)).ravel()
    with np.errstate(all="ignore"):
        costs = np.array([truth.stage_cost(x, u), truth.terminal_cost(x)])
        rows = truth.path.value(x, u), truth.terminal.value(x, u)
        return ours, np.concatenate([truth.dynamics(x, u), costs, *rows])


@pytest.mark.parametrize("units", UNITS)
def test_formulas_agree_in_casadi_and_numpy(cases: list[Case], units: Units) -> None:
    for case in cases:
        stated = in_units(case, units)
        ours, theirs = written(stated, *points(stated))
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-12)


def test_every_case_makes_a_problem(cases: list[Case]) -> None:
    for case in cases:
        problem = problem_of(case)
        assert problem.intervals == case.truth.intervals
        assert (
            sum(c.expression.numel() for c in problem.path_constraints)
            >= case.truth.path.lower.size
        )


def test_known_answers_are_right_by_the_judge(cases: list[Case]) -> None:
    # From another origin a case is known by the same truth.
    known = [case for case in cases if case.origin is None]
    solved = [case for case in known if case.best is not None]
    assert len(solved) > 200
    for case in chosen(solved, 25, rng=np.random.default_rng(0)):
        for units in UNITS[:2]:
            stated = in_units(case, units)
            assert stated.best is not None
            flown = replay(stated.truth, stated.best)
            assert flown is not None, case.name
            claim = Claim(controls=stated.best, cost=flown.cost, is_confirmed=True)
            assert judge(stated.truth, claim).is_right, case.name


def test_no_control_nearby_is_better_than_the_known_optimum(cases: list[Case]) -> None:
    """Most are convex: what is not better nearby is not better anywhere."""
    rng = np.random.default_rng(1)
    solved = [case for case in cases if case.best is not None and case.is_counted]
    for case in chosen(solved, 30, rng=rng):
        lower, upper = (limit[:, None] for limit in case.truth.controls)
        for size in (1e-3, 1e-1):
            assert case.best is not None
            step = size * (upper - lower) * rng.normal(size=case.best.shape)
            controls = np.clip(case.best + step, lower, upper)
            flown = replay(case.truth, controls)
            if flown is None:
                continue
            honest = Claim(controls=controls, cost=flown.cost, is_confirmed=True)
            assert "below" not in judge(case.truth, honest).note, case.name


def test_unsolvable_cases_are_broken_by_any_control(cases: list[Case]) -> None:
    rng = np.random.default_rng(2)
    unsolvable = [case for case in cases if not case.truth.is_solvable]
    for case in chosen(unsolvable, 20, rng=rng):
        possible = replace(case.truth, is_solvable=True)
        lower, upper = (limit[:, None] for limit in case.truth.controls)
        u = rng.uniform(lower, upper, (lower.size, case.truth.intervals))
        flown = replay(possible, u)
        cost = np.nan if flown is None else flown.cost
        claim = Claim(controls=u, cost=cost, is_confirmed=True)
        assert judge(possible, claim).faults, case.name


def test_units_change_numbers_and_nothing_else(cases: list[Case]) -> None:
    case = next(c for c in cases if c.kind == "path_constrained" and c.best is not None)
    own = replay(case.truth, case.best) if case.best is not None else None
    stated = in_units(case, UNITS[2])
    other = replay(stated.truth, stated.best) if stated.best is not None else None
    assert own is not None and other is not None
    assert other.cost == pytest.approx(UNITS[2].cost * own.cost, rel=1e-8)
    np.testing.assert_allclose(
        other.states, UNITS[2].states * own.states, rtol=1e-7, atol=1e-7
    )


def test_there_are_enough_cases(cases: list[Case]) -> None:
    counts = {kind: sum(case.kind == kind for case in cases) for kind in CLASSES}
    assert min(counts.values()) >= 25
    assert sum(case.is_counted for case in cases) >= 300
    assert len({case.name for case in cases}) == len(cases)


def test_cases_are_the_same_on_every_call(cases: list[Case]) -> None:
    for kind in ("linear_quadratic", "overflow"):
        again = CLASSES[kind]()
        before = [case for case in cases if case.kind == kind]
        for one, other in zip(before, again, strict=True):
            assert (one.name, one.truth.highest) == (other.name, other.truth.highest)
            np.testing.assert_array_equal(one.truth.x0, other.truth.x0)
