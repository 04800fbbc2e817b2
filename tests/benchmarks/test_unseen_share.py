"""The study of the unseen share, on answers whose optima are known."""

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.benchmarks import unseen_share as module
from swarmstart.benchmarks.unseen_share import bars, held, table
from swarmstart.benchmarks.unseen_ways import WAYS, laws, least_held
from swarmstart.ocp.lanes.answers import LaneAnswers


def answers(number: NDArray[np.int64]) -> LaneAnswers:
    """Return answers of which those with one number are one optimum; -1: none."""
    n = number.size
    return LaneAnswers(
        controls=np.zeros((1, 4, n)),
        starts=np.zeros((0, n)),
        states=np.ones((1, 5, 1)) * number,
        cost=number.astype(float),
        violation=np.where(number < 0, 1.0, 0.0),
        iterations=np.zeros(n, dtype=np.int64),
    )


def test_shares_are_those_of_the_optima_that_were_not_drawn() -> None:
    """All draws are of all but two: each misses the optima of those that are alone."""
    number = np.array([0] * 6 + [1, 2])
    found = held("x", answers(number), 6, 200)
    one, both = 1 / 8, 2 / 8
    assert set(found.shares[:, 0]) == {0.0, one, both}
    np.testing.assert_allclose(found.shares[:, 1], found.shares[:, 0] * 4)
    np.testing.assert_array_equal(found.shares[:, 2], found.shares[:, 1])
    np.testing.assert_array_equal(found.more, 0.0)


def test_answers_that_are_infeasible_count_nowhere() -> None:
    number = np.array([0] * 6 + [-1] * 6)
    found = held("x", answers(number), 8, 50)
    np.testing.assert_array_equal(found.shares, 0.0)
    assert found.most["score"].min() >= 3 / 6


def test_interval_holds_for_a_known_law_and_fails_when_it_is_too_short(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(0)
    given = answers(rng.integers(60, size=1000))
    found = held("four_discs", given, 40, 200)
    assert found.holds()[2] >= 0.9
    assert table([found])[2].startswith("| four_discs | 40 | ")
    monkeypatch.setattr(
        module, "WAYS", {"score": lambda counts: counts.count(1) / sum(counts)}
    )
    short = held("four_discs", given, 40, 200)
    assert short.holds()[2] < 0.7
    assert bars([short])[-1].is_missed and not bars([found])[-1].is_missed


@pytest.mark.parametrize("name", WAYS)
def test_every_way_states_a_share_that_is_not_below_the_estimate(name: str) -> None:
    for counts in ([1], [5], [1, 1, 1], [2, 2, 1, 7], [1] * 30 + [2] * 9 + [40]):
        n, once = sum(counts), counts.count(1)
        most = WAYS[name](counts)
        is_corrected = name == "Chao and Jost"
        assert (0 if is_corrected else once / n) - 1e-12 <= most <= 1 + 1e-12


def test_laws_are_shares() -> None:
    for law in laws(16):
        assert law.min() >= 0
        assert law.sum() == pytest.approx(1.0)
    assert least_held(lambda _: 1.0, 16, 5) == 1.0
    assert least_held(lambda _: 0.0, 16, 5) == 0.0
