"""steps.csv: a line for each step, with its time and the origin of its plans."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import numpy as np

from swarmstart.cases.record.trajectory_arrays import step_table
from swarmstart.ocp import Trajectory


def test_each_step_has_its_beginning_its_time_and_the_origin_of_each_plan(
    named_flight: Trajectory,
) -> None:
    rows = list(csv.DictReader(io.StringIO(step_table(named_flight))))
    steps = len(named_flight.decisions)
    assert [row["step"] for row in rows] == [str(step) for step in range(steps)]
    np.testing.assert_allclose(
        [[float(row["time_s"]), float(row["step_seconds"])] for row in rows],
        np.transpose([named_flight.times[:-1], named_flight.step_seconds]),
        rtol=1e-5,  # Six digits are written.
    )
    for row, decision in zip(rows, named_flight.decisions, strict=True):
        assert row["plan_1"] == decision.plans[0].source.name


def test_a_time_that_is_not_known_is_empty(named_flight: Trajectory) -> None:
    unknown = np.full_like(named_flight.step_seconds, np.nan)
    rows = step_table(replace(named_flight, step_seconds=unknown)).splitlines()
    assert rows[1].split(",")[:3] == ["0", "0", ""]
