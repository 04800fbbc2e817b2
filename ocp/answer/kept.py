"""Planners that are kept with their problem, for the next call with the same settings.

Making a planner's functions takes most of the time of a short solve: expressions,
machine code, the NLP with its derivatives. They depend on the problem and the settings
alone, so the problem keeps the planners that calls of `solve` are done with. A call
takes one out, so that no other thread uses it meanwhile.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import fields
from typing import NamedTuple

from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.compiled.backend import VARIABLE
from swarmstart.ocp.nlp.polish_options import PolishOptions
from swarmstart.ocp.search.settings import SearchSettings
from swarmstart.ocp.statement.problem import OptimalControlProblem

_MOST = 4
"""Largest number of planners that a problem keeps; the latest ones."""


class _Settings(NamedTuple):
    search: tuple[object, ...]
    polish: PolishOptions | None
    said: str
    backend: str | None
    of_the_environment: str | None
    lanes: int
    threads: int | None


class _Kept(NamedTuple):
    settings: _Settings
    planner: Planner


@contextmanager
def kept_planner(
    problem: OptimalControlProblem,
    *,
    search: SearchSettings | None = None,
    polish: PolishOptions | None,
    backend: str | None = None,
    lanes: int = 0,
    threads: int | None = 1,
) -> Iterator[Planner]:
    """Lend a planner: one that was kept after an earlier call, or else a new one.

    At the end of the context the planner is kept for the next call with the same
    settings, unless there was an exception.

    Args:
        problem: The problem.
        search: As in `Planner`.
        polish: As in `Planner`.
        backend: As in `Planner`.
        lanes: As in `Planner`.
        threads: As in `Planner`.

    Raises:
        InvalidProblemError: As `Planner`.
    """
    # Settings with arrays have no equality of their own.
    searched = (
        tuple(getattr(search, one.name) for one in fields(SearchSettings))
        if search
        else ()
    )
    # Options are a mapping, which may be changed after a call: its text is not.
    wanted = _Settings(
        searched,
        polish,
        repr(polish),
        backend,
        os.environ.get(VARIABLE),
        lanes,
        threads,
    )
    kept: list[_Kept] = problem.kept.setdefault("planners", [])
    planner = _taken(kept, wanted)
    if planner is None:
        planner = Planner(
            problem,
            search=search,
            polish=polish,
            backend=backend,
            lanes=lanes,
            threads=threads,
        )
    yield planner
    kept.append(_Kept(wanted, planner))
    del kept[:-_MOST]


def _taken(kept: list[_Kept], wanted: _Settings) -> Planner | None:
    """Take the latest planner with some settings out of the list; None without one."""
    for one in reversed(kept.copy()):
        # Another thread may take it, and arrays in settings cannot be compared.
        with suppress(ValueError):
            if one.settings == wanted:
                kept.remove(one)
                return one.planner
    return None
