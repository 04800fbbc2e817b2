"""Requests to stop, noticed even where a solver swallows them.

IPOPT as CasADi calls it takes Ctrl-C for a failure of its own and returns: Python never
raises the KeyboardInterrupt. So the request is noted when it comes, and looked for when
a step has been made; that step, broken off in the middle, does not count.
"""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextlib.contextmanager
def noticed() -> Iterator[Callable[[], bool]]:
    """Note requests to stop while in the context.

    Yields:
        () -> whether there was one. Never, in another thread than the main one, where
        Python delivers no signals.
    """
    seen: list[int] = []
    handlers: dict[int, Callable[[int, FrameType | None], object]] = {}

    def note(number: int, frame: FrameType | None) -> None:
        seen.append(number)
        handlers[number](number, frame)

    if threading.current_thread() is threading.main_thread():
        for asked in SIGNALS:
            handler = signal.getsignal(asked)
            if callable(handler):  # Not where it is ignored, or left to the system.
                handlers[asked] = handler
                signal.signal(asked, note)
    try:
        yield lambda: bool(seen)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
