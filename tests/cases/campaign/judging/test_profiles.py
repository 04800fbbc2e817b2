"""Performance profiles, against loops and the known trap of three solvers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swarmstart.cases.campaign.judging.curves import (
    performance_profile,
    profile_bands,
    ratios_of,
    relative_times,
)
from swarmstart.cases.campaign.judging.statistics import resampled

INF = np.inf
times_of = arrays(
    np.float64, (3, 5), elements=st.sampled_from([1.0, 2.0, 3.0, 10.0, INF])
)


@given(times=times_of)
def test_a_profile_is_that_of_loops(times: np.ndarray) -> None:
    ratios = [1.0, 2.0, 4.0, 100.0]
    found = performance_profile(relative_times(times), ratios)
    for s in range(3):
        for k, ratio in enumerate(ratios):
            within = 0
            for i in range(5):
                least = min(times[:, i])
                within += bool(least < INF and times[s, i] <= ratio * least)
            assert found[s, k] == pytest.approx(within / 5, abs=1e-12)


def test_two_of_three_can_change_their_order_when_the_third_leaves() -> None:
    """The third is fastest where the first is; the second then leads at ratio 2."""
    times = np.array(
        [
            [3.0, 3.0, 3.0, 9.0, 9.0],
            [5.0, 5.0, 5.0, 1.0, 1.0],
            [1.0, 1.0, 1.0, INF, INF],
        ]
    )
    all_three = performance_profile(relative_times(times), [2.0])[:, 0]
    alone = performance_profile(relative_times(times[:2]), [1.0, 2.0])
    assert all_three[1] > all_three[0]
    assert alone[0, 0] > alone[1, 0]
    np.testing.assert_allclose(alone[:, 0], [0.6, 0.4])


def test_ratios_begin_at_one_and_hold_the_largest() -> None:
    relative = relative_times([[1.0, 5.0, INF], [7.0, 5.0, INF]])
    ratios = ratios_of(relative)
    assert ratios[0] == 1.0
    assert performance_profile(relative, ratios)[:, -1] == pytest.approx([2 / 3, 2 / 3])
    assert ratios_of(np.full((2, 3), INF))[-1] == pytest.approx(2.0)


def test_bands_hold_the_profile_and_vanish_where_seeds_do_not_differ() -> None:
    rng = np.random.default_rng(0)
    times = np.concatenate([rng.exponential(size=(2, 30)), np.ones((2, 30))], axis=1)
    relative = relative_times(times)
    ratios = ratios_of(relative)
    groups = [resampled(30, resamples=500, rng=rng) for _ in range(2)]
    low, high = profile_bands(relative, ratios, groups)
    shares = performance_profile(relative, ratios)
    assert np.all(low <= shares + 1e-12) and np.all(shares <= high + 1e-12)
    # On the second scenario both are alike: half of the instances have no spread.
    assert low[0, 0] >= 0.5
    # Binomial: 1.96 sqrt(p q / 30), halved, is at most 0.09 to either side.
    assert 0.05 < (high - low).max() < 0.2
