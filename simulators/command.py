"""A program in any language as a plant: JSON lines on its standard input and output.

    to the program                              from it
    {"swarmstart": 1}                           {"states": ["angle", "speed"],
                                                 "controls": ["torque"],
                                                 "keeps_state": false}
    {"start_at": [0.0, 0.0]}                    {"x": [0.0, 0.0]}
    {"x": [0.0, 0.0], "u": [1.0], "dt": 0.1}    {"x": [0.0049, 0.0993]}

In place of an answer the program can send {"error": "words"}. With
`"keeps_state": true` the program has a memory of its own in addition to x; then a step
accepts only the state that was returned last. Without such a memory, a program that
ends or is late is started again once.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import shlex
import signal
import subprocess
import tempfile
import time
import weakref
from collections.abc import Mapping, Sequence
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import a_number, checked, reals, several, text
from swarmstart.arrays import Array
from swarmstart.errors import brief
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.limits import numbers_of
from swarmstart.ocp.common.pickling import Called
from swarmstart.simulators.common import (
    STEP,
    SimulatorError,
    require_last,
    require_start,
    vector,
)

MOST_BYTES = 1 << 20
"""Longest answer [bytes]."""
_PART = 65536
_LONGEST_S = 1e6


class _LostError(Exception):
    """A program has ended, or is late."""


@checked(
    refused,
    command=several(text(longest=4000), "a sequence of words"),
    limit_s=a_number(above=0, most=_LONGEST_S),
)
class CommandPlant(Called):
    """A program as a plant.

    Attributes:
        state_names: Names of the states, as the program gives them.
        control_names: Names of the controls, as the program gives them.
        keeps_state: True if the program has a memory of its own in addition to x.
        restarts: How often the program was started again, because it had ended or was
            late.

    Example:
        >>> import sys
        >>> import swarmstart as ss
        >>> program = '''
        ... import json, sys
        ... for line in sys.stdin:
        ...     asked = json.loads(line)
        ...     if "swarmstart" in asked:
        ...         found = {"states": ["level"], "controls": ["inflow"]}
        ...     elif "start_at" in asked:
        ...         found = {"x": asked["start_at"]}
        ...     else:
        ...         found = {"x": [asked["x"][0] + asked["dt"] * asked["u"][0]]}
        ...     print(json.dumps(found), flush=True)
        ... '''
        >>> with ss.CommandPlant([sys.executable, "-c", program]) as plant:
        ...     plant.state_names, plant.step([1.0], [0.5], 2.0)
        (('level',), array([2.]))
    """

    def __init__(self, command: Sequence[str], *, limit_s: float = 10.0) -> None:
        """Start the program, and ask for its names.

        Args:
            command: The program and its arguments; no shell reads them.
            limit_s: Longest wall time until an answer [s].

        Raises:
            SimulatorError: If the program cannot be started, or sends an invalid
                answer.
        """
        if not len(command):
            raise SimulatorError("the command", "expected a program, found no word")
        self._command, self._limit = tuple(command), limit_s
        self._name = shlex.join(command)
        self._last: Array | None = None
        self._is_closed, self.restarts = False, 0
        hello = self._greeted()
        self.state_names = self._names(hello, "states")
        self.control_names = self._names(hello, "controls")
        self.keeps_state = hello.get("keeps_state", False)
        if not isinstance(self.keeps_state, bool):
            raise self._unexpected('true or false as "keeps_state"', hello)

    def __enter__(self) -> CommandPlant:
        """Return the plant."""
        return self

    def __exit__(self, *error: object) -> None:
        """End the program."""
        self.close()

    @checked(refused, x=reals(axes=1))
    def start_at(self, x: ArrayLike) -> Array:
        """Begin a run, and return the state at which it begins, shape (nx,).

        Args:
            x: State, shape (nx,).

        Raises:
            SimulatorError: If the program begins at another state, fails, or is late
                twice.
        """
        asked = vector(self._name, "the state", x, self.state_names)
        found = self._asked({"start_at": asked.tolist()}, again=True)
        require_start(self._name, asked, found, self.state_names)
        self._last = found
        return found.copy()

    @checked(refused, x=reals(axes=1), u=reals(axes=1), dt=STEP)
    def step(self, x: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """Return the state after a step, shape (nx,).

        Args:
            x: State, shape (nx,); if `keeps_state` is True, it must be the one that was
                returned last.
            u: Controls held over the step, shape (nu,).
            dt: Length of the step [s].

        Raises:
            SimulatorError: If the program fails, is late, or sends an invalid answer.
        """
        if self.keeps_state:
            require_last(self._name, np.asarray(x, dtype=np.float64), self._last)
        state = vector(self._name, "the state", x, self.state_names)
        control = vector(self._name, "the controls", u, self.control_names)
        asked = {"x": state.tolist(), "u": control.tolist(), "dt": float(dt)}
        self._last = None  # Until the step has succeeded.
        self._last = self._asked(asked, again=not self.keeps_state)
        return self._last.copy()

    def close(self) -> None:
        """End the program, which also ends when the plant is no longer referenced."""
        self._is_closed = True
        self._process.close()

    def _greeted(self) -> Mapping[str, Any]:
        """Start the program, and return what it says of itself."""
        self._process = _Process(self._command, self._name)
        return self._answered({"swarmstart": 1})

    def _asked(self, question: Mapping[str, Any], *, again: bool) -> Array:
        """Return the state of an answer, shape (nx,).

        Args:
            question: Line that is sent.
            again: Whether the line is sent once more if the program has ended or is
                late.
        """
        if self._is_closed:
            raise SimulatorError(
                self._name, "expected a program in use, found it closed"
            )
        try:
            answer = self._answered(question)
        except SimulatorError as error:
            if not (again and isinstance(error.__cause__, _LostError)):
                raise
            self.restarts += 1
            self._greeted()
            answer = self._answered(question)
        try:
            found = numbers_of("x", answer["x"])
        except (KeyError, OverflowError, InvalidProblemError) as error:
            raise self._unexpected('"x" and a list of numbers', answer) from error
        if found.shape != (len(self.state_names),):
            raise self._unexpected(f'{len(self.state_names)} numbers as "x"', answer)
        return found

    def _answered(self, question: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the program's answer, a JSON object.

        Raises:
            SimulatorError: If it has another form, or says that there is an error;
                because of `_LostError` if there is no answer.
        """
        try:
            line = self._process.asked(json.dumps(question), self._limit)
        except _LostError as lost:
            words = self._process.last_words()
            self._process.close()
            raise SimulatorError(self._name, f"{lost}{words}") from lost
        try:
            answer = json.loads(line)
        except (ValueError, RecursionError):  # The latter: lists within lists.
            answer = None
        if not isinstance(answer, dict):
            raise self._unexpected("a JSON object on one line", line)
        if "error" in answer:
            raise SimulatorError(self._name, f"it said: {brief(answer['error'])}")
        return answer

    def _names(self, hello: Mapping[str, Any], role: str) -> tuple[str, ...]:
        """Return names that the program has sent."""
        names = hello.get(role)
        if (
            not isinstance(names, list)
            or not names
            or not all(isinstance(name, str) for name in names)
            or len(set(names)) < len(names)
        ):
            raise self._unexpected(f'"{role}" and a list of different names', hello)
        return tuple(names)

    def _unexpected(self, wanted: str, found: object) -> SimulatorError:
        """Return an error about an answer, after which the program is ended."""
        self._process.close()  # What it would send next belongs to no question.
        return SimulatorError(self._name, f"expected {wanted}, found {brief(found)}")


class _Process:
    """A running program and its answers."""

    def __init__(self, command: tuple[str, ...], name: str) -> None:
        """Start it in a group of its own, so that it can be ended with its children.

        Raises:
            SimulatorError: If it cannot be started.
        """
        # Open as long as the program may write to it.
        self._words: IO[bytes] = tempfile.TemporaryFile()
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                stderr=self._words, start_new_session=True,
            )  # fmt: skip
        except (OSError, ValueError) as error:
            self._words.close()
            raise SimulatorError(
                name, f"expected a program to start; {error}"
            ) from error
        self._rest = b""
        self._to, self._from = (
            -1 if pipe is None else pipe.fileno()  # Both are there: they are asked for.
            for pipe in (self._process.stdin, self._process.stdout)
        )
        self.close = weakref.finalize(self, _ended, self._process, self._words)

    def asked(self, line: str, limit: float) -> str:
        """Send a line to the program, and return the next line that it answers.

        Raises:
            _LostError: If the program has ended, or the time is over.
        """
        if not self.close.alive:  # Its pipes may be files of others now.
            raise _LostError("the program has ended")
        end = time.monotonic() + limit
        late = _LostError(f"expected an answer within {limit:g} s, found none")
        content = line.encode() + b"\n"
        try:
            while content:  # It may be late to read, too.
                if not select.select([], [self._to], [], _left(end))[1]:
                    raise late
                content = content[os.write(self._to, content[: select.PIPE_BUF]) :]
            while b"\n" not in self._rest:
                if not select.select([self._from], [], [], _left(end))[0]:
                    raise late
                self._receive()
        except OSError as error:
            raise _LostError("the program has ended") from error
        found, self._rest = self._rest.split(b"\n", 1)
        return found.decode("utf-8", "replace")

    def _receive(self) -> None:
        """Add what the program has sent."""
        part = os.read(self._from, _PART)
        if not part:
            raise _LostError("the program has ended")
        self._rest += part
        if len(self._rest) > MOST_BYTES:
            raise _LostError(f"an answer is longer than {MOST_BYTES:,} bytes")

    def last_words(self) -> str:
        """Return the last line of the program's standard error, for a message."""
        if self._words.closed:
            return ""
        self._words.seek(0, os.SEEK_END)
        self._words.seek(max(0, self._words.tell() - _PART))
        lines = self._words.read().decode("utf-8", "replace").split("\n")
        said = [line.strip() for line in lines if line.strip()]
        return f"; it wrote: {brief(said[-1])}" if said else ""


def _left(end: float) -> float:
    """Return the time until an end [s], at least 0."""
    return max(0.0, end - time.monotonic())


def _ended(process: subprocess.Popen[bytes], words: IO[bytes]) -> None:
    """End a program and its children, and close what they were connected by."""
    with contextlib.suppress(OSError):
        os.killpg(process.pid, signal.SIGKILL)
    for pipe in (process.stdin, process.stdout, words):
        with contextlib.suppress(OSError):
            if pipe is not None:
                pipe.close()
    process.wait()
