"""A process that works on one cell after another, and is replaced when it dies.

The process is connected by its standard input and output only. Thus a command can start
one, and so can a worker of Dask, a process that can have no `multiprocessing` children.
Nothing is pickled.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time as clock
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from swarmstart.cases.campaign.engine.cell_work import Beginning, cell_content
from swarmstart.cases.record.files import RecordError

ATTEMPTS = 2
# Cells run side by side: more threads of one would slow down the others.
BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
PROGRAM = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from swarmstart.cases.campaign.engine.cell_work import serve; "
    "serve(int(sys.argv[2]))"
)
END = b""

Order = Mapping[str, Any]
"""Plain data: work, job, label, key, permissions, rescue, folder and timeout_s."""


class StoppedError(Exception):
    """The process was stopped during a cell."""


class OtherCodeError(Exception):
    """The code in the process is not the code from which the cell's key was made.

    Attributes:
        versions: Versions of the packages that the process has.
    """

    def __init__(self, versions: Mapping[str, str]) -> None:
        """Keep the versions."""
        super().__init__("other code")
        self.versions = dict(versions)


@dataclass(frozen=True, kw_only=True, slots=True)
class Ending:
    """The end of an attempt at a cell that gave no reply.

    Attributes:
        how: Way in which the process ended, in words; empty if its time limit was
            reached.
        limit: The hard limit that ended the attempt [s]; None if it ended otherwise.
        cpu_s: CPU seconds of the attempt; None if not known.
    """

    how: str
    limit: float | None = None
    cpu_s: float | None = None


class CellProcess:
    """A process that carries out cells, the units of a campaign's work, one at a time.

    The first cell starts the process.
    """

    def __init__(self) -> None:
        """Prepare; the process is started later."""
        self._process: subprocess.Popen[bytes] | None = None
        self._lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._cpu_s = 0.0
        self._limit: float | None = None
        self._lock = threading.Lock()
        self._is_ready = False
        self._is_stopped = False

    def done(self, order: Order) -> dict[str, Any]:
        """Carry out a cell, and return its reply.

        The order is the cell as plain data, as from `Cell.order`. The reply is a
        mapping: "content" is what the cell's file `cell.json` contains; "files" are the
        cell's files, if the order names no folder for them; "is_lost" is true if no
        attempt was completed, since the process died or reached a limit of time.

        A cell whose process dies is tried once more. If the hard limit ended the work,
        the cell's `rescue` finishes the cell.

        Raises:
            StoppedError: If `stop` was called during the cell.
            OtherCodeError: If the code in the process is not the code from which the
                cell's key was made.
            RecordError: If the result cannot be written.
        """
        began, ending = Beginning(), Ending(how="")
        for _ in range(ATTEMPTS):
            attempt = Beginning()
            found = self._attempted(order)
            if not isinstance(found, Ending):
                return found
            ending = found
            # The order of a rescue has `spent`, so there is no rescue of a rescue.
            if found.limit is not None and order["rescue"] and not order.get("spent"):
                spent = {
                    "seconds": clock.perf_counter() - attempt.seconds,
                    "cpu_s": found.cpu_s,
                    "date": attempt.date,
                }
                return self.done({**order, "spent": spent})
            # At a time limit a second attempt would take as long as the first.
            if found.limit is not None or not found.how:
                break
        failure = _failure(ending)
        if order.get("spent"):
            failure = f"its rescue after the hard limit failed: {failure}"
        content = cell_content(
            order, began, failure=failure, again=True, cpu_s=ending.cpu_s
        )
        return {"content": content, "is_lost": True}

    def stop(self) -> None:
        """End the process, also during a cell; it is not started again."""
        with self._lock:
            self._is_stopped = True
            self._end()

    def _attempted(self, order: Order) -> dict[str, Any] | Ending:
        """Return the reply to an order, or the ending of an attempt without one."""
        self._start()
        sent = {name: order[name] for name in order if name != "timeout_s"}
        line = json.dumps(sent, allow_nan=False).encode() + b"\n"
        # The start of the process is not part of the time limit below.
        if not self._is_ready and self._next(None) is None:
            return self._ended()
        self._is_ready = True
        self._send(line)
        timeout_s = order["timeout_s"]
        last = None if timeout_s is None else clock.monotonic() + timeout_s
        while True:
            try:
                reply = self._next(last)
            except queue.Empty:
                with self._lock:
                    self._end()
                return Ending(how="")
            if reply is None:
                return self._ended()
            if "hard_limit" in reply:
                # Announced before it can end the process; no reply to the order yet.
                self._limit = reply["hard_limit"]
                continue
            self._limit, self._cpu_s = None, reply.pop("cpu")
            return _checked(reply)

    def _next(self, last: float | None) -> dict[str, Any] | None:
        """Return the next message of the process; None if it has ended.

        Args:
            last: End of waiting, on the monotonic clock [s]; None means no end.

        Raises:
            queue.Empty: If no message comes until then.
        """
        timeout = None if last is None else max(0.0, last - clock.monotonic())
        line = self._lines.get(timeout=timeout)
        if line == END:
            return None
        said: dict[str, Any] = json.loads(line)
        if "ready" in said:
            self._cpu_s = said["ready"]
        return said

    def _start(self) -> None:
        """Start a process unless one runs."""
        with self._lock:
            if self._is_stopped:
                raise StoppedError
            if self._process is not None and self._process.poll() is None:
                return
            self._end()
            # An empty entry means the current folder, whatever that is later.
            path = [entry or os.getcwd() for entry in sys.path]
            process = subprocess.Popen(
                # -P: no module is imported from the current folder.
                [
                    sys.executable,
                    "-P",
                    "-c",
                    PROGRAM,
                    json.dumps(path),
                    str(os.getpid()),
                ],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env={**os.environ, **dict.fromkeys(BLAS_THREADS, "1")},
            )
            # A new queue: a late line of the old process is not taken for a reply.
            lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
            # A thread, since reading from a pipe has no time limit.
            listener = threading.Thread(
                target=_listen, args=(process, lines), daemon=True
            )
            listener.start()
            self._process, self._lines = process, lines
            self._limit, self._is_ready = None, False

    def _send(self, line: bytes) -> None:
        """Send a line; a process that has died can still have messages to read."""
        process = self._process  # None: stopped by another thread.
        if process is not None and process.stdin is not None:
            with suppress(OSError, ValueError):  # ValueError: closed by another thread.
                process.stdin.write(line)
                process.stdin.flush()

    def _ended(self) -> Ending:
        """Reap the process and return its ending."""
        with self._lock:
            if self._is_stopped:
                raise StoppedError
            code, cpu_s = self._end()
        # Windows has no SIGALRM, and so no hard limits.
        by_alarm = hasattr(signal, "SIGALRM") and code == -signal.SIGALRM
        return Ending(
            how=_words(code),
            limit=self._limit if by_alarm else None,
            # Without what earlier cells took: their CPU seconds came with the replies.
            cpu_s=None if cpu_s is None else cpu_s - self._cpu_s,
        )

    def _end(self) -> tuple[int, float | None]:
        """End and reap the process; return its exit code and all of its CPU seconds."""
        process, self._process = self._process, None
        if process is None:
            return 0, None
        try:
            if process.returncode is not None:
                # Reaped by `poll` in `_start`, which does not tell the CPU seconds.
                return process.returncode, None
            if not hasattr(os, "wait4"):
                process.kill()
                return process.wait(), None
            with suppress(ProcessLookupError):  # No effect while it ends.
                os.kill(process.pid, signal.SIGKILL)
            # In contrast to `wait`, this tells the CPU seconds.
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            return process.returncode, usage.ru_utime + usage.ru_stime
        finally:
            if process.stdin is not None:
                with suppress(OSError):
                    process.stdin.close()


def _listen(process: subprocess.Popen[bytes], lines: queue.SimpleQueue[bytes]) -> None:
    """Read the messages of a process until it ends."""
    if process.stdout is not None:
        with process.stdout as said:
            for line in said:
                if line.endswith(b"\n"):  # An incomplete line is not a message.
                    lines.put(line)
    lines.put(END)


def _checked(reply: dict[str, Any]) -> dict[str, Any]:
    if "refused" in reply:
        raise OtherCodeError(reply["refused"])
    if "unwritten" in reply:
        raise RecordError(reply["unwritten"])
    return reply


def _failure(found: Ending) -> str:
    if found.limit is not None:
        return f"stopped by the hard limit of {found.limit:g} s"
    if not found.how:
        return "it took longer than its time limit"
    return f"its process died: {found.how}"


def _words(code: int) -> str:
    """Return an exit code in words."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"
