from __future__ import annotations

import numpy as np
import pytest

from swarmstart.cases.kinds.close_formation.pose import dryden

COUNT, DT, LENGTH, SPEED, SIGMA = 200_000, 0.5, 1750.0, 200.0, 6.0


def gusts(count: int = COUNT, seed: int = 0, sigma: float = SIGMA) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return dryden(count, sigma=sigma, length=LENGTH, speed=SPEED, dt=DT, rng=rng)


def test_variance_and_correlation_are_those_of_the_spectrum() -> None:
    w = gusts()
    # 200 000 samples over 17.5 apart in correlation: about 11 000 independent ones, so
    # the variance is known to 1.3 percent; five of these are allowed.
    assert w.shape == (3, COUNT)
    assert w.var(axis=1) == pytest.approx(SIGMA**2, rel=0.07)
    assert w.mean(axis=1) == pytest.approx(0.0, abs=5 * SIGMA / 11_000**0.5)
    for lag in (1, 10, 40):
        found = (w[:, lag:] * w[:, :-lag]).mean(axis=1) / SIGMA**2
        assert found == pytest.approx(np.exp(-SPEED * DT * lag / LENGTH), abs=0.07)


def test_gusts_are_stationary_from_the_start() -> None:
    first = np.concatenate([gusts(1, seed)[:, 0] for seed in range(2000)])
    assert first.std() == pytest.approx(SIGMA, rel=0.05)


def test_the_three_directions_are_independent() -> None:
    assert np.corrcoef(gusts())[np.triu_indices(3, 1)] == pytest.approx(0.0, abs=0.05)


def test_still_air_is_still_and_a_seed_repeats_itself() -> None:
    assert not gusts(50, sigma=0.0).any()
    assert np.array_equal(gusts(50, seed=3), gusts(50, seed=3))
    assert not np.array_equal(gusts(50, seed=3), gusts(50, seed=4))
