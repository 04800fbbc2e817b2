"""Calls made ahead of their turn by copies of this process.

IPOPT's linear solver is not made for several threads, so solves from several starts
run in processes. A process that is copied by `fork` has all functions and machine code
at once. It makes one call, sends the result, and ends. The results come in the order
of the calls, and are the same for any number of processes.

A copy has none of the other threads; locks that they held stay locked in it. So a
program that has threads of its own, as a notebook has, makes all calls itself, one
after the other, unless it asks for processes; and so does any program on a system that
cannot copy a process.
"""

import os
import pickle
import select
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Generic, Self, TypeVar

T = TypeVar("T")

_OWN = "swarmstart", "rich."
"""Beginnings of the names and modules of threads that a copy never waits for."""
_PART = 1 << 20
"""Number of bytes that are read at once."""


def free_processors() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def threads_of(threads: int | None) -> int:
    """Return the number of threads asked for; None: one for each processor."""
    return free_processors() if threads is None else threads


def processes_of(threads: int | None) -> int:
    """Return the number of processes for a number of threads that was asked for.

    Args:
        threads: The number; None: as many as there are processors, unless the program
            has other threads.
    """
    if not sys.platform.startswith("linux"):  # Elsewhere libraries forbid the copy.
        return 1
    return 1 if threads is None and _has_other_threads() else threads_of(threads)


def _has_other_threads() -> bool:
    """Return whether there are threads besides this one and the package's own."""
    return any(
        one is not threading.current_thread()
        and not one.name.startswith(_OWN)
        and not type(one).__module__.startswith(_OWN)
        for one in threading.enumerate()
    )


@dataclass(frozen=True, slots=True)
class _Copy:
    """A copy of this process that makes a call.

    Attributes:
        process: Its number.
        pipe: Where its result is read.
    """

    process: int
    pipe: int

    @property
    def has_ended(self) -> bool:
        """True if there is something to read: a result, or the end of the process."""
        return bool(select.select([self.pipe], [], [], 0)[0])

    def read(self) -> bytes:
        """Wait until the process has ended; return the bytes that it has written."""
        parts = []
        while part := os.read(self.pipe, _PART):
            parts.append(part)
        return b"".join(parts)

    def end(self) -> None:
        """Stop the process, if it has not ended, and forget it."""
        os.close(self.pipe)
        # A program may have its children waited for by the system.
        with suppress(ProcessLookupError, ChildProcessError):
            os.kill(self.process, signal.SIGKILL)
            os.waitpid(self.process, 0)


class Ahead(Generic[T]):
    """Results of calls, in the order of the calls.

    Copies of this process, made by `fork`, make some of the calls ahead of their turn.

    Use as a context, which stops the copies that are left at its end.
    """

    def __init__(
        self,
        calls: Sequence[Callable[[], T]],
        *,
        processes: int,
        begins: Callable[[], None],
        sent: Callable[[T], Any],
        received: Callable[[Any], T],
        first: Sequence[int] = (),
    ) -> None:
        """Store the calls; none begins yet.

        Args:
            calls: The calls. They must change nothing that a later one reads.
            processes: Largest number of processes, this one counted.
            begins: Function that a copy calls first.
            sent: Function that turns a result into an object to pickle, in the copy.
            received: Function that turns this object into a result again, in this
                process.
            first: Numbers of the calls that copies make before all others, since the
                others may not be needed.
        """
        self._calls, self._most, self._first = calls, processes - 1, first
        self._begins, self._sent, self._received = begins, sent, received
        self._open = list(range(len(calls)))
        self._copies: dict[int, _Copy] = {}
        self._made: dict[int, T] = {}

    def __enter__(self) -> Self:
        """Return these results."""
        return self

    def __exit__(self, *_: object) -> None:
        """Stop the copies that are left."""
        while self._copies:
            self._copies.popitem()[1].end()

    def __iter__(self) -> Iterator[T]:
        """Yield all results."""
        return map(self.result, range(len(self._calls)))

    def result(self, number: int) -> T:
        """Return the result of a call.

        While a copy of this process still makes the call, this process makes others.

        Args:
            number: Number of the call, larger than that of the last result. Calls with
                numbers between these two are left out.
        """
        self._leave_out(number)
        while number not in self._made:
            copy = self._copies.get(number)
            if copy is not None and (copy.has_ended or not self._open):
                self._take(number)
                continue
            self._fill(1)
            own = self._open.pop(0)
            self._made[own] = self._calls[own]()
        return self._made.pop(number)

    def begin(self) -> bool:
        """Start the copies of this process; return whether there are any."""
        self._fill(0)
        return bool(self._copies)

    def _leave_out(self, number: int) -> None:
        """Forget all calls before this one."""
        self._open = [one for one in self._open if one >= number]
        for one in [one for one in self._copies if one < number]:
            self._copies.pop(one).end()

    def _fill(self, own: int) -> None:
        """Begin copies for the open calls but the first `own` of them."""
        while len(self._copies) < self._most and len(self._open) > own:
            wanted = [one for one in self._first if one in self._open[own:]]
            number = wanted[0] if wanted else self._open[own]
            self._open.remove(number)
            self._copies[number] = self._copied(self._calls[number])

    def _take(self, number: int) -> None:
        """Receive the result of a copy; make the call here without one."""
        found = self._copies[number].read()
        self._copies.pop(number).end()
        try:
            self._made[number] = self._received(pickle.loads(found))
        except (EOFError, pickle.UnpicklingError):
            # The copy failed, or was ended from outside: an error shows here.
            self._made[number] = self._calls[number]()

    def _copied(self, call: Callable[[], T]) -> _Copy:
        """Return a copy of this process that makes a call."""
        reading, writing = os.pipe()
        with warnings.catch_warnings():
            # Of other threads; see the head of the module.
            warnings.simplefilter("ignore", DeprecationWarning)
            process = os.fork()
        if process:
            os.close(writing)
            return _Copy(process, reading)
        # From here on in the copy, which must never return.
        try:
            os.close(reading)
            # Ctrl-C reaches the whole group; the parent stops its copies itself.
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            self._begins()
            data = pickle.dumps(self._sent(call()))
            with os.fdopen(writing, "wb") as pipe:
                pipe.write(data)
        except BaseException:  # noqa: BLE001 - whatever it is, the parent tries itself
            with suppress(OSError):
                os.close(writing)
        finally:
            os._exit(0)
