"""Distinct optima, counted, and how much has not been seen."""

import numpy as np
import pytest

from swarmstart.ocp.lanes.answers import LaneAnswers
from swarmstart.ocp.lanes.optima import distinct_optima, unseen_share


def answers(
    paths: list[float], costs: list[float], violation: float = 0
) -> LaneAnswers:
    """Return answers whose one state stays at a number."""
    n = len(paths)
    return LaneAnswers(
        controls=np.zeros((1, 4, n)),
        starts=np.zeros((0, n)),
        states=np.ones((1, 5, n)) * np.array(paths),
        cost=np.array(costs),
        violation=np.full(n, violation),
        iterations=np.zeros(n, dtype=np.int64),
    )


def test_mirror_images_of_one_cost_are_two_optima() -> None:
    found = distinct_optima(answers([1.0, -1.0, 1.01, -1.02], [2.0, 2.0, 2.0, 2.0]))
    assert [one.count for one in found] == [2, 2]


def test_cheapest_comes_first_and_stands_for_its_optimum() -> None:
    found = distinct_optima(answers([0.0, 1.0, 1.02], [3.0, 1.1, 1.0]))
    assert [(one.lane, one.cost, one.count) for one in found] == [
        (2, 1.0, 2),
        (0, 3.0, 1),
    ]


def test_answer_that_breaks_a_limit_is_none() -> None:
    assert distinct_optima(answers([0.0], [1.0], violation=2e-6)) == []


def test_share_not_seen_is_that_of_the_optima_found_once() -> None:
    found = unseen_share([5, 1, 1, 2, 1])
    assert found.share == pytest.approx(0.3)
    assert found.most == pytest.approx(0.3 + 1.96 * np.sqrt(3 + 2) / 10)
    assert unseen_share([7, 3]).most == pytest.approx(0.3)
    assert unseen_share([]).share == 1.0


def test_interval_holds_the_true_share_as_often_as_it_says() -> None:
    """Draws of 256 from a law of eight optima, two of them rare."""
    law = np.array([0.4, 0.3, 0.15, 0.08, 0.04, 0.02, 0.006, 0.004])
    rng, held = np.random.default_rng(0), 0
    for _ in range(400):
        counts = rng.multinomial(256, law)
        truth = law[counts == 0].sum()
        held += truth <= unseen_share([int(c) for c in counts if c]).most
    assert held >= 0.9 * 400
