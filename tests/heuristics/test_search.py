"""Ask and tell."""

import numpy as np
import pytest
from numpy.typing import ArrayLike

from swarmstart.heuristics import (
    AskTellError,
    Box,
    InvalidEvaluationError,
    InvalidPointsError,
    InvalidSettingsError,
    RandomSearch,
    Search,
)

BOX = Box(lower=np.full(2, -1.0), upper=np.full(2, 1.0))


def new_search(initial: ArrayLike | None = None) -> Search:
    rng = np.random.default_rng(0)
    return Search(RandomSearch(size=4), BOX, rng=rng, initial=initial)


def test_initial_points_come_first_and_the_others_are_uniform() -> None:
    initial = np.array([[1.0, -0.5], [-1.0, 0.25]])
    points = new_search(initial).ask()
    np.testing.assert_array_equal(points[:, :2], initial)
    np.testing.assert_array_equal(points[:, 2:], new_search().ask()[:, 2:])


def test_asked_points_belong_to_the_caller_and_cannot_be_changed() -> None:
    search = new_search()
    first = search.ask()
    kept = first.copy()
    with pytest.raises(ValueError, match="read-only"):
        first[0, 0] = 0.0
    search.tell(np.zeros(4), np.zeros(4))
    search.ask()
    np.testing.assert_array_equal(first, kept)


def test_state_and_best_are_copies() -> None:
    search = new_search()
    search.ask()
    search.tell([3.0, 1.0, 2.0, 4.0], np.zeros(4))
    search.state.best_cost[0] = -1.0
    search.best.x[0] = 99.0
    assert search.best.cost == 1.0
    assert search.best.x[0] <= 1.0


def test_ask_and_tell_must_alternate() -> None:
    search = new_search()
    with pytest.raises(AskTellError, match=r"tell\(\) before ask\(\)"):
        search.tell(np.zeros(4), np.zeros(4))
    search.ask()
    with pytest.raises(AskTellError, match=r"ask\(\) before tell\(\)"):
        search.ask()


@pytest.mark.parametrize(
    ("cost", "violation", "message"),
    [
        (np.zeros(3), np.zeros(4), r"cost must have shape \(4,\), got \(3,\)"),
        (np.zeros(4), 0.0, r"violation must have shape \(4,\), got \(\)"),
        (np.zeros(4), [0, 0, -1, 0], "violation must be at least 0, got -1"),
        (["a"] * 4, np.zeros(4), "cost must be an array of 4 numbers"),
    ],
)
def test_refuses_what_is_no_evaluation_and_can_be_told_again(
    cost: ArrayLike, violation: ArrayLike, message: str
) -> None:
    search = new_search()
    search.ask()
    with pytest.raises(InvalidEvaluationError, match=message):
        search.tell(cost, violation)
    search.tell(np.zeros(4), np.zeros(4))
    assert search.evaluations == 4


@pytest.mark.parametrize(
    ("initial", "message"),
    [
        (np.zeros((2, 5)), "initial has 5 points, the population only 4"),
        (np.zeros((3, 1)), r"initial must have shape \(2, k\), got \(3, 1\)"),
        (np.zeros(2), r"initial must have shape \(2, k\), got \(2,\)"),
        ([[0.0, 2.0], [0.0, 0.0]], r"columns \[1\] do not"),
        ([[np.nan], [0.0]], r"columns \[0\] do not"),
    ],
)
def test_refuses_initial_points_that_do_not_fit(
    initial: ArrayLike, message: str
) -> None:
    with pytest.raises(InvalidPointsError, match=message):
        new_search(initial)


def test_refuses_arguments_out_of_range() -> None:
    search = new_search()
    with pytest.raises(InvalidSettingsError, match=r"progress must be in \[0, 1\]"):
        search.ask(progress=1.5)
    with pytest.raises(InvalidSettingsError, match="rng must be a numpy"):
        Search(RandomSearch(), BOX, rng=7)  # type: ignore[arg-type]
    with pytest.raises(InvalidSettingsError, match="initial must be None where state"):
        Search(
            RandomSearch(size=4),
            BOX,
            rng=np.random.default_rng(0),
            initial=np.zeros((2, 1)),
            state=search.state,
        )
