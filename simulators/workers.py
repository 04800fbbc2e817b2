"""Roll-outs of a simulator in processes, so that a crash costs one roll-out only.

A process that ends or is late, because it hangs, is replaced. The results do not depend
on the number of processes, since each roll-out begins the simulator anew.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import subprocess
import sys
import time
import weakref
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.errors import brief
from swarmstart.ocp import Steps
from swarmstart.simulators.common import SimulatorError
from swarmstart.simulators.worker import LENGTH, answered, frame, rolled_out

_PART = 1 << 20
_PATIENCE_S = 2.0
"""Time that a process has to end by itself [s]."""
_LOADING_S = 120.0
"""Longest time to load a simulator [s]."""


class Order(NamedTuple):
    """A roll-out to be made.

    Attributes:
        x0: State at the start, shape (nx,).
        controls: Controls of each step, shape (nu, n).
        step: Length of a step [s].
    """

    x0: Array
    controls: Array
    step: float


@dataclass(frozen=True, slots=True)
class Failure:
    """A roll-out without a result.

    Attributes:
        kind: "ended", "late", "not finite" or the name of an error.
        words: What is known of the failure, in words.
    """

    kind: str
    words: str


class Workers:
    """Processes with a simulator each; as a context manager it ends the processes."""

    def __init__(self, simulator: Steps, *, count: int, limit_s: float) -> None:
        """Start no process yet.

        Args:
            simulator: The simulator, sent as a pickle.
            count: Number of processes.
            limit_s: Longest wall time of a roll-out [s].

        Raises:
            SimulatorError: If the simulator cannot be pickled.
        """
        self._name, self._limit = type(simulator).__name__, limit_s
        try:
            self._pickled = pickle.dumps(simulator)
            is_own = type(simulator).__module__ == "__main__"
        except Exception as error:
            raise SimulatorError(
                self._name, f"expected a simulator that can be pickled; {error}"
            ) from error
        if is_own:
            raise SimulatorError(
                self._name,
                "expected a class in a module of its own, which other processes can "
                "import; found one of the program itself (workers=0 stays in it)",
            )
        self._all: list[_Worker | None] = [None] * count

    def __enter__(self) -> Workers:
        """Return the workers."""
        return self

    def __exit__(self, *error: object) -> None:
        """End all processes."""
        for worker in self._all:
            if worker is not None:
                worker.end()
        self._all = [None] * len(self._all)

    def results(self, orders: Sequence[Order]) -> list[Array | Failure]:
        """Return the states (nx, n + 1) of each roll-out, or its failure.

        Raises:
            SimulatorError: If the simulator cannot be loaded.
        """
        found: list[Array | Failure | None] = [None] * len(orders)
        waiting, busy = deque(range(len(orders))), dict[int, tuple[int, float]]()
        while waiting or busy:
            for place in range(len(self._all)):
                if waiting and place not in busy:
                    number = waiting.popleft()
                    self._ready(place).send(orders[number])
                    busy[place] = number, time.monotonic() + self._limit
            for place, outcome in self._finished(busy).items():
                number, _ = busy.pop(place)
                found[number] = outcome
        return [one for one in found if one is not None]

    def _ready(self, place: int) -> _Worker:
        """Return a process that has loaded the simulator.

        Raises:
            SimulatorError: If the process cannot load the simulator.
        """
        worker = self._all[place]
        if worker is not None:
            return worker
        worker = self._all[place] = _Worker()
        worker.send(self._pickled)
        end = time.monotonic() + _LOADING_S
        answer: Any = None
        while answer is None and time.monotonic() < end:
            select.select([worker.file], [], [], 0.1)
            answer = worker.answer()
        if isinstance(answer, tuple) and answer[0]:
            return worker
        self._replace(place)
        why = answer.words if isinstance(answer, Failure) else "it took too long"
        words = ": ".join(answer[1]) if isinstance(answer, tuple) else why
        raise SimulatorError(self._name, f"cannot be loaded by a worker: {words}")

    def _finished(
        self, busy: dict[int, tuple[int, float]]
    ) -> dict[int, Array | Failure]:
        """Wait for some results, and return them by the places of their processes."""
        workers = {place: self._ready(place) for place in busy}
        left = min(end for _, end in busy.values()) - time.monotonic()
        select.select([one.file for one in workers.values()], [], [], max(0.0, left))
        found: dict[int, Array | Failure] = {}
        for place, worker in workers.items():
            answer = worker.answer()
            if isinstance(answer, Failure):
                self._replace(place)
                found[place] = answer
            elif answer is not None:
                found[place] = _outcome(*answer)
            elif time.monotonic() >= busy[place][1]:
                self._replace(place)
                found[place] = Failure("late", f"took longer than {self._limit:g} s")
        return found

    def _replace(self, place: int) -> None:
        worker, self._all[place] = self._all[place], None
        if worker is not None:
            worker.end()


def _outcome(is_made: bool, content: Any) -> Array | Failure:
    """Return the states of a roll-out, or its failure.

    Args:
        is_made: Whether the roll-out was made.
        content: The states, or the name of an error and its words.
    """
    if not is_made:
        return Failure(*content)
    states: Array = content
    if np.isfinite(states).all():
        return states
    return Failure("not finite", "a state is NaN or infinite")


class Here:
    """Roll-outs in this process, which a crash of the simulator ends."""

    def __init__(self, simulator: Steps) -> None:
        """Keep the simulator."""
        self._simulator = simulator

    def results(self, orders: Sequence[Order]) -> list[Array | Failure]:
        """Return the states (nx, n + 1) of each roll-out, or its failure."""
        return [
            _outcome(*answered(partial(rolled_out, self._simulator, *one)))
            for one in orders
        ]


class _Worker:
    """A running process and its answers.

    Attributes:
        file: The file from which answers are read.
    """

    def __init__(self) -> None:
        """Start it."""
        self._process = subprocess.Popen(
            [sys.executable, "-m", "swarmstart.simulators.worker"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            start_new_session=True,  # Ctrl-C is for the parent.
        )  # fmt: skip
        stdin, stdout = self._process.stdin, self._process.stdout
        self._to = -1 if stdin is None else stdin.fileno()
        self.file = -1 if stdout is None else stdout.fileno()
        self._rest = b""
        self.end = weakref.finalize(self, _end, self._process)

    def send(self, content: object) -> None:
        """Send a frame; an ended process is noticed when its answer is read."""
        left = memoryview(frame(content))
        with suppress(OSError):
            while left:
                left = left[os.write(self._to, left) :]

    def answer(self) -> Any:
        """Return an answer, None before it comes, or a failure if the process ended."""
        while select.select([self.file], [], [], 0)[0]:
            part = os.read(self.file, _PART)
            if not part:
                return Failure("ended", _how(self._process))
            self._rest += part
            if len(self._rest) >= LENGTH.size:
                (length,) = LENGTH.unpack_from(self._rest)
                whole = LENGTH.size + length
                if len(self._rest) >= whole:
                    pickled, self._rest = self._rest[LENGTH.size : whole], b""
                    return pickle.loads(pickled)
        return None


def _how(process: subprocess.Popen[bytes]) -> str:
    """Return how a process has ended, in words."""
    with suppress(subprocess.TimeoutExpired):
        code = process.wait(_PATIENCE_S)
        if code < 0:
            with suppress(ValueError):
                return f"by {signal.Signals(-code).name}"
            return f"by signal {-code}"
        return f"with code {code}"
    return brief("its output was closed")


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process: by itself, so that programs of its own end; else by force."""
    for pipe in (process.stdin, process.stdout):
        with suppress(OSError):
            if pipe is not None:
                pipe.close()
    with suppress(OSError):
        process.terminate()
    try:
        process.wait(_PATIENCE_S)
    except subprocess.TimeoutExpired:
        with suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
