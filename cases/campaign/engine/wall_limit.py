"""A limit of wall time that native code cannot outlive: the system ends the process.

A solver that does not look at the clock, in native code that does not come back to
Python, can be stopped by nothing else than the system. SIGALRM with its default action
does that, whatever the process is doing; the engine of cells notices, and goes on with
the cell's rescue. Only in a process that the engine has made for cells: a command, or a
user's own program, is never ended.
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

from swarmstart.compile_time import held_while_compiling

PLACE = "SWARMSTART_CELL_PROCESS"
"""Variable of the environment: number of the process of cells, and where it replies."""
SOON_S = 1e-6
"""In place of no time at all, which would take the limit away [s]."""


def declare_cell_process(reply: int) -> None:
    """Let this process be ended by its limits.

    Args:
        reply: Descriptor that the engine reads: it is told of limits before they end
            the process.
    """
    os.environ[PLACE] = f"{os.getpid()}:{reply}"


@contextmanager
def hard_limit(seconds: float | None) -> Iterator[None]:
    """End this process if the context takes longer, whatever code it is in.

    What machine code takes to be made does not count, as on a stopwatch. Within another
    limit, what ends first counts. Nothing happens outside of a process of cells, in
    another thread than the main one, or on a system without SIGALRM.

    Args:
        seconds: Wall time [s]; None or infinite: no limit.

    Raises:
        ValueError: If it is not a number, or negative.
    """
    if seconds is not None and not seconds >= 0:
        raise ValueError(f"expected a limit of 0 s or more, found {seconds}")
    reply = _reply()
    if seconds is None or math.isinf(seconds) or reply is None:
        yield
        return
    began = clock.monotonic()
    handler = signal.signal(signal.SIGALRM, signal.SIG_DFL)
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
    os.write(reply, (json.dumps({"hard_limit": told}) + "\n").encode())
    signal.setitimer(signal.ITIMER_REAL, max(seconds, SOON_S))


def _reply() -> int | None:
    """Return where the engine is told; None where this process may not be ended."""
    process, _, reply = os.environ.get(PLACE, "").partition(":")
    if process != str(os.getpid()) or not hasattr(signal, "setitimer"):
        return None
    is_main = threading.current_thread() is threading.main_thread()
    return int(reply) if is_main and reply.isdigit() else None
