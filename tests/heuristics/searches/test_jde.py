"""jDE: its parameters' distributions, and published evaluations."""

from pathlib import Path

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    Box,
    Budget,
    InvalidSettingsError,
    Search,
    SelfAdaptiveDE,
    StopReason,
    minimize,
    static_penalty,
)
from swarmstart.heuristics.searches.jde import SelfAdaptiveDEState
from swarmstart.tests.heuristics.adaptive_laws import (
    assert_both_loops_give_the_same_bits,
    assert_resumes_bit_for_bit,
)


def state_of(search: Search) -> SelfAdaptiveDEState:
    state = search.state
    assert isinstance(state, SelfAdaptiveDEState)
    return state


def started(size: int, seed: int) -> Search:
    box = Box(lower=np.full(3, -1.0), upper=np.full(3, 1.0))
    search = Search(SelfAdaptiveDE(size=size), box, rng=np.random.default_rng(seed))
    search.ask()
    search.tell(np.ones(size), np.zeros(size))
    return search


def test_one_trial_in_ten_has_a_new_weight_and_one_in_ten_a_new_rate() -> None:
    search = started(10_000, 0)
    search.ask()
    state = state_of(search)
    for values, old in ((state.F_trial, 0.5), (state.CR_trial, 0.9)):
        # sd of the share of 10,000 with probability 0.1: 0.003
        assert (values != old).mean() == pytest.approx(0.1, abs=5 * 0.003)
    both = ((state.F_trial != 0.5) & (state.CR_trial != 0.9)).mean()
    assert both == pytest.approx(0.01, abs=5 * 0.001)


def test_new_weights_and_rates_are_uniform() -> None:
    search = started(20_000, 1)
    search.ask()
    state = state_of(search)
    F = state.F_trial[state.F_trial != 0.5]
    CR = state.CR_trial[state.CR_trial != 0.9]
    for values, low, high in ((F, 0.1, 1.0), (CR, 0.0, 1.0)):
        assert values.min() >= low and values.max() <= high
        # 2000 draws: sd of a quantile at most 0.5 / sqrt(2000) of the width
        expected = low + (high - low) * np.array([0.25, 0.5, 0.75])
        atol = 5 * 0.0112 * (high - low)
        np.testing.assert_allclose(
            np.quantile(values, [0.25, 0.5, 0.75]), expected, atol=atol
        )


def test_parameters_stay_with_the_trials_that_replace_their_parents() -> None:
    search = started(1000, 2)
    search.ask()
    trial = state_of(search)
    cost = np.where(np.arange(1000) % 2 == 0, 0.5, 2.0)
    search.tell(cost, np.zeros(1000))
    state = state_of(search)
    np.testing.assert_array_equal(state.F[::2], trial.F_trial[::2])
    np.testing.assert_array_equal(state.CR[::2], trial.CR_trial[::2])
    np.testing.assert_array_equal(state.F[1::2], 0.5)
    np.testing.assert_array_equal(state.CR[1::2], 0.9)


def test_needs_as_many_evaluations_as_pygmo_for_the_sphere() -> None:
    """10-D sphere as BBOB f1 to 1e-8, NP 50: pygmo's sade needs 9976.

    The tolerance of 8 % covers another bound repair and another start of F and CR.
    """
    counts = []
    for seed in range(15):
        rng = np.random.default_rng(seed)
        optimum = rng.uniform(-4.0, 4.0, (10, 1))

        def sphere(x: Array, optimum: Array = optimum) -> tuple[Array, Array]:
            return ((x - optimum) ** 2).sum(axis=0), np.zeros(x.shape[1])

        result = minimize(
            sphere,
            Box(lower=np.full(10, -5.0), upper=np.full(10, 5.0)),
            algorithm=SelfAdaptiveDE(),
            budget=Budget(evaluations=15_000, target=1e-8),
            rng=rng,
        )
        assert result.stopped is StopReason.TARGET
        counts.append(result.evaluations)
    assert np.mean(counts) == pytest.approx(9976, rel=0.08)


def test_both_loops_give_the_same_bits() -> None:
    assert_both_loops_give_the_same_bits(SelfAdaptiveDE(size=12), static_penalty(10.0))


def test_resumes_bit_for_bit(tmp_path: Path) -> None:
    assert_resumes_bit_for_bit(SelfAdaptiveDE(size=12), tmp_path)


def test_refuses_a_population_without_three_others() -> None:
    with pytest.raises(InvalidSettingsError, match="size must be an integer of at"):
        SelfAdaptiveDE(size=3)
