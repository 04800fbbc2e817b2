"""Requests to stop (Ctrl-C, SIGTERM, SIGHUP), where they cannot be raised or get lost.

A signal handler raises its KeyboardInterrupt wherever Python happens to be, and three
places do not expect that:

- Numba runs Python code while it takes a random generator apart; an exception raised
  there ends in a crash of the process. `put_off` only notes a signal, and runs its
  handler when the call is over.
- IPOPT as CasADi calls it takes Ctrl-C for a failure of its own, and returns.
- CasADi's conversions take it for a wrong type of argument: another exception is
  raised, or another overload is tried.

For the last two, `heeded` notes the signal as well, and raises at its end what was
swallowed. What was computed meanwhile may be wrong, and does not count.
"""

import functools
import signal
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from types import FrameType, TracebackType
from typing import Self

SIGNALS = tuple(
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP")
    if hasattr(signal, name)
)
Handler = Callable[[int, FrameType | None], object]
Call = Callable[[], object]


class _StandIns:
    """Handlers that do something else while in the context, and then pass on.

    A signal may come between any two statements, also while handlers are put in or put
    back. One of these that is left behind passes every signal on to the handler that it
    replaced, so nothing is lost by it.
    """

    def __init__(self) -> None:
        self._replaced: dict[int, Handler] = {}
        self.is_active = False

    def __enter__(self) -> Self:
        try:
            self.is_active = True
            # Python delivers no signals to other threads.
            if threading.current_thread() is threading.main_thread():
                self._replace()
        except BaseException:
            self._put_back()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._put_back()

    def meanwhile(self, handle: Call) -> None:
        """Take a signal in the context; handle does what is done outside."""
        raise NotImplementedError

    def _replace(self) -> None:
        for number in SIGNALS:
            handler = signal.getsignal(number)
            if callable(handler):  # Not if it is ignored, or left to the system.
                self._replaced[number] = handler
                signal.signal(number, self._taken)

    def _put_back(self) -> None:
        self.is_active = False
        for number, handler in self._replaced.items():
            signal.signal(number, handler)

    def _taken(self, number: int, frame: FrameType | None) -> None:
        handle = functools.partial(self._replaced[number], number, frame)
        if self.is_active:
            self.meanwhile(handle)
        else:
            handle()


class _PutOff(_StandIns):
    """Context manager behind `put_off`."""

    def __init__(self) -> None:
        super().__init__()
        self._noted: list[Call] = []

    def __exit__(self, *raised: object) -> None:
        self._put_back()
        for handle in self._noted:
            handle()

    def meanwhile(self, handle: Call) -> None:
        self._noted.append(handle)

    def _replace(self) -> None:
        within = getattr(signal.getsignal(signal.SIGINT), "__self__", None)
        if not (isinstance(within, _PutOff) and within.is_active):
            super()._replace()


class _Heeded(_StandIns):
    """Context manager behind `heeded`."""

    def __init__(self) -> None:
        super().__init__()
        self._seen = False

    def __call__(self) -> bool:
        return self._seen

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._put_back()
        if self._seen and (error is None or isinstance(error, Exception)):
            raise KeyboardInterrupt from error

    def meanwhile(self, handle: Call) -> None:
        self._seen = True
        handle()


def put_off() -> AbstractContextManager[object, None]:
    """Return a context in which signals are noted, and handled at its end.

    Within itself it does nothing: the outermost one notes.
    """
    return _PutOff()


def heeded() -> AbstractContextManager[Callable[[], bool], None]:
    """Return a context in which a request to stop cannot be swallowed.

    A request that was, or that became another exception, is raised as KeyboardInterrupt
    at the end. In the context, () -> whether there was one; never, in another thread
    than the main one.
    """
    return _Heeded()
