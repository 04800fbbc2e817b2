"""Requests to stop, noticed even where a solver swallows them.

IPOPT as CasADi calls it takes Ctrl-C for a failure of its own and returns: Python never
raises the KeyboardInterrupt. So the request is noted when it comes, and looked for when
a step has been made; that step, broken off in the middle, does not count.
"""

import contextlib
from collections.abc import Callable, Iterator
from types import FrameType

from swarmstart.heuristics.interrupts import Handler, replaced_handlers


@contextlib.contextmanager
def noticed() -> Iterator[Callable[[], bool]]:
    """Note requests to stop while in the context.

    Yields:
        () -> whether there was one. Never, in another thread than the main one, where
        Python delivers no signals.
    """
    seen: list[int] = []

    def noting(handler: Handler) -> Handler:
        def note(number: int, frame: FrameType | None) -> None:
            seen.append(number)
            handler(number, frame)

        return note

    with replaced_handlers(noting):
        yield lambda: bool(seen)
