"""Random search."""

import numpy as np
import pytest

from swarmstart.heuristics import Box, InvalidSettingsError, RandomSearch, Search


def test_every_generation_is_uniform_in_the_box() -> None:
    box = Box(lower=np.array([-1.0, 2.0]), upper=np.array([1.0, 2.5]))
    search = Search(RandomSearch(size=10_000), box, rng=np.random.default_rng(0))
    grid = (np.arange(10_000) + 0.5) / 10_000
    for _ in range(2):
        points = search.ask()
        search.tell(np.zeros(10_000), np.zeros(10_000))
        for row in (points - box.lower[:, None]) / box.width[:, None]:
            # The Kolmogorov distance of n draws exceeds 1.95 / sqrt(n) once in 1,000.
            assert np.abs(np.sort(row) - grid).max() < 1.95 / 100


def test_refuses_an_empty_generation() -> None:
    with pytest.raises(InvalidSettingsError, match="size must be an integer"):
        RandomSearch(size=0)
