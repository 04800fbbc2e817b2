"""Parts of scenarios of reconfigurations as text."""

from collections.abc import Sequence

from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.reconfiguration.scenario import ReconfigurationScenario


def reconfiguration(
    *assignments: str, name: str = "reconfiguration", variant: str | None = "literal"
) -> ReconfigurationScenario:
    resolved = resolve(read_document(name), variant=variant, assignments=assignments)
    assert isinstance(resolved.scenario, ReconfigurationScenario)
    return resolved.scenario


def listed(rows: Sequence[Sequence[float]], keys: Sequence[str]) -> str:
    """Return rows of numbers as a list of mappings, as in a scenario."""
    entries = (
        ", ".join(f"{key}: {float(v)!r}" for key, v in zip(keys, row, strict=True))
        for row in rows
    )
    return f"[{', '.join(f'{{{entry}}}' for entry in entries)}]"


def uavs_at(rows: Sequence[Sequence[float]]) -> str:
    """Return the assignment of starts (v, psi, x, y)."""
    return "uavs=" + listed(rows, ("speed_m_s", "heading_rad", "x_m", "y_m"))


def slots_at(rows: Sequence[Sequence[float]]) -> str:
    """Return the assignment of slots (x, y)."""
    return "slots=" + listed(rows, ("x_m", "y_m"))


def horizon(intervals: int) -> str:
    """Return the assignment of a horizon of so many intervals of a second."""
    return f"prediction={{horizon_s: {intervals}, intervals: {intervals}}}"
