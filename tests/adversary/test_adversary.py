"""Thirty of the adversary's problems; `benchmarks/adversary.py` runs all of them."""

import sys

import numpy as np
import pytest

from swarmstart import solve
from swarmstart.tests.adversary.case import UNITS, Case, in_units, problem_of
from swarmstart.tests.adversary.catalogue import chosen
from swarmstart.tests.adversary.claims import claimed
from swarmstart.tests.adversary.judge import judge
from swarmstart.tests.adversary.problems import aliases, between_checks

COUNT = 30
BACKENDS = ("auto", "casadi")
LEAST_SHARE = 0.8


def test_no_claim_is_false_and_most_answers_are_right(cases: list[Case]) -> None:
    counted = [case for case in cases if case.is_counted]
    seeded = chosen(counted, COUNT, rng=np.random.default_rng(0))
    false, solvable, missed = [], 0, []
    for number, case in enumerate(seeded):
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
    """Such answers are what these problems have: most must be refused."""
    cut = between_checks.cases()[:8]
    false, refused = [], 0
    for number, case in enumerate(cut):
        stated = in_units(case, UNITS[number % len(UNITS)])
        claim = claimed(stated, backend=BACKENDS[number % len(BACKENDS)])
        false += [f"{case.name}: {f}" for f in judge(stated.truth, claim).faults]
        refused += not claim.is_confirmed
    assert not false
    assert refused >= len(cut) // 2


@pytest.mark.parametrize("part", [slice(0, 4), slice(4, 14), slice(14, 26)])
def test_no_answer_is_confirmed_whose_steps_pass_over_a_ripple(part: slice) -> None:
    """Steps of a tenth passed over four of the ripples as well."""
    for case in aliases.cases()[part]:
        verdict = judge(case.truth, claimed(case, backend="auto"))
        assert not verdict.faults, f"{case.name}: {verdict.faults}"


def test_no_answer_is_worse_than_a_start(cases: list[Case]) -> None:
    """By violation, then cost: not than a cold polish from zero or middle controls.

    At the checks; a start that is worse along the finer path is no better one.
    """
    counted = [case for case in cases if case.truth.is_solvable]
    worse = []
    for number, case in enumerate(chosen(counted, 24, rng=np.random.default_rng(5))):
        stated = in_units(case, UNITS[number % len(UNITS)])
        problem, x0 = problem_of(stated), stated.truth.x0
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
