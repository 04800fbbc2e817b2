"""The page of a run, its measures and claims as Markdown and LaTeX, too.

The page has the steps of the run as a table and as a file to download.
"""

import math
import urllib.parse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swarmstart.cases.drawing.page import rendered
from swarmstart.cases.drawing.report.figure import csv_of
from swarmstart.cases.drawing.report.pages.run_content import (
    CLAIM_HEADS,
    MEASURE_HEADS,
    RunContent,
    run_content,
)
from swarmstart.cases.drawing.report.pictures import PAGE_BYTES, pictures_of
from swarmstart.cases.drawing.report.player import player
from swarmstart.cases.drawing.report.text_reports import (
    latex_table,
    latex_text,
    markdown_table,
    markdown_text,
)
from swarmstart.cases.drawing.report.tracks import Tracks
from swarmstart.cases.drawing.wording import shown

VERDICTS = {"holds": "good", "does not hold": "bad", "not judged": "mid"}

STEP_HEADS = ("step", "begins [s]", "length [s]", "solver's time [s]", "plan")
MOST_SHOWN, MOST_SAVED = 200, 5000
"""Rows in the table, and in the file; longer ones would make the page too large."""


def run_page(folder: Path) -> str:
    """Return the page of a run: one HTML file below 3 MB that loads nothing.

    Args:
        folder: Folder of a record of `swarmstart run`.

    Raises:
        RecordError: If there is no record, or it is damaged.
        SwarmstartError: If the record's scenario cannot be read.
    """
    return page_of(run_content(folder))


def page_of(content: RunContent) -> str:
    """Return the page with the content of a run's record."""
    parts = {
        "content": content,
        "flight": player(content.tracks),
        "steps": step_table(content.tracks),
        "verdicts": VERDICTS,
        "pictures": [],
    }
    # 20 kB for the tags and captions of the pictures, which are not in it yet.
    room = PAGE_BYTES - len(rendered("run_page.html.j2", parts).encode()) - 20_000
    pictures = pictures_of(
        content.record.folder, content.figures, content.kind, room=room
    )
    return rendered("run_page.html.j2", {**parts, "pictures": pictures})


def run_markdown(folder: Path) -> str:
    """Return headline, measures and claims of a run as Markdown."""
    content = run_content(folder)
    parts = [
        f"# {markdown_text(content.title)}",
        markdown_text(content.headline),
        *map(markdown_text, content.why),
        "## Measures",
        markdown_table(MEASURE_HEADS, measure_cells(content)),
    ]
    if content.claims:
        parts += ["## Claims", markdown_table(CLAIM_HEADS, claim_cells(content))]
    limits = "\n".join(f"- {markdown_text(line)}" for line in content.limits)
    parts += ["## Limits", limits, "## Again", f"    {content.command}"]
    return "\n\n".join(parts) + "\n"


def run_latex(folder: Path) -> str:
    """Return headline, measures and claims of a run as LaTeX.

    The tables need the packages booktabs, longtable and textcomp.
    """
    content = run_content(folder)
    parts = [
        r"% Needs \usepackage[T1]{fontenc}, \usepackage{booktabs,longtable,textcomp}.",
        latex_text(" ".join([content.headline, *content.why])),
        latex_table(
            MEASURE_HEADS, measure_cells(content), columns="lrlp{6cm}",
            title=f"{content.title}: measures",
        ),
    ]  # fmt: skip
    if content.claims:
        parts.append(
            latex_table(
                CLAIM_HEADS, claim_cells(content),
                columns="llrp{3cm}p{5cm}p{2cm}", title=f"{content.title}: claims",
            )
        )  # fmt: skip
    return "\n\n".join(parts) + "\n"


def measure_cells(content: RunContent) -> list[tuple[str, ...]]:
    """Return the rows of the table of measures."""
    return [(row.name, row.text, row.unit, row.meaning) for row in content.measures]


def claim_cells(content: RunContent) -> list[tuple[str, ...]]:
    """Return the rows of the table of claims."""
    return [
        (row.id, row.verdict, row.measured, row.asked, row.text, row.source)
        for row in content.claims
    ]


@dataclass(frozen=True, kw_only=True, slots=True)
class StepTable:
    """The steps of a run.

    Attributes:
        rows: Cells of the first steps, as in STEP_HEADS.
        steps: Number of all steps.
        saved: Number of steps in the file to download.
        address: File with the steps, as a data URI of CSV.
    """

    rows: Sequence[Sequence[str]]
    steps: int
    saved: int
    address: str
    heads: Sequence[str] = STEP_HEADS


def step_table(tracks: Tracks) -> StepTable | None:
    """Return the table of steps; None if one plan is carried out to its end."""
    if tracks.is_one_plan or not tracks.step_seconds.size:
        return None
    steps = tracks.step_seconds.size
    rows: list[list[Any]] = []
    for step in range(min(steps, MOST_SAVED)):
        begin, end = (float(time) for time in tracks.step_times[step : step + 2])
        seconds = float(tracks.step_seconds[step])
        known = seconds if math.isfinite(seconds) else None  # An empty cell of CSV.
        rows.append([step, begin, end - begin, known, _plan(tracks, step)])
    text = csv_of([list(STEP_HEADS), *rows])
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
