"""The steps of a run as a table and as a file to download."""

import math
import urllib.parse
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from swarmstart.cases.drawing.naming.units import shown
from swarmstart.cases.drawing.report.figure import csv_of
from swarmstart.cases.drawing.report.tracks import Tracks

HEADS = ("step", "begins [s]", "length [s]", "solver's time [s]", "plan")
MOST_SHOWN, MOST_SAVED = 200, 5000
"""Rows in the table, and in the file; longer ones would make the page too large."""


@dataclass(frozen=True, kw_only=True, slots=True)
class StepTable:
    """The steps of a run.

    Attributes:
        rows: Cells of the first steps, as in HEADS.
        steps: Number of all steps.
        saved: Number of steps in the file.
        address: The file as a data URI of CSV.
    """

    rows: Sequence[Sequence[str]]
    steps: int
    saved: int
    address: str
    heads: Sequence[str] = HEADS


def step_table(tracks: Tracks) -> StepTable | None:
    """Return the time of each step; None if one plan is carried out to its end."""
    if tracks.is_one_plan or not tracks.step_seconds.size:
        return None
    steps = tracks.step_seconds.size
    rows: list[list[Any]] = []
    for step in range(min(steps, MOST_SAVED)):
        begin, end = (float(time) for time in tracks.step_times[step : step + 2])
        seconds = float(tracks.step_seconds[step])
        known = seconds if math.isfinite(seconds) else None
        rows.append([step, begin, end - begin, known, _plan(tracks, step)])
    text = csv_of([list(HEADS), *rows])
    return StepTable(
        rows=[[shown(cell) for cell in row] for row in rows[:MOST_SHOWN]],
        steps=steps,
        saved=len(rows),
        address="data:text/csv;charset=utf-8," + urllib.parse.quote(text),
    )


def _plan(tracks: Tracks, step: int) -> str:
    if tracks.without_plan[step : step + 1].any():
        return "no feasible plan"
    if tracks.linear_breaks[step : step + 1].any():
        return "linear law, breaks a constraint"
    return "feasible"
