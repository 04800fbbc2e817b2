"""A limit of wall time for native code: the system ends the process.

A solver in native code that ignores the clock and does not return to Python can be
stopped by the system only. SIGALRM with its default action ends the process at any
point. The engine of cells detects this and calls the function that the cell names for
this case, its `rescue`. The limit works only in a process that the engine has made for
cells: a command, or a user's own program, is never ended.
"""

from __future__ import annotations

import json
import math
import os
import signal
import threading
import time as clock
from collections.abc import Iterator
from contextlib import contextmanager

from swarmstart.machine_code import held_while_compiling

PLACE = "SWARMSTART_CELL_PROCESS"
"""Environment variable with the number of the process and its reply descriptor."""
SOON_S = 1e-6
"""Shortest limit, since 0 would remove the limit [s]."""


def declare_cell_process(reply: int) -> None:
    """Allow limits to end this process.

    Args:
        reply: Descriptor that the engine reads; limits are announced on it before they
            end the process.
    """
    os.environ[PLACE] = f"{os.getpid()}:{reply}"


@contextmanager
def hard_limit(seconds: float | None) -> Iterator[None]:
    """End this process if the body of the `with` statement takes longer.

    Native code is ended, too. Time for compiling machine code does not count. If limits
    are nested, the one that ends earlier counts. Outside of a process of cells, in
    another thread than the main one, or on a system without SIGALRM there is no limit.

    Args:
        seconds: Wall time [s]; None or infinity means no limit.

    Raises:
        ValueError: If `seconds` is not a number, or negative.
    """
    if seconds is not None and not seconds >= 0:
        raise ValueError(f"expected a limit of 0 s or more, found {seconds}")
    reply = _reply()
    if seconds is None or math.isinf(seconds) or reply is None:
        yield
        return
    began = clock.monotonic()
    # The default action also ends native code; a handler in Python would wait for it.
    handler = signal.signal(signal.SIGALRM, signal.SIG_DFL)
    # Stops the timer of an outer limit, and tells what is left of it.
    outer, _ = signal.setitimer(signal.ITIMER_REAL, 0.0)
    _arm(seconds if not outer else min(seconds, outer), reply, told=seconds)
    try:
        with held_while_compiling(_stopped):
            yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        if outer:
            _arm(outer - (clock.monotonic() - began), reply, told=outer)
        elif handler is not None:
            signal.signal(signal.SIGALRM, handler)


@contextmanager
def _stopped() -> Iterator[None]:
    """Stop the clock of the limit."""
    left, _ = signal.setitimer(signal.ITIMER_REAL, 0.0)
    try:
        yield
    finally:
        if left:
            signal.setitimer(signal.ITIMER_REAL, left)


def _arm(seconds: float, reply: int, *, told: float) -> None:
    # Announced first: a process that was ended cannot tell the reason.
    os.write(reply, (json.dumps({"hard_limit": told}) + "\n").encode())
    signal.setitimer(signal.ITIMER_REAL, max(seconds, SOON_S))


def _reply() -> int | None:
    """Return the descriptor to the engine; None if this process must not be ended."""
    process, _, reply = os.environ.get(PLACE, "").partition(":")
    # Child processes inherit the environment, but are no processes for cells.
    if process != str(os.getpid()) or not hasattr(signal, "setitimer"):
        return None
    # Python sets actions of signals in the main thread only.
    is_main = threading.current_thread() is threading.main_thread()
    return int(reply) if is_main and reply.isdigit() else None
