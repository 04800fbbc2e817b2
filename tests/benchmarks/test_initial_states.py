"""The page on many initial states of one problem, made again in a short form."""

from swarmstart.benchmarks.initial_states import compared


def test_few_initial_states_are_all_confirmed_and_as_good_as_ipopt() -> None:
    found = compared("brachistochrone", instances=20, solves=4)
    assert found.confirmed == 20 and found.solved == 4
    assert found.as_good == 1.0 and found.ours_ms > 0 < found.cold_ms
