"""A second process that compiles a part of the kernels, where there are two processors.

The first use of an algorithm on a machine takes some seconds of compiling. A helper
process does a part of it at the same time, and leaves its machine code in the cache,
where this process finds it. If the helper fails, this process does all by itself.
"""

import contextlib
import logging
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextvars import ContextVar

import numba

from swarmstart.code_cache import usage
from swarmstart.heuristics.algorithm import Algorithm

log = logging.getLogger(__name__)

Wait = Callable[[], None]

PATIENCE_S = 120.0
"""How long a helper is waited for; then this process does its part too [s]."""
_IN_HELPER = "SWARMSTART_COMPILES_AHEAD"
"""Set in the environment of a helper, which starts no other."""
_CODE = """
import pickle, sys
sys.path[:] = pickle.load(sys.stdin.buffer)
from swarmstart.heuristics.ahead import compile_part
compile_part(sys.stdin.buffer.read())
"""

_helper: ContextVar[subprocess.Popen[bytes] | None] = ContextVar(
    "_helper", default=None
)


@contextlib.contextmanager
def compiled_ahead(algorithm: Algorithm, *, compiled: bool) -> Iterator[Wait]:
    """Have a helper compile all kernels of an algorithm but `propose` meanwhile.

    Within another such context no second helper is started. It ends with the context.

    Args:
        algorithm: The algorithm.
        compiled: Whether for the compiled loop, or for a loop in Python.

    Yields:
        A function that returns when the helper is done.
    """
    running = _helper.get()
    if running is not None or not _is_possible():
        yield _nothing if running is None else _waiting_for(running)
        return
    helper = _started(algorithm, compiled)
    token = _helper.set(helper)
    try:
        yield _nothing if helper is None else _waiting_for(helper)
    finally:
        _helper.reset(token)
        if helper is not None:
            helper.kill()
            helper.wait()


def compile_part(pickled: bytes) -> None:
    """Compile all kernels of an algorithm but `propose`: the work of a helper.

    Args:
        pickled: The algorithm, and whether for the compiled loop.
    """
    from swarmstart.heuristics.search import (  # noqa: PLC0415 - it imports this
        smallest_search,
    )

    algorithm, compiled = pickle.loads(pickled)
    for job in smallest_search(algorithm).preparations(compiled=compiled)[1:]:
        job()


def _is_possible() -> bool:
    """Return whether a helper would be of any use."""
    here = getattr(os, "sched_getaffinity", lambda _: range(os.cpu_count() or 1))(0)
    jit = not numba.config.DISABLE_JIT  # type: ignore[attr-defined, unused-ignore]
    fit = bool(sys.executable) and len(here) > 1 and _IN_HELPER not in os.environ
    return jit and fit and usage().refused is None


def _started(algorithm: Algorithm, compiled: bool) -> subprocess.Popen[bytes] | None:
    """Return a new helper; None if there can be none."""
    try:
        given = pickle.dumps(sys.path) + pickle.dumps((algorithm, compiled))
        helper = subprocess.Popen(
            [sys.executable, "-c", _CODE],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, _IN_HELPER: "1"},
        )
    except (OSError, pickle.PicklingError, AttributeError, TypeError) as error:
        log.debug("no helper compiles ahead: %s", error)
        return None
    if helper.stdin is not None:
        with contextlib.suppress(OSError):  # It has ended already.
            helper.stdin.write(given)
            helper.stdin.close()
    return helper


def _waiting_for(helper: subprocess.Popen[bytes]) -> Wait:
    def wait() -> None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            helper.wait(timeout=PATIENCE_S)

    return wait


def _nothing() -> None:
    """Return at once: there is no helper."""
