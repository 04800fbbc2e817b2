"""Reseeding and settings of the chaotic swarm."""

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.heuristics import Box, ChaoticPSO, InvalidSettingsError, Search
from swarmstart.heuristics.laws.order import feasibility_first
from swarmstart.heuristics.searches.chaotic_pso import (
    ChaoticPSOState,
    Reseed,
    mean_distance,
    propose,
)

BOX = Box(lower=np.full(4, -5.0), upper=np.array([5.0, 5.0, 5.0, 15.0]))
LAST_PLAN = np.full((4, 20), 0.5)


def sphere(points: NDArray[np.float64]) -> NDArray[np.float64]:
    total: NDArray[np.float64] = (points**2).sum(axis=0)
    return total


def state_of(search: Search) -> ChaoticPSOState:
    state = search.state
    assert isinstance(state, ChaoticPSOState)
    return state


def test_diversity_is_that_of_5_18() -> None:
    position = np.random.default_rng(0).normal(size=(6, 9))
    deviation = position - position.mean(axis=1, keepdims=True)
    expected = np.sqrt((deviation**2).sum(axis=0)).mean()
    assert mean_distance(position, np.ones(6)) == pytest.approx(expected, rel=1e-14)
    scale = 2.0 ** np.arange(-3.0, 3.0)
    scaled = mean_distance(position / scale[:, None], scale)
    assert scaled == mean_distance(position, np.ones(6))


@pytest.mark.parametrize("reseed", ["logistic", "uniform"])
def test_swarm_at_one_point_reseeds_at_once_and_escapes(reseed: Reseed) -> None:
    rng = np.random.default_rng(1)
    search = Search(ChaoticPSO(reseed=reseed), BOX, rng=rng, initial=LAST_PLAN)
    search.tell(sphere(search.ask()), np.zeros(20))
    assert state_of(search).reseeds[0] == 0
    asked = search.ask()
    assert state_of(search).reseeds[0] == 1
    # A velocity is at most 4: only the placed half can be further from the plan.
    placed = np.abs(asked - LAST_PLAN).max(axis=0) > 4.0
    assert placed.any() and not placed[:10].any()


def test_logistic_reseeding_places_the_worse_half_by_5_17() -> None:
    rng = np.random.default_rng(2)
    still = ChaoticPSO(velocity_max=1e-12)  # placed particles move on, here not far
    search = Search(still, BOX, rng=rng, initial=LAST_PLAN)
    cost = np.tile([1.0, 2.0], 10)  # the odd ones are worse
    search.ask()
    search.tell(cost, np.zeros(20))
    before = state_of(search)
    asked = search.ask()
    z = 4.0 * before.chaos * (1.0 - before.chaos)
    placed = BOX.lower[:, None] + BOX.width[:, None] * z
    np.testing.assert_allclose(asked[:, 1::2], placed[:, 1::2], atol=1e-11)
    np.testing.assert_array_equal(state_of(search).chaos, z)
    np.testing.assert_array_equal(state_of(search).personal, before.personal)


def test_none_never_reseeds() -> None:
    rng = np.random.default_rng(3)
    search = Search(ChaoticPSO(reseed="none"), BOX, rng=rng, initial=LAST_PLAN)
    for k in range(100):
        search.tell(sphere(search.ask(progress=k / 99)), np.zeros(20))
    state = state_of(search)
    assert mean_distance(state.position, np.ones(4)) / 10.0 < 0.01  # it had reason to
    assert state.reseeds[0] == 0


def test_swarm_reseeds_only_below_the_threshold() -> None:
    algorithm = ChaoticPSO(size=2, search_length=None, diversity_threshold=0.25)
    settings = algorithm.kernel_settings(BOX, feasibility_first().running())
    for distance, reseeds in ((4.99, 1), (5.0, 0)):  # D = distance / 20, the width
        rng = np.random.default_rng(4)
        points = np.zeros((4, 2))
        points[3] = [-distance, distance]
        state = algorithm.start(BOX, points, rng=rng)
        state.generation[0] = 1
        propose(rng, settings, state, np.empty((4, 2)))
        assert state.reseeds[0] == reseeds


def test_lengths_left_out_are_taken_from_the_box() -> None:
    swarm = ChaoticPSO(velocity_max=None, search_length=None)
    lower = np.array([-1.0, 2.0, 0.0])
    box = Box(lower=lower, upper=lower + np.array([5.0, 0.0, 100.0]))
    settings = swarm.kernel_settings(box, feasibility_first().running())
    assert settings.velocity_max.tolist() == [2.0, 0.0, 40.0]
    assert settings.scale.tolist() == [0.2, 1.0, 0.01]
    assert settings.search_length == 1.0
    literal = ChaoticPSO().kernel_settings(box, feasibility_first().running())
    assert literal.velocity_max.tolist() == [4.0, 4.0, 4.0]
    assert (literal.scale.tolist(), literal.search_length) == ([1.0, 1.0, 1.0], 10.0)


def test_velocities_start_within_velocity_max_of_each_variable() -> None:
    algorithm = ChaoticPSO(size=200, velocity_max=[1.0, 2.0, 3.0, 4.0])
    assert algorithm == ChaoticPSO(size=200, velocity_max=(1.0, 2.0, 3.0, 4.0))
    state = state_of(Search(algorithm, BOX, rng=np.random.default_rng(5)))
    largest = np.abs(state.velocity).max(axis=1)
    np.testing.assert_allclose(largest, [1.0, 2.0, 3.0, 4.0], rtol=0.1)
    assert (largest <= [1.0, 2.0, 3.0, 4.0]).all()


def test_velocity_max_must_fit_the_box() -> None:
    algorithm = ChaoticPSO(velocity_max=(1.0, 2.0))
    with pytest.raises(InvalidSettingsError, match="a vector of 4"):
        Search(algorithm, BOX, rng=np.random.default_rng(6))


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"size": 1}, "size must be an integer of at least 2, got 1"),
        ({"inertia_min": 1.3}, "inertia_min must be at most inertia_max .*, got 1.3"),
        ({"cognitive": -0.1}, "cognitive must be a finite number of at least 0"),
        ({"social": np.nan}, "social must be a finite number of at least 0"),
        ({"velocity_max": 0.0}, "velocity_max must be None or finite and above 0"),
        ({"velocity_max": (1.0, np.inf)}, "velocity_max must be None or finite"),
        ({"reseed": "tent"}, "reseed must be one of .*logistic.*, got 'tent'"),
        (
            {"diversity_threshold": -1.0},
            "diversity_threshold .* at least 0",
        ),
        (
            {"search_length": 0.0},
            "search_length .* above 0",
        ),
        (
            {"bound_handling": "stick"},
            "bound_handling must be one of clip, .*none, got 'stick'",
        ),
        (
            {"initial_velocity": "zero"},
            "initial_velocity must be one of independent, smooth",
        ),
    ],
)
def test_refuses_settings_out_of_range(setting: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidSettingsError, match=message) as caught:
        ChaoticPSO(**setting)  # type: ignore[arg-type]
    assert caught.value.name in setting
