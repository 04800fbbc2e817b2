"""Forged certificates: none is taken that a flight refutes, none breaks the checker.

The short form of `benchmarks/forged_certificates.py`, which forges a thousand.
"""

from __future__ import annotations

import copy
import json
import math
import sys

import numpy as np
import pytest

from swarmstart.benchmarks import forged_certificates
from swarmstart.benchmarks.forged_certificates import (
    checked,
    forged,
    genuine_certificates,
    refuted,
)
from swarmstart.benchmarks.forgeries import Content
from swarmstart.tests.terminal_set.checker.certificates_by_hand import signed

pytest.importorskip("flint")

COUNT = 80
NAMES = ("pendulum", "pendulum, held 0.1 s", "tank")


@pytest.fixture(scope="module")
def genuine() -> list[Content]:
    """At half their levels, which take less time to check."""
    found = genuine_certificates(NAMES)
    return [changed(content, alpha=0.5 * content["alpha"]) for content in found]


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_no_forgery_deceives_or_breaks_the_checker(genuine: list[Content]) -> None:
    faults, codes = {}, set()
    for number in range(COUNT):
        outcome = checked(forged(genuine, 16, number), 0.5)
        codes.add(outcome.code)
        if outcome.fault:
            faults[number] = outcome.fault
    assert not faults
    assert codes == {0, 2, 3, 4}  # Some change nothing that counts, or cannot be told.


def test_the_genuine_ones_are_taken_and_not_refuted(genuine: list[Content]) -> None:
    for content in genuine:
        outcome = checked(json.dumps(content).encode(), 60.0)
        assert (outcome.code, outcome.fault) == (0, "")


def test_the_same_seed_makes_the_same_forgery(genuine: list[Content]) -> None:
    assert forged(genuine, 1, 5) == forged(genuine, 1, 5) != forged(genuine, 2, 5)


def changed(content: Content, **changes: object) -> Content:
    return signed(copy.deepcopy(content) | changes)


def test_a_flight_tells_a_false_certificate(genuine: list[Content]) -> None:
    """Simulated states refute a false certificate that a checker has accepted."""
    upright, held, tank = genuine
    assert refuted(changed(upright, alpha=40.0), rng()) == "e'Pe does not fall"
    narrow = upright["bounds"] | {"u_upper": [1.0]}
    assert "an input" in refuted(changed(upright, bounds=narrow), rng())
    narrow = tank["bounds"] | {"x_lower": [-0.5]}
    assert "a state" in refuted(changed(tank, bounds=narrow), rng())
    growth = {"between_samples": {"growth": 1.0 - 1e-3, "grounds": "proven"}}
    assert "grows" in refuted(changed(held, margins=held["margins"] | growth), rng())
    moved = {"x": [0.1, 0.0], "u": [0.0]}
    assert refuted(changed(upright, reference=moved), rng()) == "e'Pe does not fall"
    most = np.array(held["P"]) * 0.9
    assert "fall" in refuted(changed(held, Q_m=most.tolist()), rng())


@pytest.mark.parametrize(
    ("verdict", "fault"),
    [
        (1, "exit code 1"),
        (0, "deceived: e'Pe does not fall"),
        (math.inf, "it raised RuntimeError: broken"),
        (-1, "it printed what is not printable"),
    ],
)
def test_a_fault_of_the_checker_is_seen(
    genuine: list[Content],
    verdict: float,
    fault: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(arguments: list[str]) -> int:
        if verdict == math.inf:
            raise RuntimeError("broken")
        if verdict < 0:
            sys.stdout.write("\x1b[31m\n")
            return 2
        return int(verdict)

    monkeypatch.setattr(forged_certificates, "check", broken)
    data = json.dumps(changed(genuine[0], alpha=40.0)).encode()
    assert checked(data, 1.0).fault == fault


def test_a_check_that_does_not_end_is_stopped(
    genuine: list[Content], monkeypatch: pytest.MonkeyPatch
) -> None:
    def endless(arguments: list[str]) -> int:
        while True:
            pass

    monkeypatch.setattr(forged_certificates, "check", endless)
    monkeypatch.setattr(forged_certificates, "HOPELESS", 0.1)
    assert checked(b"{}", 0.1).fault == "it did not end"
