"""Lengths of time have a number and a unit, seconds if none is given."""

import pytest

from swarmstart.cases.campaign.trials.solvers import (
    InvalidDurationError,
    budget_of,
    seconds_of,
)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("120s", 120), ("120", 120), (" 2 m ", 120), ("1h", 3600), ("0.5", 0.5)],
)
def test_a_length_of_time_is_in_seconds(text: str, seconds: float) -> None:
    assert seconds_of(text) == seconds


@pytest.mark.parametrize("text", ["2m", "0.25s", "1h", "3e2s"])
def test_budgets_are_read_alike(text: str) -> None:
    assert budget_of(text) == {"seconds": seconds_of(text)}


@pytest.mark.parametrize(
    "text", ["", "s", "0s", "-1s", "1d", "1 2", "1..2", "inf", "nan", "1e999"]
)
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(InvalidDurationError, match="expected a length of time such as"):
        seconds_of(text)
