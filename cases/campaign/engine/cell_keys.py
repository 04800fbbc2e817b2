"""Keys of cells: hashes of all that determines a result.

    key = hash(work, job, versions of packages, source of the code that the job uses)

The code is the module of the work with all it imports of this package, and the modules
that the job names by text: the kind and the search of its settings. So an edit of a
command, a figure, a statistic or another kind leaves every key, and one of the planner
changes those of all that plans. A module may name further ones: `modules_of(job)`.
"""

from __future__ import annotations

import hashlib
import importlib
import json
from collections.abc import Mapping
from functools import cache
from typing import Any

from swarmstart.cases.format.registry import KINDS, SEARCHES
from swarmstart.cases.record.record import versions
from swarmstart.fingerprint import sources

DIGITS = 16


def key_of(work: str, job: Mapping[str, Any]) -> str:
    """Return the 16 characters that name a cell.

    Args:
        work: "module:function" of what does it.
        job: Plain data.
    """
    module = work.partition(":")[0]
    determines = {
        "work": work,
        "job": job,
        "versions": recorded_versions(),
        "code": _code((module, *_named(module, job))),
    }
    if "settings" not in job:  # It may read those that come with the package.
        determines["scenarios"] = _shipped_scenarios()
    text = json.dumps(
        determines, sort_keys=True, separators=(",", ":"), allow_nan=False
    )
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def modules_of_settings(settings: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the modules that a resolved scenario names: of its kind and its search.

    Args:
        settings: As in `Resolved`; what names nothing that is known adds no module.
    """
    kind, search = settings.get("kind"), settings.get("search")
    named = search.get("name") if isinstance(search, Mapping) else search
    places = []
    if isinstance(kind, str) and kind in KINDS:
        places.append(KINDS[kind].kind)
    if isinstance(named, str) and named in SEARCHES:
        places.append(SEARCHES[named].settings)
    return tuple(place.partition(":")[0] for place in places if place)


@cache
def recorded_versions() -> dict[str, str]:
    """Return the versions that matter, looked up once a process."""
    return versions()


def _named(module: str, job: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the modules that a job names, as the work's module says, or its settings.

    One that cannot be imported names none: the cell then fails, and says why.
    """
    try:
        modules_of = getattr(importlib.import_module(module), "modules_of", None)
    except ImportError:
        modules_of = None
    if modules_of is not None:
        return tuple(modules_of(job))
    settings = job.get("settings")
    return modules_of_settings(settings) if isinstance(settings, Mapping) else ()


@cache
def _code(modules: tuple[str, ...]) -> str:
    """Return the hash of the sources; files are read once a process."""
    try:
        return sources(*modules)
    except ModuleNotFoundError as error:
        return f"missing: {error.name}"


@cache
def _shipped_scenarios() -> str:
    from swarmstart.cases.format.scenario import shipped

    digest = hashlib.sha256()
    for name, file in sorted(shipped().items()):
        digest.update(repr((name, hashlib.sha256(file.read_bytes()).digest())).encode())
    return digest.hexdigest()
