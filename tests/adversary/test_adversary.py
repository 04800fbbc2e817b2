"""Thirty of the adversary's problems; `benchmarks/adversary.py` runs all of them."""

import sys

import numpy as np

from swarmstart.tests.adversary.case import UNITS, Case, in_units
from swarmstart.tests.adversary.catalogue import chosen
from swarmstart.tests.adversary.claims import claimed
from swarmstart.tests.adversary.judge import judge

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
