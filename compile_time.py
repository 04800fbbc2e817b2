"""Wall time without what loading and compiling machine code takes.

What makes machine code does so within `compiling`; what measures time does so with a
`stopwatch`, which shows both apart.
"""

import contextlib
import logging
import time
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from functools import cache

log = logging.getLogger(__name__)


class Stopwatch:
    """Wall time since the start, that spent on machine code apart.

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
        """Time spent on all else [s]."""
        return time.perf_counter() - self._begin - self.compile_seconds


_running: ContextVar[tuple[Stopwatch, ...]] = ContextVar("_running", default=())
_is_compiling: ContextVar[bool] = ContextVar("_is_compiling", default=False)
Held = Callable[[], contextlib.AbstractContextManager[None]]
_held: ContextVar[tuple[Held, ...]] = ContextVar("_held", default=())


@contextlib.contextmanager
def stopwatch() -> Iterator[Stopwatch]:
    """Measure time; machine code counts apart as long as the context is open.

    Yields:
        A stopwatch that may be read at any time; those within others all run.
    """
    watch = Stopwatch()
    token = _running.set((*_running.get(), watch))
    try:
        yield watch
    finally:
        _running.reset(token)


@contextlib.contextmanager
def held_while_compiling(held: Held) -> Iterator[None]:
    """Hold something, such as a limit of time, while machine code is made.

    Args:
        held: Makes the context that machine code is made in.

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
    """Count what is done meanwhile as loading or compiling; once if nested.

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
    """Say by logging, once in a process, that something is compiled.

    Args:
        what: What is compiled.
        duration: How long it takes, in words.
        is_kept: Whether a later process finds it.
    """
    how_often = "once" if is_kept else "as in each process, since no cache can be used"
    log.info("compiling %s for this machine, %s, %s", what, how_often, duration)
