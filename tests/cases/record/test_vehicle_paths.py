"""Vehicles are found in a record by the names of their states."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmstart.cases.record.files import RecordError
from swarmstart.cases.record.results import Record
from swarmstart.cases.record.vehicle_paths import paths_of
from swarmstart.export.paths import ExportError

TIMES = np.array([0.0, 0.5, 1.0])


def record_of(*names: str, times: Any = TIMES) -> Record:
    """Return a record whose state number k has the value k + time."""
    path = np.arange(len(names))[:, None] + np.asarray(times)
    return Record(
        folder=Path("somewhere"), summary={},
        arrays={
            "state_names": np.array(names), "dense_times": np.asarray(times),
            "dense_states": path,
        },
    )  # fmt: skip


def test_vehicles_have_the_ends_of_the_names() -> None:
    record = record_of("x_m_0", "y_m_0", "z_m_0", "vx_m_s_0", "x_m_1", "y_m_1", "z_m_1")
    first, second = paths_of(record)
    assert (first.name, second.name) == ("0", "1")
    np.testing.assert_array_equal(second.positions.T, record.arrays["dense_states"][4:])
    np.testing.assert_array_equal(second.times, TIMES)


def test_one_system_has_no_name_and_a_plane_has_the_height_that_is_given() -> None:
    (path,) = paths_of(record_of("x", "vx", "y", "vy"), height=3.0)
    assert path.name == "flight"
    assert path.positions.tolist() == [[0, 2, 3], [0.5, 2.5, 3], [1, 3, 3]]


def test_names_can_be_given() -> None:
    record = record_of("east_red", "north_red", "up_red", "east_blue")
    (red,) = paths_of(record, ("east", "north", "up"))
    assert red.name == "red"


@pytest.mark.parametrize(
    ("names", "given", "said"),
    [
        (("angle", "speed"), (), "expected states x_m, y_m, z_m or x_m, y_m or x, y"),
        (("x", "y"), ("x", "w"), "expected states x, w of a vehicle.*found x, y"),
        (("xylophone", "yard"), (), "expected states"),
        (("x_../../etc", "y_../../etc"), (), "letters, digits, _ and -, found"),
    ],
)
def test_records_without_vehicles_and_with_strange_names_are_refused(
    names: tuple[str, ...], given: tuple[str, ...], said: str
) -> None:
    with pytest.raises(RecordError, match=said):
        paths_of(record_of(*names), given)


def test_of_a_jump_the_state_after_it_counts() -> None:
    times = np.array([0.0, 0.5, 0.5, 1.0])
    record = record_of("x", "y", times=times)
    record.arrays["dense_states"][0] = [0.0, 1.0, 5.0, 6.0]
    (path,) = paths_of(record)
    assert path.times.tolist() == [0.0, 0.5, 1.0]
    assert path.positions[:, 0].tolist() == [0.0, 5.0, 6.0]


@pytest.mark.parametrize(
    ("times", "path"),
    [
        ([0.0, 1.0], np.zeros((1, 2))),
        ([0.0, 1.0], np.zeros((2, 3))),
        ([[0.0]], np.zeros((2, 1))),
    ],
)
def test_a_record_without_a_state_for_each_name_and_time_is_refused(
    times: Any, path: Any
) -> None:
    record = record_of("x", "y")
    arrays = {**record.arrays, "dense_times": np.array(times), "dense_states": path}
    with pytest.raises(RecordError, match="expected a state for each of 2 names"):
        paths_of(replace(record, arrays=arrays))


def test_times_that_fall_are_refused() -> None:
    with pytest.raises(ExportError, match="vehicle flight: expected times that rise"):
        paths_of(record_of("x", "y", times=[0.0, 2.0, 1.0]))
