"""The particle swarm."""

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.heuristics import (
    Box,
    Budget,
    InvalidSettingsError,
    ParticleSwarm,
    minimize,
)


@pytest.mark.parametrize("seed", range(3))
def test_solves_the_sphere(seed: int) -> None:
    def sphere(x: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        return ((x - 1.0) ** 2).sum(axis=0), np.zeros(x.shape[1])

    result = minimize(
        sphere,  # type: ignore[arg-type]
        Box(lower=np.full(10, -5.0), upper=np.full(10, 5.0)),
        algorithm=ParticleSwarm(size=40),
        budget=Budget(evaluations=20_000),
        rng=np.random.default_rng(seed),
    )
    # Peers need 8200 evaluations for 1e-8 (facts A2.3); here are more than twice that.
    assert result.cost < 1e-10
    np.testing.assert_allclose(result.x, 1.0, atol=1e-5)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"size": 0}, "size must be an integer of at least 1, got 0"),
        ({"inertia": 1.1}, r"inertia must be in \[0, 1\], got 1.1"),
        ({"cognitive": np.inf}, "cognitive must be finite"),
        ({"velocity_max": 0.0}, "velocity_max must be None or finite and above 0"),
        ({"bounds": "stick"}, "bounds must be one of clip, .*none, got 'stick'"),
    ],
)
def test_refuses_settings_out_of_range(setting: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidSettingsError, match=message):
        ParticleSwarm(**setting)  # type: ignore[arg-type]
