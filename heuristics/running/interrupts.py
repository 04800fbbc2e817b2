"""Requests to stop (Ctrl-C, SIGTERM, SIGHUP) in calls that would lose them or crash.

A signal handler raises its KeyboardInterrupt wherever Python happens to be, and three
places do not expect that:

- Numba runs Python code while it takes a random generator apart; an exception raised
  there ends in a crash of the process. `put_off` only notes a signal, and runs its
  handler when the call is over.
- IPOPT as CasADi calls it takes Ctrl-C for a failure of its own, and returns.
- CasADi's conversions take it for a wrong type of argument: another exception is
  raised, or another overload is tried.

For the last two, `heeded` notes the signal as well. If the signal was swallowed, it
raises KeyboardInterrupt at its end. Results computed meanwhile may be wrong, and are
not used.
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
    """Signal handlers that replace the usual ones in a context.

    A signal may come between any two statements, even while handlers are replaced or
    restored. A handler that is left behind passes every signal on to the handler that
    it replaced, so no signal is lost.
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
        except BaseException:  # A signal may arrive here too.
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
        """Handle a signal in the context; `handle` calls the usual handler."""
        raise NotImplementedError

    def _replace(self) -> None:
        for number in SIGNALS:
            handler = signal.getsignal(number)
            if callable(handler):  # Not if it is ignored, or left to the system.
                self._replaced[number] = handler
                signal.signal(number, self._taken)

    def _put_back(self) -> None:
        self.is_active = False  # First: from now on signals are passed on.
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
        # The handler of an outer context is a method of it.
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
        # A KeyboardInterrupt or SystemExit goes on by itself.
        if self._seen and (error is None or isinstance(error, Exception)):
            raise KeyboardInterrupt from error

    def meanwhile(self, handle: Call) -> None:
        self._seen = True
        handle()


def put_off() -> AbstractContextManager[object, None]:
    """Return a context that notes signals and handles them at its end.

    Nested contexts do nothing: only the outermost one notes signals.
    """
    return _PutOff()


def heeded() -> AbstractContextManager[Callable[[], bool], None]:
    """Return a context in which a request to stop cannot get lost.

    A request that was swallowed, or became another exception, is raised as
    KeyboardInterrupt at the end. The context yields a function: () -> whether there was
    a request. In another thread than the main one this function always returns False.
    """
    return _Heeded()
