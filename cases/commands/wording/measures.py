"""Measures of a run with unit and meaning: as entries, and as a table for `run`.

Imports nothing heavy, since `swarmstart list` shows measures too.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from swarmstart.cases.commands.terminal import wrapped_table
from swarmstart.cases.drawing.wording import quantity, unit_of_measure
from swarmstart.cases.format.registry import KINDS, words_of
from swarmstart.cases.format.scenario import read_document

if TYPE_CHECKING:
    from swarmstart.cases.campaign.running.finished_run import Run
    from swarmstart.cases.format.kind import Measure
    from swarmstart.cases.format.scenario import Resolved


Entry = dict[str, Any]
"""Data of a measure: its "unit", which may be empty, and its "meaning"."""
_UNIT = re.compile(r"\s*\[([^\[\]]{1,20})\]\s*$")
"""The unit at the end of a meaning; "-" says that there is none."""
HEAD = ("measure", "value", "unit", "meaning")
UNDEFINED = "undefined"
FAR, MOST_DIGITS = 1e6, 15
"""Size from which a number has three decimals, within as many significant digits."""
SHOWN = 6
"""Entries of a list that are printed; all of them are in run.json."""


def measures_of_kinds(kinds: Iterable[str]) -> dict[str, dict[str, Entry]]:
    """Return the measures that all scenarios of a kind have: kind -> name -> entry."""
    return {kind: _entries(words_of(kind).measures) for kind in kinds}


def measures_of_one(name_or_path: str) -> dict[str, dict[str, Entry]]:
    """Return the measures that a scenario defines, then those of its kind.

    They are under the scenario's name: `name_or_path` -> name of a measure -> entry.

    Args:
        name_or_path: Name or file of the scenario, which is read but not checked.

    Raises:
        SwarmstartError: If the scenario cannot be read.
    """
    # Not resolved: that would import pydantic and CasADi.
    data = read_document(name_or_path).data
    kind = data.get("kind")
    own = data.get("measures")
    of_kind = (
        measures_of_kinds([kind]) if isinstance(kind, str) and kind in KINDS else {}
    )
    found = _own(own if isinstance(own, dict) else {})
    return {name_or_path: found | of_kind.get(str(kind), {})}


def measures_of_run(resolved: Resolved) -> dict[str, Entry]:
    """Return the measures of a scenario by name, with those that it defines itself."""
    return _entries(resolved.kind.meanings_of(resolved.scenario))


def measure_lines(finished: Run) -> list[str]:
    """Return lines with all measures of a run, or the reason why one is undefined."""
    reasons = finished.resolved.kind.undefined_of(finished.resolved.scenario)
    values = {
        name: (UNDEFINED if value is None else value_text(value),)
        for name, value in finished.measures.items()
    }
    notes = {
        name: f"{UNDEFINED}: {reasons.get(name, 'not a finite number')}"
        for name, value in finished.measures.items()
        if value is None
    }
    return measure_table(finished.resolved, values, HEAD, notes)


def measure_table(
    resolved: Resolved,
    values: Mapping[str, Sequence[str]],
    head: Sequence[str],
    notes: Mapping[str, str],
) -> list[str]:
    """Return values of measures as a table with their units and meanings.

    Args:
        resolved: The scenario.
        values: Name of a measure -> texts of the columns between name and unit.
        head: Titles of all columns.
        notes: Name -> text that is added in brackets to the meaning of the measure.
    """
    known = measures_of_run(resolved)
    rows = [tuple(head)]
    for name, cells in values.items():
        entry = known[name]
        note = f" ({notes[name]})" if name in notes else ""
        rows.append((name, *cells, entry["unit"] or "-", entry["meaning"] + note))
    return wrapped_table(rows)


def value_text(value: Measure) -> str:
    """Return a measure as text; long lists are cut."""
    if isinstance(value, list):
        shown = [value_text(item) for item in value[:SHOWN]]
        more = f", ... {len(value)} in all" if len(value) > SHOWN else ""
        return f"[{', '.join(shown)}{more}]"
    if value is None:
        # Only in a list: a measure that is undefined as a whole says why.
        return "-"
    if not isinstance(value, float):
        return str(value)
    # Of a far place such as 1e9 m the last of six digits would be kilometres.
    is_far = FAR <= abs(value) < math.inf
    digits = min(MOST_DIGITS, 4 + math.floor(math.log10(abs(value)))) if is_far else 6
    return quantity(value, digits)


def _own(measures: Mapping[str, Any]) -> dict[str, Entry]:
    """Return a scenario's own measures: their meaning is their expression."""
    return {
        name: {"unit": unit_of_measure(name, ""), "meaning": str(expression)}
        for name, expression in measures.items()
    }


def _entries(measures: Mapping[str, str]) -> dict[str, Entry]:
    return {name: _entry(name, meaning) for name, meaning in measures.items()}


def _entry(name: str, meaning: str) -> Entry:
    said = _UNIT.search(meaning)
    if said is None:
        return {"unit": unit_of_measure(name, ""), "meaning": meaning}
    # "-" keeps `unit_of_measure` from guessing a unit by the name.
    unit = "" if said[1] == "-" else said[1]
    return {"unit": unit, "meaning": meaning[: said.start()]}
