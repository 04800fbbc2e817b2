"""Runs of one scenario over seeds."""

import numpy as np

from swarmstart.cases.campaign.running.seeds import bands, spread_of


def test_a_band_is_the_quantiles_of_the_runs_at_each_instant() -> None:
    """Runs x = k t on grids of their own: at every instant quantiles of k, times t."""
    tracks = [
        {
            "time": list(np.linspace(0, 2 + k, 5 + k)),
            "states": {"x": list(k * np.linspace(0, 2 + k, 5 + k))},
        }
        for k in range(11)
    ]
    found = bands(tracks)
    assert found is not None
    assert found["time"][-1] == 2
    time = np.array(found["time"])
    for side, k in (("low", 1), ("median", 5), ("high", 9)):
        np.testing.assert_allclose(found["states"]["x"][side], k * time, atol=1e-12)


def test_no_path_has_no_band_and_a_gap_stays_one() -> None:
    assert bands([]) is None
    gap = {"time": [0.0, 1.0], "states": {"x": [0.0, None]}}
    found = bands([gap])
    assert found is not None and found["states"]["x"]["median"][-1] is None


def test_a_measure_is_told_with_how_often_it_is_undefined() -> None:
    assert spread_of([3.0, None, 1.0, 2.0]) == ("1", "2", "3", "undefined in 1")
    assert spread_of([[1.0, None, 5.0], [2.0]]) == ("2", "3.5", "5", "")
    assert spread_of([None, []])[3] == "undefined in 2"
