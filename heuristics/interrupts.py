"""Ctrl-C put off while compiled kernels are called.

Numba runs Python code while it takes a random generator apart, and does not expect that
code to fail: an exception raised there by a signal handler ends in a crash of the
process. So while a kernel is called, a signal is only noted; its handler runs when the
call is over.
"""

import contextlib
import functools
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
Handler = Callable[[int, FrameType | None], object]


@contextlib.contextmanager
def replaced_handlers(replacement: Callable[[Handler], Handler]) -> Iterator[None]:
    """Have requests to stop handled otherwise.

    Nothing is done in another thread than the main one, where Python delivers none.

    Args:
        replacement: The handler in force -> the one to put in its place meanwhile.

    Yields:
        Nothing.
    """
    handlers: dict[int, Handler] = {}
    if threading.current_thread() is threading.main_thread():
        for asked in SIGNALS:
            handler = signal.getsignal(asked)
            if callable(handler):  # Not where it is ignored, or left to the system.
                handlers[asked] = handler
                signal.signal(asked, replacement(handler))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


class _Noting:
    """A handler that notes signals in place of another one."""

    def __init__(self, handler: Handler, noted: list[Callable[[], object]]) -> None:
        self._handler, self._noted = handler, noted

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Note a signal."""
        self._noted.append(functools.partial(self._handler, number, frame))


@contextlib.contextmanager
def put_off() -> Iterator[None]:
    """Run the handlers of signals that come meanwhile at the end.

    Within itself it does nothing: the outermost one notes.

    Yields:
        Nothing.
    """
    if isinstance(signal.getsignal(signal.SIGINT), _Noting):
        yield
        return
    noted: list[Callable[[], object]] = []
    try:
        with replaced_handlers(lambda handler: _Noting(handler, noted)):
            yield
    finally:
        for handle in noted:
            handle()
