"""Keys of cells, the units of work of a campaign: hashes of all that a result needs.

    key = hash(work, job, versions of packages, source of the code that the job uses)

The code is the module of the work with all modules of this package that it imports, and
the modules that the job names as text: the kind and the search of its settings. Thus an
edit of a command, a figure, a statistic or another kind changes no key, and an edit of
the planner changes the keys of all cells that plan. A module can name further modules
by its function `modules_of(job)`.
"""

from __future__ import annotations

import hashlib
import importlib
from collections.abc import Mapping
from functools import cache
from typing import Any

from swarmstart.cases.format.registry import KINDS, SEARCHES, words_of
from swarmstart.cases.record.record import hash_of, versions
from swarmstart.machine_code import sources


def key_of(work: str, job: Mapping[str, Any]) -> str:
    """Return the key of a cell: the 16 characters that name it.

    Args:
        work: "module:function" that does the work.
        job: Plain data that determine the result.
    """
    module = work.partition(":")[0]
    determines = {
        "work": work,
        "job": job,
        "versions": recorded_versions(),
        "code": _code((module, *_named(module, job))),
    }
    if "settings" not in job:  # The work can read shipped scenarios.
        determines["scenarios"] = _shipped_scenarios()
    return hash_of(determines)


def modules_of_settings(settings: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the modules of a resolved scenario's kind and search.

    Args:
        settings: Settings as in `Resolved`; an unknown kind or search adds no module.
    """
    kind, search = settings.get("kind"), settings.get("search")
    named = search.get("name") if isinstance(search, Mapping) else search
    places = []
    if isinstance(kind, str) and kind in KINDS:
        places.append(words_of(kind).kind)
    if isinstance(named, str) and named in SEARCHES:
        places.append(SEARCHES[named].settings)
    return tuple(place.partition(":")[0] for place in places if place)


@cache
def recorded_versions() -> dict[str, str]:
    """Return versions of packages that results depend on, read once in a process."""
    return versions()


def _named(module: str, job: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the modules that a job names, by its work's module or its settings.

    A module that cannot be imported names none: the cell then fails with the reason.
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
    """Return the hash of the sources; files are read once in a process."""
    try:
        return sources(*modules)
    except ModuleNotFoundError as error:
        # A missing work has a key too: its cell then fails with the reason.
        return f"missing: {error.name}"


@cache
def _shipped_scenarios() -> str:
    from swarmstart.cases.format.scenario import shipped

    digest = hashlib.sha256()
    for name, file in sorted(shipped().items()):
        digest.update(repr((name, hashlib.sha256(file.read_bytes()).digest())).encode())
    return digest.hexdigest()
