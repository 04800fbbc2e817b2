"""The work of a cell that is a run, separate from the engine, which no key has."""

from collections.abc import Mapping
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from swarmstart.cases.campaign.engine.cell_keys import modules_of_settings
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.registry import words_of
from swarmstart.cases.format.scenario import resolved_again
from swarmstart.cases.record.record import Recording


def fly(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return the measures of a run; with figures its record is kept (in a worker)."""
    resolved = resolved_again(job["settings"], job["variant"])
    finished = run(
        resolved,
        seed=job["seed"],
        # The folder belongs to the cell, also if an earlier attempt left files there.
        recording=Recording(folder=folder, force=True) if job["figures"] else None,
    )
    summary = finished.summary()
    kept = ("status", "measures", "wall_s", "backend", "figures")
    return {name: summary[name] for name in kept}


def modules_of(job: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the modules that a run uses by name, for the key of its cell."""
    settings = job["settings"]
    named = modules_of_settings(settings)
    if not job["figures"]:
        return named
    drawn_by: str = resolve_name(words_of(settings["kind"]).kind).drawn_by
    return (*named, drawn_by.partition(":")[0])
