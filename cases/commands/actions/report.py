"""`swarmstart report`: pages of the records of other commands."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, NamedTuple

from swarmstart.cases.commands.actions.opening import newest_records
from swarmstart.cases.commands.terminal.output import DONE, answer, say
from swarmstart.cases.record.files import RecordError, locked, said, write_text

SUFFIXES = {"html": "html", "md": "md", "latex": "tex"}
DEFAULT = ("html", "md")
_REPORT = "swarmstart.cases.drawing.report."


class Recorded(NamedTuple):
    """A sort of record, and the functions that make pages of it.

    Attributes:
        file: The file in the folder by which the record is recognised.
        name: Its name in messages.
        makers: Format -> "module:function" that makes the page.
        takes: The argument of that function: "folder", or "content" of the file.
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
            "md": f"{_REPORT}markdown:comparison_markdown",
            "latex": f"{_REPORT}latex:comparison_latex",
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
            "md": f"{_REPORT}pages.replication_text:replication_markdown",
            "latex": f"{_REPORT}pages.replication_text:replication_latex",
        },
        "content",
    ),
)
"""Records that a folder may hold; the first one found is shown."""
WITH_FOLDER = ("replication_page",)
"""Makers that take the folder as a second argument, to show its figures."""


def report_command(options: argparse.Namespace) -> int:
    """Write the pages that the options ask for; return the exit code."""
    formats = list(dict.fromkeys(options.formats or DEFAULT))
    given = [Path(text) for text in dict.fromkeys(options.folders)]
    folders = list(dict.fromkeys(map(_newest, given)))
    found = [(folder, recorded_in(folder)) for folder in folders]
    written = []
    for folder, recorded in found:
        out = folder if options.out is None else Path(options.out)
        stem = "report" if len(folders) == 1 or out == folder else folder.name
        with locked(out):
            for name in formats:
                file = out / f"{stem}.{SUFFIXES[name]}"
                write_text(file, page_of(folder, recorded, name))
                written.append(file)
    answer("\n".join(f"page  {file}" for file in written))
    return DONE


def _newest(folder: Path) -> Path:
    """Return a folder of a record; of a folder of records the newest, and say which."""
    try:
        recorded_in(folder)
    except RecordError:
        below = newest_records(folder)
        if not below:
            raise
        say(f"{folder}: the newest record below is {below[0]}")
        return below[0]
    return folder


def recorded_in(folder: Path) -> Recorded:
    """Return the sort of record in a folder.

    Raises:
        RecordError: If the folder holds no record.
    """
    for recorded in RECORDED:
        if (folder / recorded.file).exists():
            return recorded
    # `replicate --only 9` leaves replication-9.json.
    for file in sorted(folder.glob("replication-*.json")):
        return RECORDED[-1]._replace(file=file.name)
    names = ", ".join(recorded.file for recorded in RECORDED)
    raise RecordError(
        f"{folder}: expected a folder that run, compare or replicate wrote, with one "
        f"of {names}; found none of them"
    )


def page_of(folder: Path, recorded: Recorded, form: str) -> str:
    """Return a record as a page or a table.

    Args:
        folder: The folder of the record.
        recorded: The sort of record.
        form: A key of SUFFIXES.

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
        raise RecordError(
            f"{folder / recorded.file}: expected a whole {recorded.name} as this "
            f"version writes it, found another one: {error!r}"
        ) from error


def content_in(folder: Path, recorded: Recorded) -> Mapping[str, Any]:
    """Return the content of a record's file.

    Raises:
        RecordError: If it cannot be read or is another file.
    """
    file = folder / recorded.file
    if recorded.name == "comparison":
        from swarmstart.cases.campaign.judging.comparison_file import read_comparison

        return read_comparison(file)
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RecordError(f"{file}: expected a record: {said(error)}") from error
    if not isinstance(content, dict):
        raise RecordError(f"{file}: expected a {recorded.name}, found another file")
    return content
