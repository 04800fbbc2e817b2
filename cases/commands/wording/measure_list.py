"""Measures with unit and meaning; imports nothing heavy."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from swarmstart.cases.drawing.naming.units import unit_of_measure
from swarmstart.cases.format.registry import KINDS, words_of
from swarmstart.cases.format.scenario import read_document

if TYPE_CHECKING:
    from swarmstart.cases.format.scenario import Resolved

Entry = dict[str, Any]
"""Of a measure: its "unit" (empty: none) and its "meaning"."""
_UNIT = re.compile(r"\s*\[([^\[\]]{1,20})\]\s*$")
"""The unit at the end of a meaning; "-" says that there is none."""


def measures_of_kinds(kinds: Iterable[str]) -> dict[str, dict[str, Entry]]:
    """Return the measures that all scenarios of a kind have: kind -> name -> entry."""
    return {kind: _entries(words_of(kind).measures) for kind in kinds}


def measures_of_one(name_or_path: str) -> dict[str, dict[str, Entry]]:
    """Return the measures of a scenario, its own first: kind -> name -> entry.

    Args:
        name_or_path: The scenario, which is read but not checked.

    Raises:
        SwarmstartError: If it cannot be read.
    """
    data = read_document(name_or_path).data
    kind = data.get("kind")
    own = data.get("measures")
    of_kind = (
        measures_of_kinds([kind]) if isinstance(kind, str) and kind in KINDS else {}
    )
    found = _own(own if isinstance(own, dict) else {})
    return {name_or_path: found | of_kind.get(str(kind), {})}


def measures_of_run(resolved: Resolved) -> dict[str, Entry]:
    """Return the measures of a resolved scenario by name, its own among them."""
    return _entries(resolved.kind.meanings_of(resolved.scenario))


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
    unit = "" if said[1] == "-" else said[1]
    return {"unit": unit, "meaning": meaning[: said.start()]}
