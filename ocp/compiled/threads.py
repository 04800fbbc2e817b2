"""Evaluation of one population on several cores, in parts.

Machine code is called without Python's lock, so threads of one process are enough. A
part begins at a whole block of individuals, and no individual's value depends on its
neighbours: the results have the same bits, however many threads there are.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache, partial

LEAST = 256
"""Least number of individuals of a part; for fewer a thread does not pay."""
_BLOCK = 64
"""Individuals; a multiple of every kernel's block."""


def parts_of(size: int, threads: int) -> list[tuple[int, int]]:
    """Return the first individual of each part, and the first after it.

    Args:
        size: Number of individuals.
        threads: Largest number of parts.
    """
    count = max(1, min(threads, size // LEAST))
    each = max(1, -(-size // (count * _BLOCK))) * _BLOCK
    return [(first, min(first + each, size)) for first in range(0, size, each)]


def in_parts(part: Callable[[int, int], None], size: int, threads: int) -> None:
    """Call a function for all individuals, in one part or in several in parallel.

    Args:
        part: (first, first after the part) -> None; must not hold Python's lock.
        size: Number of individuals.
        threads: Largest number of calls at a time.
    """
    together([partial(part, *one) for one in parts_of(size, threads) or [(0, 0)]])


def together(calls: Sequence[Callable[[], None]]) -> None:
    """Make calls at the same time, each in a thread of its own.

    Args:
        calls: At least one; they must not hold Python's lock for long.
    """
    first, *others = calls
    if not others:
        first()
        return
    pool = _pool(os.getpid(), len(others))
    running = [pool.submit(one) for one in others]
    try:
        first()
    finally:
        wait(running)  # They write where the caller reads.
    for one in running:
        one.result()


@cache
def _pool(process: int, workers: int) -> ThreadPoolExecutor:
    """Return the worker threads of a process; a forked one has none of its parent's."""
    del process
    return ThreadPoolExecutor(workers, thread_name_prefix="swarmstart")
