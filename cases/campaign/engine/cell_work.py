"""Work of a process for cells: read an order, carry it out, write or send the result.

    {"work": ..., "job": ..., "key": ..., "folder": ...}  ->  {"content": ...}

Orders and replies are lines of JSON on the process's standard input and output; output
that the work prints goes to standard error. `content` is what the cell's mark, its file
`cell.json`, contains: the result and the machine, without data about the machine's
owner. The process ends when its input ends, thus also when its parent process has
ended.

A cell is a piece of work that a few plain data determine, such as one run of a sweep.
"""

from __future__ import annotations

import base64
import ctypes
import json
import os
import platform
import queue
import signal
import sys
import tempfile
import threading
import time as clock
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, BinaryIO

from swarmstart.cases.campaign.engine.cell_keys import key_of, recorded_versions
from swarmstart.cases.campaign.engine.wall_limit import declare_cell_process
from swarmstart.cases.record.files import RecordError, to_json, write_text
from swarmstart.errors import SwarmstartError

CPU_INFO = Path("/proc/cpuinfo")
_MODEL = "model name"

MARK = "cell.json"
SCHEMA = 2
SYNCED_S = 0.1
"""Duration above which a cell is synced to the disk [s].

A crash of the machine can lose shorter cells, which are quick to repeat.
"""
MOST_BYTES = 32 * 2**20
"""Largest size of files that a cell sends from another machine [B]."""
PARENT_DIED = 1
"""Value of PR_SET_PDEATHSIG in Linux."""


@cache
def machine() -> dict[str, Any]:
    """Return processor, cores, system and Python, without names of hosts or users.

    Example:
        >>> sorted(machine())
        ['cores', 'processor', 'python', 'system']
    """
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


def load() -> float | None:
    """Return the load average of the last minute; None if the system has none."""
    try:
        return os.getloadavg()[0]
    except (AttributeError, OSError):
        return None


def _processor() -> str:
    """Return the processor's name, or that of its architecture."""
    try:
        lines = CPU_INFO.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    for line in lines:
        name, _, value = line.partition(":")
        if name.strip() == _MODEL and value.strip():
            return " ".join(value.split())
    # The first is empty on some systems.
    return platform.processor() or platform.machine()


@dataclass(frozen=True, kw_only=True, slots=True)
class Beginning:
    """Time and circumstances of a cell's beginning.

    Attributes:
        seconds: Time of the beginning on this process's clock [s].
        cpu_s: CPU seconds of this process until the beginning.
        date: Date and time, ISO 8601, UTC.
        load: Load average; None if the system has none.
    """

    seconds: float = field(default_factory=clock.perf_counter)
    cpu_s: float = field(default_factory=clock.process_time)
    date: str = field(
        default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds")
    )
    load: float | None = field(default_factory=load)


def cell_content(
    order: Mapping[str, Any],
    began: Beginning,
    *,
    result: Mapping[str, Any] | None = None,
    failure: str = "",
    again: bool = False,
    cpu_s: float | None = None,
) -> dict[str, Any]:
    """Return the content of a cell's mark, the file `cell.json`.

    Args:
        order: "work", "job" and "label"; also "spent" if a limit ended an earlier
            attempt.
        began: Beginning of this attempt.
        result: Result of the work; None if it failed.
        failure: Reason of the failure; empty if it did not fail.
        again: Whether the next command tries the cell again.
        cpu_s: CPU seconds of this attempt; None if not known.
    """
    spent = order.get("spent") or {}
    seconds = clock.perf_counter() - began.seconds + spent.get("seconds", 0.0)
    before = spent.get("cpu_s", 0.0)
    loads = (began.load, load())
    return {
        "schema": SCHEMA,
        "label": order["label"],
        "work": order["work"],
        "job": order["job"],
        "failure": failure,
        "again": again,
        "seconds": seconds,
        "result": result,
        "date": spent.get("date", began.date),
        "machine": machine(),
        "load": None if None in loads else loads,
        "cpu_s": None if cpu_s is None or before is None else cpu_s + before,
        "versions": recorded_versions(),
        "was_cut": bool(spent),
    }


def done(order: Mapping[str, Any], folder: Path) -> str:
    """Carry out a cell's work; return the content of its file `cell.json`.

    Errors of any type become text here, so that the other cells continue.
    """
    began = Beginning()
    # Not above: a process for cells is ready before its libraries are loaded.
    from swarmstart.ocp.common import hidden

    result: Mapping[str, Any] | None = None
    failure = ""
    function = order["rescue"] if order.get("spent") else order["work"]
    try:
        work = resolve_name(function)
        # The command shows the progress of all cells.
        with hidden():
            result = dict(work(dict(order["job"]), folder, **order["permissions"]))
    except SwarmstartError as error:
        failure = str(error) or type(error).__name__
    except Exception as error:  # noqa: BLE001 - whatever it is, the others go on
        failure = f"{type(error).__name__}: {error}"
    cpu_s = clock.process_time() - began.cpu_s
    content = cell_content(order, began, result=result, failure=failure, cpu_s=cpu_s)
    try:
        return _text(content)
    except Exception as error:  # noqa: BLE001 - a result that is no plain data
        content["result"] = None
        content["failure"] = f"{type(error).__name__}: {error}"
        return _text(content)


def _text(content: Mapping[str, Any]) -> str:
    """Return JSON in one line; numbers that are not finite become null."""
    try:
        return json.dumps(content, allow_nan=False)
    except (TypeError, ValueError):  # Not a dict, or a number that is not finite.
        return to_json(content)


def commit(folder: Path, text: str, *, seconds: float) -> None:
    """Write the mark of a cell, `cell.json`, after all other files of its folder.

    Args:
        folder: The cell's folder.
        text: Content of the mark, JSON in one line.
        seconds: Duration of the cell [s].

    Raises:
        RecordError: If the mark cannot be written.
    """
    write_text(folder / MARK, text + "\n", sync=seconds >= SYNCED_S)


def serve(parent: int) -> None:
    """Carry out orders until the input ends: the main function of a process for cells.

    Args:
        parent: Number of the process that has started this one.
    """
    orders, replies = _streams()
    _keep_signals_out()
    _die_with(parent)
    declare_cell_process(replies.fileno())
    waiting: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(orders, waiting), daemon=True).start()
    _send(replies, json.dumps({"ready": clock.process_time()}))
    while True:
        reply = _reply(json.loads(waiting.get()))
        # `reply` is JSON already, and can be long: it is not parsed and written again.
        _send(replies, f'{{"cpu": {clock.process_time()}, {reply}}}')


def _streams() -> tuple[BinaryIO, BinaryIO]:
    """Return input and output for orders; other output goes to standard error.

    Native code prints to the descriptors themselves, so these are replaced.
    """
    orders, replies = os.dup(0), os.dup(1)
    # Work that reads its input then finds its end, and no orders.
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    return os.fdopen(orders, "rb"), os.fdopen(replies, "wb")


def _keep_signals_out() -> None:
    """Ignore Ctrl-C and the end of a terminal: the command ends its processes."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
        # A blocked signal is inherited, and a hard limit needs this one.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGALRM})


def _die_with(parent: int) -> None:
    """Make the system end this process together with its parent.

    Native code that blocks the interpreter would not notice the end of its input.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PARENT_DIED, signal.SIGKILL)
        # The parent can have died before that call.
        if os.getppid() != parent:
            os._exit(1)


def _listen(orders: BinaryIO, waiting: queue.SimpleQueue[bytes]) -> None:
    """Read orders; exit when the input ends, also during work."""
    for line in orders:
        waiting.put(line)
    os._exit(1)


def _send(replies: BinaryIO, text: str) -> None:
    try:
        replies.write(text.encode() + b"\n")
        replies.flush()
    except OSError:  # The parent process has ended.
        os._exit(1)


def _reply(order: Mapping[str, Any]) -> str:
    """Return the reply to an order: entries of a JSON object."""
    # The code here can be newer than the command, or another one on a cluster.
    if key_of(order["work"], order["job"]) != order["key"]:
        return f'"refused": {json.dumps(recorded_versions())}'
    with ExitStack() as stack:
        try:
            given = order["folder"]
            if given is None:
                made = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
                folder = Path(stack.enter_context(made))
                return _to_send(done(order, folder), folder)
            folder = Path(given)
            folder.mkdir(parents=True, exist_ok=True)
            began = clock.perf_counter()
            text = done(order, folder)
            commit(folder, text, seconds=clock.perf_counter() - began)
        except (RecordError, OSError) as error:
            return f'"unwritten": {json.dumps(str(error))}'
        return f'"content": {text}'


def _to_send(text: str, folder: Path) -> str:
    """Return a mark's content with the files of its folder, in base 64."""
    # A link can lead out of the folder.
    files = [f for f in sorted(folder.rglob("*")) if f.is_file() and not f.is_symlink()]
    size = sum(file.stat().st_size for file in files)
    if size > MOST_BYTES:
        failure = (
            f"expected a cell to write at most {MOST_BYTES // 2**20} MiB of files to "
            f"be sent, found {size / 2**20:.0f} MiB; do it with the local engine"
        )
        text = _text({**json.loads(text), "result": None, "failure": failure})
        files = []
    contents = {
        file.relative_to(folder).as_posix(): base64.b64encode(file.read_bytes())
        for file in files
    }
    sent = {name: content.decode("ascii") for name, content in contents.items()}
    return f'"content": {text}, "files": {json.dumps(sent)}'
