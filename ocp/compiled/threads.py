"""Work in other threads: parts of one population, and the translation of machine code.

Machine code is called without Python's lock, so threads of one process are enough. A
part begins at a whole block of individuals, and no individual's value depends on its
neighbours: the results have the same bits, however many threads there are.

LLVM too works without Python's lock. Code compiled within `aside()` is emitted at once
and translated in the background; the first use of its address waits for it.
"""

import contextlib
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextvars import ContextVar
from functools import cache, cached_property, partial

from swarmstart.machine_code import compiling
from swarmstart.ocp.compiled.engine import Compiled, link

LEAST = 256
"""Least number of individuals of a part; for fewer a thread does not pay."""
_BLOCK = 64
"""Individuals; a multiple of every kernel's block."""

_is_aside: ContextVar[bool] = ContextVar("_is_aside", default=False)


def parts_of(size: int, threads: int) -> list[tuple[int, int]]:
    """Return the first individual of each part, and the first one after the part."""
    count = max(1, min(threads, size // LEAST))
    each = max(1, -(-size // (count * _BLOCK))) * _BLOCK
    return [(first, min(first + each, size)) for first in range(0, size, each)]


def in_parts(part: Callable[[int, int], None], size: int, threads: int) -> None:
    """Call a function for all individuals, in one part or in several in parallel.

    Args:
        part: Function (first, first after the part) -> None; must not hold Python's
            lock.
        size: Number of individuals.
        threads: Largest number of calls at a time.
    """
    # `together` needs a call, even for no individuals.
    together([partial(part, *one) for one in parts_of(size, threads) or [(0, 0)]])


def together(calls: Sequence[Callable[[], None]]) -> None:
    """Make calls at the same time, each in a thread of its own.

    Args:
        calls: Functions to call, at least one; they must not hold Python's lock for
            long.
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


@contextlib.contextmanager
def aside() -> Iterator[None]:
    """Let another thread translate the code that is compiled in this context.

    Yields:
        Nothing.
    """
    token = _is_aside.set(True)
    try:
        yield
    finally:
        _is_aside.reset(token)


class Later:
    """A kernel that may not be ready yet."""

    def __init__(self, code: "Future[bytes]") -> None:
        """Store the future of object code that is being made."""
        self._code = code

    @cached_property
    def compiled(self) -> Compiled:
        """The kernel; waits until it is ready.

        Raises:
            NoCompilerError: If LLVM refuses it.
        """
        with compiling():
            return link(self._code.result())


def code_of(make: Callable[[], bytes]) -> "bytes | Future[bytes]":
    """Return object code; within `aside()`, a future of it.

    Args:
        make: Function that returns the code; it may run in another thread.
    """
    return _worker(os.getpid()).submit(make) if _is_aside.get() else make()


def _settle() -> None:
    """Wait for code that is being made."""
    if _worker.cache_info().currsize:
        _worker(os.getpid()).submit(int).result()  # After all others: it is one thread.


# A copy of the process has no such thread: it would wait for its code forever.
if hasattr(os, "register_at_fork"):  # Windows makes no copies.
    os.register_at_fork(before=_settle)


@cache
def _worker(process: int) -> ThreadPoolExecutor:
    """Return the thread of a process; a forked one has none of its parent's."""
    del process
    return ThreadPoolExecutor(1, thread_name_prefix="swarmstart-compiler")
