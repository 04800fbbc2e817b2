"""A second process that compiles a part of the kernels, on two or more processors.

The first use of an algorithm on a machine takes some seconds of compiling. A helper
process compiles a part of the kernels at the same time. It leaves the machine code in
the cache, in which this process finds it. If the helper fails, this process compiles
all kernels itself.
"""

import contextlib
import logging
import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from contextvars import ContextVar
from dataclasses import dataclass

from swarmstart.heuristics.laws.algorithm import Algorithm
from swarmstart.machine_code import cache_refusal

log = logging.getLogger(__name__)

Part = tuple[int, ...]
SMALLER_PART: Part = (1, 2, 3)
"""All but `propose`, for a helper that is started when the kernels are needed."""
LARGER_PART: Part = (0, 1)
"""`propose` and `accept`, for a helper that is started during other work."""

PATIENCE_S = 120.0
"""Longest time to wait for a helper; then this process does its part too [s]."""
_IN_HELPER = "SWARMSTART_COMPILES_AHEAD"
"""Set in the environment of a helper, which starts no other."""
_CODE = """
import pickle, sys
sys.path[:] = pickle.load(sys.stdin.buffer)
from swarmstart.heuristics.running.first_use import compile_part
compile_part(sys.stdin.buffer.read())
"""


@dataclass(frozen=True, slots=True)
class Helper:
    """A process that compiles a part of the kernels.

    Attributes:
        part: Indices of the tasks in `Search.preparations` that the helper does.
        process: The process; None if it could not be started.
    """

    part: Part
    process: subprocess.Popen[bytes] | None

    def wait(self) -> None:
        """Wait until the helper is done, or has taken too long."""
        if self.process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(timeout=PATIENCE_S)


NO_HELPER = Helper((), None)
_helper: ContextVar[Helper] = ContextVar("_helper", default=NO_HELPER)


@contextlib.contextmanager
def compiled_ahead(
    algorithm: Algorithm, *, compiled: bool, part: Part = SMALLER_PART
) -> Iterator[Helper]:
    """Have a helper compile a part of an algorithm's kernels during a context.

    The helper ends with the context. Within another such context no second helper is
    started.

    Args:
        algorithm: Settings of the algorithm.
        compiled: True if the search runs in the compiled loop, False if it runs in a
            loop in Python.
        part: Indices of the tasks in `Search.preparations` that the helper does.

    Yields:
        The helper; one without a process if none could be started.
    """
    running = _helper.get()
    if running.process is not None or not _is_possible():
        yield running
        return
    helper = _started(algorithm, compiled, part)
    token = _helper.set(helper)
    try:
        yield helper
    finally:
        _helper.reset(token)
        if helper.process is not None:
            helper.process.kill()  # What it has stored remains in the cache.
            helper.process.wait()


def helper_runs() -> bool:
    """Return whether a helper is at work, so that some kernels may be missing yet."""
    process = _helper.get().process
    return process is not None and process.poll() is None


def _is_possible() -> bool:
    """Return whether a helper would be of any use."""
    import numba

    # The processors that this process may use; some systems do not tell.
    here = getattr(os, "sched_getaffinity", lambda _: range(os.cpu_count() or 1))(0)
    jit = not numba.config.DISABLE_JIT  # type: ignore[attr-defined, unused-ignore]
    fit = bool(sys.executable) and len(here) > 1 and _IN_HELPER not in os.environ
    return jit and fit and cache_refusal() is None


def _started(algorithm: Algorithm, compiled: bool, part: Part) -> Helper:
    """Return a new helper; `NO_HELPER` if it cannot be started."""
    try:
        given = pickle.dumps(sys.path) + pickle.dumps((algorithm, compiled, part))
        process = subprocess.Popen(
            [sys.executable, "-c", _CODE],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, _IN_HELPER: "1"},
        )
    except (OSError, pickle.PicklingError, AttributeError, TypeError) as error:
        log.debug("no helper compiles ahead: %s", error)
        return NO_HELPER
    if process.stdin is not None:
        with contextlib.suppress(OSError):  # It has ended already.
            process.stdin.write(given)
            process.stdin.close()
    return Helper(part, process)
