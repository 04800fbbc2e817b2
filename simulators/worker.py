"""A process that makes roll-outs of a simulator; see workers.py.

    python -m swarmstart.simulators.worker

Frames of bytes come on standard input and are answered on standard output: eight bytes
with a length, then a pickle. What the simulator itself prints goes to standard error.
The sender is the process that started this one.
"""

from __future__ import annotations

import ctypes
import os
import pickle
import signal
import struct
import sys
from collections.abc import Callable
from functools import partial
from typing import IO, Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp import Steps
from swarmstart.ocp.loop import begun, stepped

LENGTH = struct.Struct("<Q")
"""Form of the length of a frame."""
_DIES_WITH_PARENT = 1
"""PR_SET_PDEATHSIG of prctl."""


def rolled_out(simulator: Steps, x0: Array, controls: Array, h: float) -> Array:
    """Return the states of a roll-out, shape (nx, n + 1).

    Args:
        simulator: The simulator, which is begun anew if it keeps a state.
        x0: State at the start, shape (nx,).
        controls: Controls of each step, shape (nu, n).
        h: Length of a step [s].
    """
    state = begun(simulator, x0)
    return np.column_stack([state, stepped(simulator, state, controls, h)])


def received(stream: IO[bytes]) -> Any:
    """Return the content of the next frame.

    Raises:
        EOFError: If there is no frame.
    """
    head = stream.read(LENGTH.size)
    if len(head) < LENGTH.size:
        raise EOFError
    (length,) = LENGTH.unpack(head)
    return pickle.loads(stream.read(length))


def frame(content: object) -> bytes:
    """Return a frame with a content, as bytes."""
    pickled = pickle.dumps(content)
    return LENGTH.pack(len(pickled)) + pickled


def answered(call: Callable[[], Any]) -> tuple[bool, Any]:
    """Make a call; return True and its result, or False and its error in words."""
    try:
        return True, call()
    except Exception as error:  # noqa: BLE001 - a simulator raises what it likes
        return False, (type(error).__name__, " ".join(str(error).split()))


def main() -> int:
    """Load the simulator from the first frame of bytes, then make roll-outs.

    Each further frame is answered by a roll-out, until the input ends.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # The parent ends this process.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(_DIES_WITH_PARENT, signal.SIGTERM)
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    pickled = received(requests)
    is_loaded, simulator = answered(lambda: pickle.loads(pickled))
    answers.write(frame((is_loaded, None if is_loaded else simulator)))
    answers.flush()
    while is_loaded:
        try:
            order = received(requests)
        except EOFError:
            break
        with np.errstate(all="ignore"):
            found = answered(partial(rolled_out, simulator, *order))
        answers.write(frame(found))
        answers.flush()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
