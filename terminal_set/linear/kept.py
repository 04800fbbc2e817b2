"""Solutions of matrix equations, stored on disk and checked whenever they are used.

To import python-control and SciPy takes seconds, to check a solution microseconds. So a
solution is stored in the cache of machine code (`code_cache.py` says which files are
trusted), under a key of the numbers and versions that it was computed from. A stored
solution is used only if it solves its equation, which is evaluated anew; otherwise the
solution is computed again, by python-control or SciPy.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from functools import cache
from importlib import metadata
from itertools import count

import numpy as np

from swarmstart.arrays import Array
from swarmstart.machine_code import load_code, store_code

Solution = tuple[Array, ...]
VERSIONS = ("control", "scipy", "numpy", "casadi")
"""Packages that the kept numbers depend on."""
MOST = 64
"""Solutions that one process keeps: a loop over thousands needs no file of each."""
_stored = count()


def key_of(*parts: object) -> str:
    """Return the key of a result: a hash of `parts` and of the packages' versions.

    Args:
        parts: Data from which the result is computed, with an exact `repr`: numbers,
            texts, lists of them.
    """
    return hashlib.sha256(repr((_versions(), parts)).encode()).hexdigest()


@cache
def _versions() -> tuple[str, ...]:
    return tuple(metadata.version(name) for name in VERSIONS)


def kept(
    name: str,
    inputs: Sequence[Array],
    solve: Callable[[], Solution],
    solves: Callable[[Solution], bool],
) -> Solution:
    """Return a stored solution that solves its equation, or else compute a new one.

    Args:
        name: Name of the equation.
        inputs: Matrices of the equation.
        solve: Function that computes the solution.
        solves: Function: matrices -> whether they are a solution. It must accept
            matrices of any shapes and values.
    """
    key = key_of(name, [(np.shape(one), np.asarray(one).tolist()) for one in inputs])
    found = _read(load_code(key))
    if found is not None and solves(found):
        return found
    found = solve()
    # What was refused is refused again, and is not to be overwritten each time.
    if next(_stored) < MOST and solves(found):
        store_code(key, json.dumps([one.tolist() for one in found]).encode())
    return found


def _read(content: bytes | None) -> Solution | None:
    """Return the matrices of a file; None if it does not hold any."""
    if content is None:
        return None
    try:
        found = tuple(np.array(one, dtype=np.float64) for one in json.loads(content))
    except (ValueError, TypeError, RecursionError):
        return None
    return found if all(one.ndim == 2 for one in found) else None  # noqa: PLR2004
