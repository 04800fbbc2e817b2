"""`swarmstart list`: scenarios, searches, polishes, measures and kinds.

Imports nothing heavy: scenarios are not parsed, their first keys are found in the text.

Run times of the shipped scenarios are rough. They were measured once, one scenario
after the other, with seed 0 and figures, after machine code had been compiled: the CPU
time on a machine that others used as well. They only distinguish seconds from minutes.
"""

import argparse
import importlib.resources
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from swarmstart.cases.commands.terminal import DONE, answer, wrapped_table
from swarmstart.cases.commands.wording.measures import (
    measures_of_kinds,
    measures_of_one,
)
from swarmstart.cases.format.document import meant, shown
from swarmstart.cases.format.registry import KINDS, POLISHES, SEARCHES, words_of
from swarmstart.cases.format.scenario import by_name, hard_problems, shipped
from swarmstart.errors import SwarmstartError

SCHEMA = 2
"""Version of what --json prints."""
_FILE = importlib.resources.files("swarmstart.cases") / "scenarios" / "run_times.json"
_BEST_KNOWN = importlib.resources.files("swarmstart.cases") / "hard" / "best_known.json"
RUN_TIMES_S: dict[str, float] = json.loads(_FILE.read_text(encoding="utf-8"))
"""Name of a scenario -> time of `swarmstart run` [s]."""
_STEPS_S = (1, 2, 5, 10, 20, 30)
_MINUTE_S = 60.0
_TITLE = re.compile(r"^title: *[\"']?(.*?)[\"']? *$", re.MULTILINE)
_KIND = re.compile(r"^kind: *(\w+)", re.MULTILINE)
_VARIANTS = re.compile(r"^variants: *\n((?:(?: +.*)?\n)*)", re.MULTILINE)
# Two blanks: a key of `variants`, and not a key inside a variant.
_VARIANT = re.compile(r"^  (\w+):", re.MULTILINE)
Entry = dict[str, Any]
"""Facts about a scenario, a search, a measure or a kind."""


class NothingListedError(SwarmstartError, LookupError):
    """Nothing in the list contains the text that was asked for."""


class Asked(NamedTuple):
    """A request to the list.

    Attributes:
        topic: A key of `_MAKERS`; empty means all of them.
        text: Text that listed entries contain; empty means all entries.
        kind: Kind of the listed scenarios and measures; None means all kinds.
        hard: Whether the hard problems are listed in place of the other scenarios.
    """

    topic: str
    text: str
    kind: str | None = None
    hard: bool = False

    @property
    def is_overview(self) -> bool:
        """True if no topic, text, kind or hard problem is asked for."""
        nothing = not self.topic and not self.text and self.kind is None
        return nothing and not self.hard


def list_command(options: argparse.Namespace) -> int:
    """List what the options ask for; return the exit code.

    Raises:
        NothingListedError: If nothing fits.
    """
    asked = _asked(options)
    found = listing(asked)
    if options.json:
        answer(json.dumps({"schema": SCHEMA, **found}))
    elif asked.is_overview:
        answer(_overview(found))
    else:
        answer("\n\n".join(_sections(found)))
    return DONE


def _asked(options: argparse.Namespace) -> Asked:
    """Return the request; a first word that is no topic is searched for everywhere."""
    topic, text = options.topic, options.text
    if topic not in _MAKERS:
        topic, text = "", " ".join(filter(None, (topic, text)))
    return Asked(topic, text, options.kind, options.hard)


def listing(asked: Asked) -> dict[str, dict[str, Any]]:
    """Return the requested entries: topic -> name -> entry.

    Measures are one level deeper: "measures" -> kind or scenario -> name -> entry.

    Raises:
        NothingListedError: If nothing is listed.
    """
    topics = [asked.topic] if asked.topic else [*_MAKERS]
    if asked.kind is not None and not asked.topic:
        # Only these depend on the kind.
        topics = ["scenarios", "measures"]
    if asked.hard and not asked.topic:
        topics = ["scenarios"]
    found = {topic: _MAKERS[topic](asked) for topic in topics}
    if not any(found.values()):
        raise NothingListedError(_nothing(asked))
    return found


def scenario_entry(path: Path) -> Entry:
    """Return title, kind, variants and run time of a shipped scenario.

    Args:
        path: File of the scenario, of which only some lines are read.
    """
    text = path.read_text(encoding="utf-8")
    title, kind = _TITLE.search(text), _KIND.search(text)
    variants = _VARIANTS.search(text)
    return {
        "title": title[1] if title else "",
        "kind": kind[1] if kind else "",
        "variants": _VARIANT.findall(variants[1]) if variants else [],
        "run_time_s": RUN_TIMES_S.get(path.stem),
    }


def _scenarios(asked: Asked) -> dict[str, Entry]:
    files = hard_problems() if asked.hard else shipped()
    entries = {name: scenario_entry(path) for name, path in files.items()}
    if asked.hard:
        # As plain JSON: its reader, which checks it, imports pydantic.
        known = json.loads(_BEST_KNOWN.read_text(encoding="utf-8"))["problems"]
        for name, entry in entries.items():
            entry["best_known"] = known[name].get("cost")
            entry["known_by"] = known[name]["known_by"]
    return {
        name: entry
        for name, entry in entries.items()
        if asked.kind in (None, entry["kind"])
        and _contains(asked.text, "scenarios", name, entry["title"], entry["kind"])
    }


def _searches(asked: Asked) -> dict[str, Entry]:
    return _titled({name: entry.title for name, entry in SEARCHES.items()}, asked)


def _polishes(asked: Asked) -> dict[str, Entry]:
    return _titled(POLISHES, asked)


def _titled(entries: Mapping[str, str], asked: Asked) -> dict[str, Entry]:
    return {
        name: {"title": title}
        for name, title in entries.items()
        if _contains(asked.text, name, title)
    }


def _measures(asked: Asked) -> dict[str, dict[str, Entry]]:
    """Return measures by kind; of a scenario or a file, its own ones are among them."""
    kinds = [asked.kind] if asked.kind else [*KINDS]
    every = measures_of_kinds(kinds)
    # The name of a kind selects all its measures, not those that contain it.
    if asked.topic and asked.text in every:
        return {asked.text: every[asked.text]}
    if asked.topic and (asked.text in by_name() or asked.text.endswith(".yaml")):
        return measures_of_one(asked.text)
    found = {
        kind: {
            name: entry
            for name, entry in measures.items()
            # The heading is searched too, so that a kind can be found by its name.
            if _contains(asked.text, f"measures of {kind}", name, entry["meaning"])
        }
        for kind, measures in every.items()
    }
    return {kind: measures for kind, measures in found.items() if measures}


def _kinds(asked: Asked) -> dict[str, Entry]:
    kinds = [scenario_entry(path)["kind"] for path in shipped().values()]
    return {
        kind: {"title": words_of(kind).title, "scenarios": kinds.count(kind)}
        for kind in KINDS
        if _contains(asked.text, "kinds", kind, words_of(kind).title)
        and asked.kind in (None, kind)
    }


def _contains(text: str, *parts: str) -> bool:
    # A line break between the parts, so that no match spans two of them.
    return text.casefold() in "\n".join(parts).casefold()


_MAKERS: dict[str, Callable[[Asked], dict[str, Any]]] = {
    "scenarios": _scenarios,
    "searches": _searches,
    "polishes": _polishes,
    "measures": _measures,
    "kinds": _kinds,
}
"""Topic of the list -> its entries."""


def _nothing(asked: Asked) -> str:
    """Return the message if nothing fits."""
    known = [*_MAKERS, *by_name(), *SEARCHES, *POLISHES, *KINDS]
    topic = f" {asked.topic}" if asked.topic else ""
    hint = meant(asked.text, known, otherwise=f"see swarmstart list{topic}")
    of_kind = "" if asked.kind is None else f" of kind {asked.kind}"
    place = f"the list of {asked.topic}{of_kind}" if asked.topic else "the list"
    return f"expected a text that {place} contains, found {shown(asked.text)}; {hint}"


def _overview(found: Mapping[str, Any]) -> str:
    """Return how many entries each topic has, and how to go on."""
    # Kinds share measures: each name counts once.
    measures = {name for of_kind in found["measures"].values() for name in of_kind}
    counts = {topic: len(found[topic]) for topic in _MAKERS}
    counts["measures"] = len(measures)
    commands = [
        ("swarmstart list scenarios", f"{counts['scenarios']} scenarios, to run"),
        ("swarmstart list searches", f"{counts['searches']} search algorithms"),
        ("swarmstart list polishes", "IPOPT, none, or another NLP solver of CasADi"),
        ("swarmstart list measures", f"{counts['measures']} measures of results"),
        ("swarmstart list kinds", f"{counts['kinds']} kinds of scenario"),
        ("swarmstart list TEXT", "all entries that contain a text"),
        ("swarmstart run pendulum", "run a scenario, here pendulum"),
        ("swarmstart new NAME", "write a scenario of your own"),
    ]
    width = max(len(command) for command, _ in commands)
    return "\n".join(f"{command.ljust(width)}   {what}" for command, what in commands)


def _sections(found: Mapping[str, Any]) -> Iterable[str]:
    """Yield the entries topic by topic; scenarios and measures by kind."""
    for topic, entries in found.items():
        if topic == "scenarios":
            yield from _scenario_sections(entries)
        elif topic == "measures":
            for kind, measures in entries.items():
                rows = [(name, _told(entry)) for name, entry in measures.items()]
                yield _section(f"measures of {kind}", rows)
        elif entries:
            rows = [(name, _title(entry)) for name, entry in entries.items()]
            yield _section(topic, rows)


def _scenario_sections(entries: Mapping[str, Entry]) -> Iterable[str]:
    hard = [
        (name, _known(entry), entry["title"])
        for name, entry in entries.items()
        if "known_by" in entry
    ]
    if hard:
        yield _section("hard problems (name, best known cost, title)", hard)
        return
    for kind in KINDS:
        rows = [
            (name, rough(entry["run_time_s"]), _title(entry))
            for name, entry in entries.items()
            if entry["kind"] == kind
        ]
        if rows:
            yield _section(f"scenarios of kind {kind} (name, run time, title)", rows)


def _known(entry: Entry) -> str:
    """Return the best known cost of a hard problem and how it is known."""
    cost = entry["best_known"]
    return "unknown" if cost is None else f"{cost:.6g} ({entry['known_by']})"


def _title(entry: Entry) -> str:
    """Return a title, with the variants or the number of scenarios."""
    said = str(entry["title"])
    if entry.get("variants"):
        said += f" (variants: {', '.join(entry['variants'])})"
    if entry.get("scenarios"):
        said += f" ({entry['scenarios']} scenarios)"
    return said


def _told(entry: Entry) -> str:
    """Return what a measure means, with its unit."""
    return f"{entry['meaning']}{_unit_text(entry['unit'])}"


def _unit_text(unit: str) -> str:
    """Return a unit in brackets after a space; empty without one."""
    return f" [{unit}]" if unit else ""


def _section(heading: str, rows: Sequence[tuple[str, ...]]) -> str:
    """Return a heading and its rows."""
    return "\n".join([heading, *wrapped_table(rows)])


def rough(seconds: float | None) -> str:
    """Return a run time as a round number; "?" if it was not measured.

    Example:
        >>> rough(0.7), rough(3.1), rough(26.0), rough(70.0), rough(None)
        ('1 s', '5 s', '30 s', '1 min', '?')
    """
    if seconds is None:
        return "?"
    for step in _STEPS_S:
        if seconds <= step:
            return f"{step} s"
    return f"{max(1, round(seconds / _MINUTE_S))} min"
