"""`swarmstart open`: the figures or the page of a record, in the system's program."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from swarmstart.cases.commands.terminal.output import DONE, answer, say
from swarmstart.cases.format.document import shown
from swarmstart.cases.record.files import RecordError
from swarmstart.cases.record.record import FIGURES

PAGES = ("report.html", "replication*.html")
"""Pages of a record, the one to open first."""
SHEET = "a_sheet"
"""Stem of the figure that shows a run on one sheet."""
ENDINGS = (".png", ".svg", ".pdf", ".gif", ".mp4")
"""Files of figures; of one figure the first of these is opened."""
MARKS = ("run.json", "seeds.json", "comparison.json", "replication*.json")
"""Files that a folder of a record has one of."""
DEEPEST = 3
"""Folders below the given one in which a record is looked for."""
MOST_FOLDERS = 10_000
LONGEST = 1000
"""Characters of a path."""
START_S = 10.0
"""Time in which the system's program has to start [s]."""


def open_command(options: argparse.Namespace) -> int:
    """Print the path of the page or figure of a record, and open it if possible.

    Raises:
        RecordError: If there is no record, or neither a page nor a figure in it.
    """
    file = newest_file(Path(options.folder))
    answer(str(file))
    program = opener()
    if program is None:
        say("no display was found; open the file above with a program of your own")
    elif not _opened(program, file):
        say(f"{program[0]} could not open it; open the file above yourself")
    return DONE


def newest_file(folder: Path) -> Path:
    """Return the file to show of a record; of a folder of records, of the newest.

    Raises:
        RecordError: If there is no record, or no page and no figure.
    """
    if len(str(folder)) > LONGEST or "\0" in str(folder):
        raise RecordError(f"{shown(str(folder))}: expected the path of a folder")
    if any(True for _ in _matching(folder, (*MARKS, *PAGES))):
        records = [folder]
    else:
        records = newest_records(folder)
    for record in records:
        file = shown_file(record)
        if file is not None:
            return file
    if records:
        raise RecordError(
            f"{folder}: expected a record with a page or figures, found none; "
            "swarmstart report makes a page of a record"
        )
    missing = "" if folder.is_dir() else "; there is no such folder"
    raise RecordError(
        f"{folder}: expected a folder that run, compare or replicate wrote, or one "
        f"of such folders{missing}"
    )


def newest_records(folder: Path) -> list[Path]:
    """Return the folders of records below a folder, the newest first."""
    return [record for _, record in sorted(_records_below(folder), reverse=True)]


def _records_below(folder: Path) -> Iterator[tuple[float, Path]]:
    """Yield records below a folder, each with the time of its last change."""
    for seen, (place, folders, files) in enumerate(os.walk(folder)):
        here = Path(place)
        marks = [*_matching(here, MARKS)] if files else []
        if marks:
            yield max(file.stat().st_mtime for file in marks), here
        if marks or len(here.relative_to(folder).parts) >= DEEPEST:
            folders.clear()
        if seen > MOST_FOLDERS:
            return


def _matching(folder: Path, patterns: Sequence[str]) -> Iterator[Path]:
    """Yield the files of a folder that match patterns, in the order of these."""
    for pattern in patterns:
        yield from sorted(file for file in folder.glob(pattern) if file.is_file())


def shown_file(record: Path) -> Path | None:
    """Return the page of a record, else its first figure; None if it has neither."""
    for page in _matching(record, PAGES):
        return page.absolute()
    figures = [f for f in (record / FIGURES).glob("*.*") if f.suffix in ENDINGS]
    best = min(
        figures,
        key=lambda f: (f.stem != SHEET, f.stem, ENDINGS.index(f.suffix)),
        default=None,
    )
    return None if best is None else best.absolute()


def opener() -> list[str] | None:
    """Return the command that opens a file; None: there is no display for it."""
    if sys.platform == "darwin":
        return ["open"]
    if sys.platform == "win32":
        return ["explorer"]
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return None
    found = shutil.which("xdg-open")
    return None if found is None else [found]


def _opened(program: list[str], file: Path) -> bool:
    """Return whether the program has opened a file, or is still at it."""
    silent = subprocess.DEVNULL
    try:
        process = subprocess.Popen(
            [*program, str(file)],
            stdin=silent, stdout=silent, stderr=silent, start_new_session=True,
        )  # fmt: skip
        return process.wait(START_S) == 0
    except subprocess.TimeoutExpired:  # It shows the file and waits for its end.
        return True
    except OSError:
        return False
