"""Machine code that is translated in another thread, while this one goes on.

LLVM works without Python's lock. Code compiled within `aside()` is emitted at once and
translated in the background; the first use of its address waits for it.
"""

import contextlib
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import ContextVar
from functools import cache, cached_property

from swarmstart.machine_code import compiling
from swarmstart.ocp.compiled.engine import Compiled, link

_is_aside: ContextVar[bool] = ContextVar("_is_aside", default=False)


@contextlib.contextmanager
def aside() -> Iterator[None]:
    """Translate code that is compiled in this context in another thread.

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
        make: Makes the code; may run in another thread.
    """
    return _worker(os.getpid()).submit(make) if _is_aside.get() else make()


@cache
def _worker(process: int) -> ThreadPoolExecutor:
    """Return the thread of a process; a forked one has none of its parent's."""
    del process
    return ThreadPoolExecutor(1, thread_name_prefix="swarmstart-compiler")
