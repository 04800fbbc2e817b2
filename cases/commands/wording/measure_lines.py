"""The table of measures that `run --measures` prints: name, value, unit, meaning."""

from collections.abc import Mapping, Sequence

from swarmstart.cases.campaign.running.run import Run
from swarmstart.cases.commands.terminal.output import wrapped_table
from swarmstart.cases.commands.wording.measure_list import measures_of_run
from swarmstart.cases.format.kind import Measure
from swarmstart.cases.format.scenario import Resolved

HEAD = ("measure", "value", "unit", "meaning")
UNDEFINED = "undefined"
SHOWN = 6
"""Entries of a list that are printed; all of them are in run.json."""


def measure_lines(finished: Run) -> list[str]:
    """Return all measures of a run; an undefined one says why it is undefined."""
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
        values: Name -> the cells between the name and the unit.
        head: Titles of all columns.
        notes: Name -> what is added to the meaning of a measure in brackets.
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
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
