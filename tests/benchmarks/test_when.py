"""Cells of the page on when a swarm helps say what a time near the budget is worth."""

from typing import Any

import pytest

from swarmstart.benchmarks.when import cell_of


@pytest.mark.parametrize(
    ("near", "expected", "usual", "said"),
    [
        (30, 0.1, 0.1, "30 of 30, 0.1 s"),
        (30, 0.4, 0.4, "30 of 30, ~0.4 s"),
        (12, 2.9, 1.0, "12 of 30, ~2.9 s"),
        (1, 29.0, 1.0, "1 of 30, 29 s"),
        # Of these another machine may solve some.
        (0, None, 1.0, "0 of 30, none in 1 s"),
        (0, None, 0.34, "0 of 30, none in 1 s"),
        (0, None, None, "0 of 30, none in 1 s"),
        # These have ended long before, at another optimum.
        (0, None, 0.01, "0 of 30, none"),
    ],
)
def test_a_cell_says_what_depends_on_the_machine(
    near: int, expected: float | None, usual: float | None, said: str
) -> None:
    row: dict[str, Any] = {"near": [near, 0], "runs": 30, "seconds_p50": usual}
    assert cell_of({**row, "ert_seconds": [expected, None]}, 1.0) == said
    assert cell_of(None, 1.0) == "-"
