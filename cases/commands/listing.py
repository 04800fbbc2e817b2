"""`swarmstart list`: what there is. Imports nothing heavy."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from swarmstart.cases.commands.output import answer
from swarmstart.cases.format.document import shown
from swarmstart.cases.format.registry import KINDS, POLISHES, SEARCHES
from swarmstart.cases.format.scenario import shipped
from swarmstart.errors import SwarmstartError

_TITLE = re.compile(r"^title: *[\"']?(.*?)[\"']? *$", re.MULTILINE)


class NothingListedError(SwarmstartError, LookupError):
    """Nothing in the list contains the text asked for."""


def listing(text: str = "") -> dict[str, dict[str, Any]]:
    """Return scenarios, searches, polishes, and measures by kind of scenario.

    Args:
        text: Only entries that contain it, in name or title, or whose heading does.

    Raises:
        NothingListedError: If nothing has it.
    """
    everything = {
        "scenarios": {name: _title(path) for name, path in shipped().items()},
        "searches": {name: entry.title for name, entry in SEARCHES.items()},
        "polishes": dict(POLISHES),
    }
    found: dict[str, dict[str, Any]] = {
        heading: _containing(text, heading, entries)
        for heading, entries in everything.items()
    }
    found["measures"] = {
        kind: _containing(
            text, f"measures of {kind}", dict(resolve_name(entry.measures))
        )
        for kind, entry in KINDS.items()
    }
    if not any((*found["measures"].values(), *(found[name] for name in everything))):
        raise NothingListedError(
            f"expected a text that something in the list contains, found {shown(text)}"
        )
    return found


def print_listing(text: str, *, as_json: bool) -> None:
    """Print the listing, as one JSON object or for a person.

    Args:
        text: As in `listing`.
        as_json: Whether as JSON.
    """
    found = listing(text)
    if as_json:
        answer(json.dumps({"schema": 1, **found}))
        return
    measures = found.pop("measures")
    sections = {**found, **{f"measures of {kind}": measures[kind] for kind in measures}}
    parts = [_section(heading, entries) for heading, entries in sections.items()]
    answer("\n\n".join(filter(None, parts)))


def _containing(text: str, heading: str, entries: Mapping[str, str]) -> dict[str, str]:
    """Return the entries with a text in name or title; all, if the heading has it."""
    wanted = text.casefold()
    return {
        name: title
        for name, title in entries.items()
        if wanted in f"{heading}\n{name}\n{title}".casefold()
    }


def _section(heading: str, entries: Mapping[str, str]) -> str:
    """Return a heading and its entries, a line each; empty without any."""
    if not entries:
        return ""
    width = max(map(len, entries))
    return "\n".join(
        [heading, *(f"  {name.ljust(width)}  {text}" for name, text in entries.items())]
    )


def _title(path: Path) -> str:
    """Return a shipped scenario's title without parsing all of it."""
    found = _TITLE.search(path.read_text(encoding="utf-8"))
    return found.group(1) if found else ""
