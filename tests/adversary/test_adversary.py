"""Thirty of the adversary's problems; `benchmarks/adversary.py` runs all of them."""

import sys
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart import solve
from swarmstart.tests.adversary.case import UNITS, Case, in_units, problem_of
from swarmstart.tests.adversary.catalogue import chosen
from swarmstart.tests.adversary.claims import claimed
from swarmstart.tests.adversary.judge import judge
from swarmstart.tests.adversary.problems import aliases, between_checks, origins

PARTS, EACH = 3, 10
BACKENDS = ("auto", "casadi")
LEAST_SHARE = 0.8


@pytest.mark.parametrize("part", range(PARTS))
def test_no_claim_is_false_and_most_answers_are_right(
    cases: list[Case], part: int
) -> None:
    counted = [case for case in cases if case.is_counted]
    seeded = chosen(counted, PARTS * EACH, rng=np.random.default_rng(0))
    false, solvable, missed = [], 0, []
    for number, case in list(enumerate(seeded))[part * EACH : (part + 1) * EACH]:
        stated = in_units(case, UNITS[number % len(UNITS)])
        backend = BACKENDS[number % len(BACKENDS)]
        verdict = judge(stated.truth, claimed(stated, backend=backend))
        false += [f"{stated.name}: {fault}" for fault in verdict.faults]
        solvable += case.truth.is_solvable
        if case.truth.is_solvable and not verdict.is_right:
            missed.append(f"{stated.name}: {verdict.note}")
    share = 1 - len(missed) / solvable
    sys.stdout.write(f"{share:.0%} of {solvable} solved; missed: {missed}\n")
    assert not false
    assert share >= LEAST_SHARE


def test_no_answer_is_confirmed_that_cuts_a_bound_between_checks() -> None:
    """Such answers are what these problems have: most are refused, or repaired."""
    cut = between_checks.cases()[:8]
    false, confirmed = [], {True: 0, False: 0}
    for number, case in enumerate(cut):
        stated = in_units(case, UNITS[number % len(UNITS)])
        for repair in confirmed:
            backend = BACKENDS[number % len(BACKENDS)]
            claim = claimed(stated, backend=backend, repair=repair)
            false += [f"{case.name}: {f}" for f in judge(stated.truth, claim).faults]
            confirmed[repair] += claim.is_confirmed
    assert not false
    assert confirmed[False] <= len(cut) // 2
    assert confirmed[True] == len(cut)


@pytest.mark.parametrize("part", [slice(0, 4), slice(4, 14), slice(14, 26)])
def test_no_answer_is_confirmed_whose_steps_pass_over_a_ripple(part: slice) -> None:
    """Steps of a tenth passed over four of the ripples as well."""
    for case in aliases.cases()[part]:
        verdict = judge(case.truth, claimed(case, backend="auto"))
        assert not verdict.faults, f"{case.name}: {verdict.faults}"


@pytest.fixture(scope="module")
def smooth() -> list[Case]:
    """Every third problem without kinks, at which a rounding may decide of an end."""
    every = [one for one in origins.cases() if not one.name.startswith("nonsmooth")]
    return every[::3]


@pytest.mark.parametrize("number", range(12))
def test_no_verdict_depends_on_where_the_origin_lies(
    smooth: list[Case], number: int
) -> None:
    """Statuses and broken limits alike, and plans up to rounding."""
    case, answers = smooth[number], []
    for far in (0.0, *origins.FAR):
        assert case.origin is not None
        origin = far * case.truth.sizes * np.sign(case.origin)
        there = replace(case, origin=origin)
        found = solve(problem_of(there), there.start, seed=0)
        answers.append((found, found.states - origin[:, None], origin))
    here, states, _ = answers[0]
    reach = np.ptp(states, axis=1) + np.abs(states).max(axis=1)
    for found, moved, origin in answers[1:]:
        assert found.status is here.status
        room = 1e-6 * reach + 1e3 * np.finfo(float).eps * np.abs(origin)
        if here.status.is_confirmed:
            assert (np.abs(moved - states).max(axis=1) <= room).all()
        for one, other in zip(found.path.broken, here.path.broken, strict=False):
            if other.relative > 1e-4:
                assert one.amount == pytest.approx(other.amount, rel=1e-2)
                assert one.relative == pytest.approx(other.relative, rel=1e-2)


@pytest.mark.parametrize("origin", [0.0, 1e3, 5.8e6, 1e9])
def test_wall_and_distance_are_judged_alike_far_from_the_origin(origin: float) -> None:
    """0.025 m through a wall; 10 m in 1 s at 5 m/s."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    model = ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u))
    wall = ss.OptimalControlProblem(
        model, horizon=2.0, intervals=2, stage_cost=u**2,
        terminal=[x[0] - origin], constraints=[x[0] <= origin + 0.6],
    )  # fmt: skip
    found = solve(wall, [origin, 1.5], search=None, repair=False, seed=0)
    assert found.status is ss.SolutionStatus.BROKEN
    assert found.path.broken[0].amount == pytest.approx(0.024958, rel=1e-4)
    assert found.path.broken[0].scale == pytest.approx(0.6, rel=1e-6)
    far = ss.OptimalControlProblem(
        model, horizon=1.0, intervals=10, stage_cost=u**2,
        terminal=[x[0] - (origin + 10)],
        bounds=ss.Bounds(states=([-np.inf, -5], [np.inf, 5])),
    )  # fmt: skip
    found = solve(far, [origin, 0.0], search=None, seed=0)
    assert found.status is ss.SolutionStatus.INFEASIBLE


def test_no_answer_is_worse_than_a_start(cases: list[Case]) -> None:
    """By violation, then cost: not than a cold polish from zero or middle controls.

    At the checks; a start that is worse along the finer path is no better one.
    """
    counted = [case for case in cases if case.truth.is_solvable]
    worse = []
    for number, case in enumerate(chosen(counted, 24, rng=np.random.default_rng(5))):
        stated = in_units(case, UNITS[number % len(UNITS)])
        problem, x0 = problem_of(stated), stated.start
        answer = solve(problem, x0, seed=0)
        cold = solve(problem, x0, search=None, lanes=0, seed=0)
        size = max(abs(cold.cost), stated.truth.cost_size)
        if not cold.plan.feasible:
            continue
        if not answer.plan.feasible or answer.plan.cost > cold.plan.cost + 1e-6 * size:
            # A cheaper start that is not confirmed does not count against one that is.
            if not (answer.status.is_confirmed and not cold.status.is_confirmed):
                worse.append(f"{stated.name}: {answer.cost} instead of {cold.cost}")
    assert not worse
