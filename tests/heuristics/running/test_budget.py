"""Budgets: what is one, and what is refused."""

from typing import Any

import numpy as np
import pytest

from swarmstart.heuristics import Budget, InvalidBudgetError, budget_of


def test_an_integer_is_a_number_of_evaluations() -> None:
    assert budget_of(np.int64(500).item()) == Budget(evaluations=500)
    budget = Budget(seconds=1.0)
    assert budget_of(budget) is budget


@pytest.mark.parametrize("given", [0, -3, True, 1e4, 2**62, "5000", None, {}])
def test_refuses_what_is_neither_a_budget_nor_an_integer(given: Any) -> None:
    with pytest.raises(InvalidBudgetError, match="budget must be a Budget, or an int"):
        budget_of(given)


@pytest.mark.parametrize(
    ("evaluations", "seconds", "message"),
    [
        (None, None, "a budget needs evaluations or seconds"),
        (True, None, "evaluations must be an integer of at least 1 and below 2.62"),
        (2**62, None, "evaluations must be an integer of at least 1 and below 2.62"),
        (0, None, "evaluations must be an integer of at least 1 and below 2.62, got 0"),
        (
            1e3,
            None,
            "integer of at least 1 and below 2.62, got 1000.0",
        ),
        (None, 0.0, "seconds must be finite and above 0, got 0.0"),
        (None, np.nan, "seconds must be finite and above 0, got nan"),
        (None, "1 min", "seconds must be finite and above 0, got '1 min'"),
    ],
)
def test_refuses_what_is_no_budget(
    evaluations: Any, seconds: Any, message: str
) -> None:
    with pytest.raises(InvalidBudgetError, match=message):
        Budget(evaluations=evaluations, seconds=seconds)
