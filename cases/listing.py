"""`swarmstart list`: what there is. Imports nothing heavy."""

import json
import re
from pathlib import Path
from typing import Any

from swarmstart.cases.registry import KINDS, POLISHES, SEARCHES, load
from swarmstart.cases.scenario import shipped

_TITLE = re.compile(r"^title: *[\"']?(.*?)[\"']? *$", re.MULTILINE)


def listing() -> dict[str, dict[str, Any]]:
    """Return scenarios, searches, polishes, and measures by kind of scenario."""
    return {
        "scenarios": {name: _title(path) for name, path in shipped().items()},
        "searches": {name: entry.title for name, entry in SEARCHES.items()},
        "polishes": dict(POLISHES),
        "measures": {name: dict(load(entry.measures)) for name, entry in KINDS.items()},
    }


def print_listing(*, as_json: bool) -> None:
    """Print the listing, as one JSON object or for a person."""
    everything = listing()
    if as_json:
        print(json.dumps({"schema": 1, **everything}))  # noqa: T201
        return
    for heading in ("scenarios", "searches", "polishes"):
        _print_section(heading, everything[heading])
    for kind, measures in everything["measures"].items():
        _print_section(f"measures of {kind}", measures)


def _print_section(heading: str, entries: dict[str, str]) -> None:
    width = max(map(len, entries), default=0)
    print(heading)  # noqa: T201
    for name, text in entries.items():
        print(f"  {name.ljust(width)}  {text}")  # noqa: T201
    print()  # noqa: T201


def _title(path: Path) -> str:
    """Return a shipped scenario's title without parsing all of it."""
    found = _TITLE.search(path.read_text(encoding="utf-8"))
    return found.group(1) if found else ""
