"""Ctrl-C put off while compiled kernels are called.

Numba runs Python code while it takes a random generator apart, and does not expect that
code to fail: an exception raised there by a signal handler ends in a crash of the
process. So while a kernel is called, a signal is only noted; its handler runs when the
call is over.
"""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
Handler = Callable[[int, FrameType | None], object]


@contextlib.contextmanager
def put_off() -> Iterator[None]:
    """Run the handlers of signals that come meanwhile at the end.

    Nothing is done in another thread than the main one, where Python delivers none.

    Yields:
        Nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    noted: list[tuple[int, FrameType | None]] = []
    handlers: dict[int, Handler] = {}
    for asked in SIGNALS:
        handler = signal.getsignal(asked)
        if callable(handler):  # Not where it is ignored, or left to the system.
            handlers[asked] = handler
            signal.signal(asked, lambda n, frame: noted.append((n, frame)))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number, frame in noted:
            handlers[number](number, frame)
