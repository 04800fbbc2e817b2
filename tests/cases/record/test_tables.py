"""Results as tables of pandas, and the message without pandas."""

import sys

import numpy as np
import pytest

from swarmstart.errors import MissingPackageError
from swarmstart.ocp import Solution, Trajectory

COLUMNS = ["place", "speed", "push"]


def test_a_solution_has_a_row_a_node(solution: Solution) -> None:
    pytest.importorskip("pandas")
    table = solution.to_dataframe()
    assert [*table.columns] == COLUMNS and table.index.name == "time [s]"
    np.testing.assert_array_equal(table.index, solution.times)
    np.testing.assert_array_equal(table[["place", "speed"]].T, solution.states)
    # Two checks an interval: each control is held over two rows.
    np.testing.assert_array_equal(table["push"][:-1:2], solution.controls[0])
    np.testing.assert_array_equal(table["push"][1::2], solution.controls[0])
    assert np.isnan(table["push"].iloc[-1])


def test_a_flight_has_a_row_a_control_instant(named_flight: Trajectory) -> None:
    pytest.importorskip("pandas")
    table = named_flight.to_dataframe()
    assert [*table.columns] == COLUMNS
    np.testing.assert_array_equal(table["speed"], named_flight.states[1])
    np.testing.assert_array_equal(table["push"][:-1], named_flight.controls[0])


def test_without_pandas_one_sentence_says_how_to_get_it(
    solution: Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(
        MissingPackageError, match=r"pip install 'swarmstart\[pandas\]'"
    ):
        solution.to_dataframe()
