"""The first use of an algorithm on a machine: its kernels compiled ahead.

All searches by an algorithm use the same kernels, so the smallest search compiles them
all.
"""

import contextlib
import pickle
from collections.abc import Iterator

import numpy as np

from swarmstart.heuristics.laws.algorithm import Algorithm
from swarmstart.heuristics.laws.box import Box
from swarmstart.heuristics.running.ahead import LARGER_PART, compiled_ahead
from swarmstart.heuristics.running.search import Search


def smallest_search(algorithm: Algorithm) -> Search:
    """Return a small search whose kernels serve all other searches by the algorithm."""
    box = Box(lower=np.zeros(2), upper=np.ones(2), per_step=1)
    return Search(algorithm, box, rng=np.random.default_rng(0))


def compile_part(pickled: bytes) -> None:
    """Compile a part of an algorithm's kernels, in a helper process.

    Args:
        pickled: A pickle of (settings of the algorithm, True for the compiled loop,
            indices of the tasks in `Search.preparations`).
    """
    algorithm, compiled, part = pickle.loads(pickled)
    jobs = smallest_search(algorithm).preparations(compiled=compiled)
    for k in part:
        if k < len(jobs):
            jobs[k]()


@contextlib.contextmanager
def kernels_ahead(algorithm: Algorithm) -> Iterator[None]:
    """Have a second process compile an algorithm's kernels, if they are missing.

    A search that begins in this context waits for the second process.

    Args:
        algorithm: Settings of the algorithm.

    Yields:
        Nothing.
    """
    search = smallest_search(algorithm)
    if search.is_prepared(compiled=True):
        yield
        return
    with compiled_ahead(algorithm, compiled=True, part=LARGER_PART):
        yield
