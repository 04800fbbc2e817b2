"""Wall time, apart from the time spent on loading and compiling machine code.

Code that loads or compiles runs within `compiling`; time is measured by a `stopwatch`,
which keeps the two apart.
"""

import contextlib
import logging
import time
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from functools import cache

log = logging.getLogger(__name__)


class Stopwatch:
    """A clock of the wall time since its start, without that spent on machine code.

    Attributes:
        compile_seconds: Time spent on machine code [s].
    """

    __slots__ = ("_begin", "compile_seconds")

    def __init__(self) -> None:
        """Start at zero."""
        self.compile_seconds = 0.0
        self._begin = time.perf_counter()

    @property
    def seconds(self) -> float:
        """Wall time without that spent on machine code [s]."""
        return time.perf_counter() - self._begin - self.compile_seconds


_running: ContextVar[tuple[Stopwatch, ...]] = ContextVar("_running", default=())
_is_compiling: ContextVar[bool] = ContextVar("_is_compiling", default=False)
Held = Callable[[], contextlib.AbstractContextManager[None]]
_held: ContextVar[tuple[Held, ...]] = ContextVar("_held", default=())


@contextlib.contextmanager
def stopwatch() -> Iterator[Stopwatch]:
    """Return a context that measures time, machine code apart.

    Yields:
        A stopwatch that may be read at any time; nested ones run independently.
    """
    watch = Stopwatch()
    token = _running.set((*_running.get(), watch))
    try:
        yield watch
    finally:
        _running.reset(token)


@contextlib.contextmanager
def held_while_compiling(held: Held) -> Iterator[None]:
    """Enter another context, such as a paused time limit, whenever code is compiled.

    Args:
        held: Makes the context in which machine code is compiled.

    Yields:
        Nothing.
    """
    token = _held.set((*_held.get(), held))
    try:
        yield
    finally:
        _held.reset(token)


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Count the time in this context as loading or compiling; nested ones count once.

    Yields:
        Nothing.
    """
    if _is_compiling.get():
        yield
        return
    token, begin = _is_compiling.set(True), time.perf_counter()
    try:
        with contextlib.ExitStack() as stack:
            for held in _held.get():
                stack.enter_context(held())
            yield
    finally:
        _is_compiling.reset(token)
        spent = time.perf_counter() - begin
        for watch in _running.get():
            watch.compile_seconds += spent


@cache
def announce(what: str, duration: str, *, is_kept: bool = True) -> None:
    """Log, once in a process, that something is compiled.

    Args:
        what: Name of what is compiled.
        duration: Expected time, in words.
        is_kept: Whether later processes find the code in the cache.
    """
    how_often = "once" if is_kept else "as in each process, since no cache can be used"
    log.info("compiling %s for this machine, %s, %s", what, how_often, duration)
