"""`swarmstart report` and `swarmstart open`: the pages of records, made and shown.

The first makes pages of the records of other commands. The second opens the page or a
figure of a record in the program that the system has for it.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, NamedTuple

from swarmstart.cases.commands.terminal import DONE, answer, say
from swarmstart.cases.format.document import counted, shown
from swarmstart.cases.record.files import RecordError, locked, said, write_text
from swarmstart.cases.record.record import FIGURES

SUFFIXES = {"html": "html", "md": "md", "latex": "tex"}
DEFAULT = ("html", "md")
_REPORT = "swarmstart.cases.drawing.report."


class Recorded(NamedTuple):
    """A sort of record, and the functions that make pages of it.

    Attributes:
        file: The file in the folder by which the record is recognised.
        name: Name of this sort of record in messages.
        makers: Format -> "module:function" that makes the page.
        takes: Argument that the functions take: "folder", or "content" of the file.
    """

    file: str
    name: str
    makers: Mapping[str, str]
    takes: str


RECORDED = (
    Recorded(
        "comparison.json",
        "comparison",
        {
            "html": f"{_REPORT}pages.comparison_page:comparison_page",
            "md": f"{_REPORT}text_reports:comparison_markdown",
            "latex": f"{_REPORT}text_reports:comparison_latex",
        },
        "content",
    ),
    Recorded(
        "seeds.json",
        "runs over seeds",
        {
            "html": f"{_REPORT}pages.seeds_page:seeds_page",
            "md": f"{_REPORT}pages.seeds_page:seeds_markdown",
            "latex": f"{_REPORT}pages.seeds_page:seeds_latex",
        },
        "content",
    ),
    Recorded(
        "run.json",
        "run",
        {
            "html": f"{_REPORT}pages.run_page:run_page",
            "md": f"{_REPORT}pages.run_page:run_markdown",
            "latex": f"{_REPORT}pages.run_page:run_latex",
        },
        "folder",
    ),
    Recorded(
        "replication.json",
        "replication",
        {
            "html": f"{_REPORT}pages.replication_page:replication_page",
            "md": f"{_REPORT}text_reports:replication_markdown",
            "latex": f"{_REPORT}text_reports:replication_latex",
        },
        "content",
    ),
)
"""Sorts of records that a folder may hold; of several the newest is shown."""
WITH_FOLDER = ("replication_page",)
"""Makers that take the folder as a second argument, to show its figures."""
PAGES = ("report.html", "replication*.html")
"""Pages of a record, the one to open first."""
SHEET = "a_sheet"
"""Stem of the figure that shows a run on one sheet."""
ENDINGS = (".png", ".svg", ".pdf", ".gif", ".mp4")
"""Endings of files of figures; if a figure has several, the first one is opened."""
REPORTED = ("run.json", "seeds.json", "comparison.json", "replication*.json")
"""Files of which a record's folder has one, if there is a page for such records."""
MARKS = (*REPORTED, "sweep.json")
"""Files of which a record's folder has one."""
DEEPEST = 3
"""Number of levels below the given folder on which records are looked for."""
MOST_FOLDERS = 10_000
LONGEST = 1000
"""Largest number of characters of a path."""
START_S = 10.0
"""Time in which the system's program has to start [s]."""


def report_command(options: argparse.Namespace) -> int:
    """Write the pages that the options ask for; return the exit code."""
    formats = list(dict.fromkeys(options.formats or DEFAULT))
    given = [Path(text) for text in dict.fromkeys(options.folders)]
    folders = list(dict.fromkeys(map(_newest, given)))
    found = [(folder, recorded_in(folder)) for folder in folders]
    written: list[str] = []
    for folder, (recorded, *older) in found:
        if older:
            others = ", ".join(one.file for one in older)
            say(f"{folder}: shows the newest record, {recorded.file}; older: {others}")
        out = folder if options.out is None else Path(options.out)
        # Pages of several records in one folder are named after their records.
        stem = "report" if len(folders) == 1 or out == folder else folder.name
        with locked(out):
            pages = {}
            for name in formats:
                file = out / f"{stem}.{SUFFIXES[name]}"
                pages[name] = page_of(folder, recorded, name)
                write_text(file, pages[name])
                written.append(f"page  {file}")
            if options.charts:
                charts = out / f"{stem}_charts"
                page = pages.get("html") or page_of(folder, recorded, "html")
                count = _write_charts(page, charts, options.charts)
                written.append(f"charts  {charts} ({counted(count, 'file')})")
    answer("\n".join(written))
    return DONE


def _write_charts(page: str, charts: Path, formats: Sequence[str]) -> int:
    """Write the charts of an HTML page as files; return how many files these are."""
    # Not at the head: pages as Markdown need no matplotlib.
    from swarmstart.cases.drawing.drawing import write_figures
    from swarmstart.cases.drawing.report.chart_files import chart_figures

    chosen = list(dict.fromkeys(formats))
    return len(write_figures(chart_figures(page), charts, formats=chosen))


def recorded_in(folder: Path) -> list[Recorded]:
    """Return the records in a folder, the newest first.

    Raises:
        RecordError: If the folder holds no record.
    """
    # `replicate --only 9` leaves replication-9.json; the last entry is that of these.
    some = [f.name for f in sorted(folder.glob("replication-*.json"))]
    every = [*RECORDED, *(RECORDED[-1]._replace(file=name) for name in some)]
    found = [recorded for recorded in every if (folder / recorded.file).exists()]
    if found:
        times = {one.file: (folder / one.file).stat().st_mtime for one in found}
        return sorted(found, key=lambda one: -times[one.file])
    names = ", ".join(recorded.file for recorded in RECORDED)
    raise RecordError(
        f"{folder}: expected a folder that run, compare or replicate wrote, with one "
        f"of {names}; found none of them"
    )


def page_of(folder: Path, recorded: Recorded, form: str) -> str:
    """Return a record as a page or a table; `form` is a key of SUFFIXES.

    Raises:
        RecordError: If the record is damaged.
    """
    make: Callable[..., str] = resolve_name(recorded.makers[form])
    arguments: list[Any] = [folder]
    if recorded.takes == "content":
        arguments = [content_in(folder, recorded)]
        if make.__name__ in WITH_FOLDER:
            arguments.append(folder)
    try:
        return make(*arguments)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        # A record of another version lacks keys, or has other values under them.
        raise RecordError(
            f"{folder / recorded.file}: expected a whole {recorded.name} as this "
            f"version writes it, found another one: {error!r}"
        ) from error


def content_in(folder: Path, recorded: Recorded) -> Mapping[str, Any]:
    """Return the content of a record's file.

    Raises:
        RecordError: If the file cannot be read, or has other content.
    """
    file = folder / recorded.file
    if recorded.name == "comparison":
        from swarmstart.cases.campaign.judging.content import read_comparison

        return read_comparison(file)
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RecordError(f"{file}: expected a record: {said(error)}") from error
    if not isinstance(content, dict):
        raise RecordError(f"{file}: expected a {recorded.name}, found another file")
    return content


def _newest(folder: Path) -> Path:
    """Return a folder of a record; of a folder of records the newest, and say which."""
    try:
        recorded_in(folder)
    except RecordError:
        below = _newest_records(folder, REPORTED)
        if not below:
            raise
        say(f"{folder}: the newest record below is {below[0]}")
        return below[0]
    return folder


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
    """Return the file to show of a record, or of the newest record in a folder.

    Raises:
        RecordError: If there is no record, or no page and no figure.
    """
    # The system refuses such paths with errors of several classes.
    if len(str(folder)) > LONGEST or "\0" in str(folder):
        raise RecordError(f"{shown(str(folder))}: expected the path of a folder")
    if any(True for _ in _matching(folder, (*MARKS, *PAGES))):
        records = [folder]
    else:
        records = _newest_records(folder, MARKS)
    for record in records:
        file = _shown_file(record)
        if file is not None:
            return file
    if records:
        raise RecordError(
            f"{folder}: expected a record with a page or figures, found none; "
            "swarmstart report makes a page of a record"
        )
    missing = "" if folder.is_dir() else "; there is no such folder"
    raise RecordError(
        f"{folder}: expected a folder that run, sweep, compare or replicate wrote, or "
        f"one of such folders{missing}"
    )


def opener() -> list[str] | None:
    """Return the command that opens a file; None if there is no display."""
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
            # In a session of its own Ctrl-C here does not end the program.
            stdin=silent, stdout=silent, stderr=silent, start_new_session=True,
        )  # fmt: skip
        return process.wait(START_S) == 0
    except subprocess.TimeoutExpired:  # It shows the file and waits for its end.
        return True
    except OSError:
        return False


def _newest_records(folder: Path, of: Sequence[str]) -> list[Path]:
    """Return the folders below that have one of some marks, the newest first."""
    return [record for _, record in sorted(_records_below(folder, of), reverse=True)]


def _records_below(folder: Path, of: Sequence[str]) -> Iterator[tuple[float, Path]]:
    """Yield records below a folder, each with the time of its last change."""
    for seen, (place, folders, files) in enumerate(os.walk(folder)):
        here = Path(place)
        marks = [*_matching(here, of)] if files else []
        if marks:
            yield max(file.stat().st_mtime for file in marks), here
        if marks or len(here.relative_to(folder).parts) >= DEEPEST:
            # os.walk then goes no deeper here.
            folders.clear()
        # A folder such as / would take minutes.
        if seen > MOST_FOLDERS:
            return


def _matching(folder: Path, patterns: Sequence[str]) -> Iterator[Path]:
    """Yield the files of a folder that match patterns, in the order of these."""
    for pattern in patterns:
        yield from sorted(file for file in folder.glob(pattern) if file.is_file())


def _shown_file(record: Path) -> Path | None:
    """Return the page of a record, else its first figure; None if it has neither."""
    for page in _matching(record, PAGES):
        # Absolute, since the program may run in another folder.
        return page.absolute()
    figures = [f for f in (record / FIGURES).glob("*.*") if f.suffix in ENDINGS]
    # The sheet, else the first figure by name, in the first of its formats.
    best = min(
        figures,
        key=lambda f: (f.stem != SHEET, f.stem, ENDINGS.index(f.suffix)),
        default=None,
    )
    return None if best is None else best.absolute()
