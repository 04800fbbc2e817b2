"""Initial populations: in the box, and smooth in time where asked."""

import math

import numpy as np
import pytest

from swarmstart.heuristics import Box, ChaoticPSO, InvalidBoxError, InvalidSettingsError
from swarmstart.heuristics.laws.initial import sample_uniform, smooth_fractions

STEPS = 8
SIZE = 20_000


def smooth(per_step: int = 2) -> np.ndarray:
    rng = np.random.default_rng(0)
    return smooth_fractions((STEPS * per_step, SIZE), per_step=per_step, rng=rng)


def test_uniform_points_lie_in_the_box() -> None:
    box = Box(lower=np.array([-1.0, 2.0]), upper=np.array([1.0, 2.5]))
    points = sample_uniform(box, 100, rng=np.random.default_rng(1))
    assert box.contains(points).all()


def test_every_smooth_variable_is_uniform() -> None:
    # The Kolmogorov distance of 20,000 draws exceeds 1.95 / sqrt(n) once in 1,000.
    grid = (np.arange(SIZE) + 0.5) / SIZE
    for row in smooth():
        assert np.abs(np.sort(row) - grid).max() < 1.95 / math.sqrt(SIZE)


def test_smooth_variables_are_correlated_over_the_sequence() -> None:
    # Uniform scores of a Gaussian pair with correlation r correlate by 6/pi asin(r/2).
    fractions = smooth()
    for lag in (1, 4, STEPS - 1):
        expected = 6 / math.pi * math.asin(math.exp(-lag / STEPS) / 2)
        measured = np.corrcoef(fractions[0], fractions[2 * lag])[0, 1]
        assert measured == pytest.approx(expected, abs=4 / math.sqrt(SIZE))


def test_variables_of_one_step_are_independent() -> None:
    fractions = smooth()
    assert abs(np.corrcoef(fractions[0], fractions[1])[0, 1]) < 4 / math.sqrt(SIZE)


def test_a_turn_to_one_side_all_the_time_is_common_among_smooth_draws() -> None:
    one_side = (smooth(per_step=1) > 0.5).all(axis=0).mean()
    assert one_side > 20 * 0.5**STEPS


def test_per_step_must_divide_the_number_of_variables() -> None:
    with pytest.raises(InvalidBoxError, match="per_step must divide 3, got 2"):
        Box(lower=np.zeros(3), upper=np.ones(3), per_step=2)


def test_first_velocities_of_a_swarm_are_smooth_where_asked() -> None:
    box = Box(lower=-np.ones(16), upper=np.ones(16), per_step=2)
    swarm = ChaoticPSO(size=2000, initial_velocity="smooth", velocity_max=4.0)
    rng = np.random.default_rng(2)
    state = swarm.start(box, np.zeros((16, 2000)), rng=rng)
    assert np.abs(state.velocity).max() <= 4.0
    assert np.corrcoef(state.velocity[0], state.velocity[2])[0, 1] > 0.8


def test_smooth_velocities_need_a_box_that_is_a_sequence() -> None:
    box = Box(lower=-np.ones(4), upper=np.ones(4))
    with pytest.raises(InvalidSettingsError, match="without per_step"):
        ChaoticPSO(initial_velocity="smooth").start(
            box, np.zeros((4, 20)), rng=np.random.default_rng(3)
        )
