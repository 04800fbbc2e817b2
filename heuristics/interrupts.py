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


@contextlib.contextmanager
def put_off() -> Iterator[None]:
    """Run the handlers of signals that come meanwhile at the end.

    Yields:
        Nothing.
    """
    noted: list[Callable[[], object]] = []

    def noting(handler: Handler) -> Handler:
        return lambda *signalled: noted.append(functools.partial(handler, *signalled))

    try:
        with replaced_handlers(noting):
            yield
    finally:
        for handle in noted:
            handle()
