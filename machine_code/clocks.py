"""Clocks: wall time without the time spent on machine code, and work in operations.

Code that loads or compiles runs within `compiling`; a `stopwatch` measures the time
spent there apart from all other time.

A proof that ends when its time is over proves less on a busy machine; with a budget of
work it proves the same everywhere. A unit of work is a number of operations that takes
about a second on one core; the code that computes tells how many operations it did:

    with working(seconds=600.0) as clock:        # a limit on top, in seconds
        until = now() + 60.0                     # a budget of 60 units of work
        while now() < until:
            done(operations)
    clock.was_late                               # True if the limit was met first
"""

import contextlib
import logging
import math
import time
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass
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
    """Return a context that measures time without that spent on machine code.

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
        held: Function that returns the context in which machine code is compiled.

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
    """Count time in this context as loading or compiling; nested contexts count once.

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


OPERATIONS = 1e9
"""Operations in a unit of work."""


@dataclass(eq=False)
class WorkClock:
    """Clock of the work of one task.

    Attributes:
        limit: Time of `time.perf_counter` at which the task must end [s]; infinity: no
            limit.
        work: Units of work done so far.
        was_late: Whether the clock was read after the limit.
    """

    limit: float
    work: float = 0.0
    was_late: bool = False

    def now(self) -> float:
        """Return the units of work so far; infinity after the limit."""
        if time.perf_counter() > self.limit:
            self.was_late = True
            return math.inf
        return self.work


_CURRENT: ContextVar[WorkClock | None] = ContextVar("work", default=None)


@contextlib.contextmanager
def working(*, seconds: float | None = None) -> Iterator[WorkClock]:
    """Count the work of a `with` block; an enclosing block counts it as well.

    Args:
        seconds: Wall time after which no budget is left [s]; None: no limit.
    """
    outer, began = _CURRENT.get(), time.perf_counter()
    limit = math.inf if seconds is None else began + seconds
    clock = WorkClock(limit if outer is None else min(limit, outer.limit))
    token = _CURRENT.set(clock)
    try:
        yield clock
    finally:
        _CURRENT.reset(token)
        if outer is not None:
            outer.work += clock.work
            outer.was_late = outer.was_late or clock.was_late


def now() -> float:
    """Return the units of work counted so far in the enclosing `working` block.

    After the block's limit it is infinity. Outside of such a block it is the time of
    `time.perf_counter` [s].
    """
    clock = _CURRENT.get()
    return time.perf_counter() if clock is None else clock.now()


def done(operations: float) -> None:
    """Add operations, such as additions of floats, to the work of the current block."""
    clock = _CURRENT.get()
    if clock is not None:
        clock.work += operations / OPERATIONS
