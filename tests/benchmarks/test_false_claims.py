"""Claims if there is nothing to claim, and if there is; `benchmarks/` has 1,000.

Both are counted through all of it: cells, tests, words and headline.
"""

from __future__ import annotations

import numpy as np
import pytest

from swarmstart.benchmarks.false_claims import (
    DRAWS,
    TWO,
    Draw,
    claims_of,
    false_claims,
    found_differences,
    gate,
    lognormal,
    made_up,
)


@pytest.mark.parametrize("draw", DRAWS, ids=lambda draw: draw.__name__)
def test_equal_solvers_are_rarely_called_different(draw: Draw) -> None:
    """Five percent at most; of 100 then 11 or fewer, but once in 200."""
    rng = np.random.default_rng(7)
    assert false_claims(draw, seeds=10, repetitions=100, rng=rng) <= 0.11


def test_a_solver_a_fifth_cheaper_is_found() -> None:
    """In 97 percent of 1,000; here at least 9 in 10 of 60."""
    rng = np.random.default_rng(8)
    found = found_differences(0.8, seeds=30, repetitions=60, rng=rng)
    assert min(found) >= 0.9


def test_a_gate_notices_a_solver_a_third_dearer_and_no_equal_one() -> None:
    rng = np.random.default_rng(9)
    dearer = gate(lognormal, 1.3, seeds=30, repetitions=60, rng=rng)
    assert dearer["median cost"] >= 0.8
    equal = gate(lognormal, 1.0, seeds=30, repetitions=60, rng=rng)
    assert max(equal.values()) <= 0.05


def test_what_is_counted_as_a_claim_are_the_claims() -> None:
    costs = np.arange(10.0)
    different = made_up({"s": dict(zip(TWO, (10 + costs, 90 + costs), strict=True))})
    assert any(said.startswith("costlier") for said in claims_of(different))
    equal = made_up({"s": dict(zip(TWO, (10 + costs, 10 + costs), strict=True))})
    assert claims_of(equal) == []
