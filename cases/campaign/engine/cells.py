"""Many independent cells of work in worker processes, each finished once and kept.

A cell is a piece of work that a few plain data determine: their hash is its key and the
name of its folder, whose `cell.json` is written last and is the commit mark. So a
campaign that was interrupted or killed goes on from what is there at the next call.

Each worker is a process with one BLAS thread, kept from cell to cell, and with what it
has built. One that dies costs only its own cell, which is tried once more. A cell that
fails is recorded with the reason, and the others are kept; where its process died or it
took too long, the next campaign tries it again. When the command itself is killed, its
workers end with it.

The workers are of this machine, or of a cluster of Dask (`dask_cells.py`), which sends
results back; the marks are written here either way.
"""

from __future__ import annotations

import base64
import json
import queue
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swarmstart.cases.campaign.engine.cell_keys import key_of
from swarmstart.cases.campaign.engine.cell_process import (
    CellProcess,
    OtherCodeError,
    StoppedError,
)
from swarmstart.cases.campaign.engine.cell_work import MARK, SCHEMA, commit
from swarmstart.cases.record.files import (
    locked,
    remove_rests,
    to_json,
    write_atomically,
)
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics.interrupts import heeded, put_off

LOCAL = "local"
POLL_S = 0.2

Done = Callable[[int, int, str], None]
"""(finished cells, all cells, what has finished) -> None."""


class CodeChangedError(SwarmstartError):
    """The code of this package has been edited while a campaign runs it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Cell:
    """A piece of work.

    Attributes:
        work: "module:function" of what does it: (job, folder) -> a mapping to keep.
            The function writes what else it makes into the folder.
        job: Plain data that determine the result, with the versions of the packages
            and the code that they use.
        label: What it is, for progress and errors.
        timeout_s: After how many seconds it is given up; None: never.
        permissions: Further arguments of the work: what the command at hand allows,
            which changes no result, is in no key, and is not kept.
        rescue: "module:function" of what is done in its place where a hard limit
            (`wall_limit.py`) has ended the work; empty: the cell has failed then.
    """

    work: str
    job: Mapping[str, Any]
    label: str
    timeout_s: float | None = None
    permissions: Mapping[str, Any] = field(default_factory=dict)
    rescue: str = ""

    @property
    def key(self) -> str:
        """The 16 characters that name the cell; see `cell_keys.py`."""
        return key_of(self.work, self.job)

    def order(self, key: str, folder: Path | None) -> dict[str, Any]:
        """Return what a process of cells is told.

        Args:
            key: The cell's key.
            folder: Its folder; None where the process is to send all back.
        """
        return {
            "work": self.work,
            "job": dict(self.job),
            "label": self.label,
            "timeout_s": self.timeout_s,
            "permissions": dict(self.permissions),
            "rescue": self.rescue,
            "key": key,
            "folder": None if folder is None else str(folder),
        }


@dataclass(frozen=True, kw_only=True, slots=True)
class Outcome:
    """Result of a cell.

    Attributes:
        result: What the work returned; None where it failed.
        failure: Why it failed, in a sentence; empty where it did not.
        seconds: Wall time in the worker [s].
        folder: Its folder.
        date: When it began, ISO 8601, UTC; empty: not known.
        machine: "processor", "cores", "system" and "python"; empty: not known.
        load: Load average of one minute at its beginning and end; None where the
            system has none.
        cpu_s: CPU seconds of the worker; None: not known.
        versions: Of the packages that matter.
        was_cut: Whether a hard limit ended the work, and this is of its rescue.
    """

    result: Mapping[str, Any] | None
    failure: str
    seconds: float
    folder: Path
    date: str = ""
    machine: Mapping[str, Any] = field(default_factory=dict)
    load: tuple[float, float] | None = None
    cpu_s: float | None = None
    versions: Mapping[str, str] = field(default_factory=dict)
    was_cut: bool = False


def finished(cell: Cell, root: Path) -> Outcome | None:
    """Return what came of a cell before, or None.

    Args:
        cell: The cell.
        root: The folder of all cells.

    Returns:
        None where it has not finished, it may do better another time, or its mark
        cannot be read.
    """
    return _finished(root / cell.key)


def _finished(folder: Path) -> Outcome | None:
    try:
        kept = json.loads((folder / MARK).read_text(encoding="utf-8"))
        return None if kept["again"] else _outcome(kept, folder)
    except (OSError, ValueError, LookupError, TypeError):
        return None


def _outcome(content: Mapping[str, Any], folder: Path) -> Outcome:
    """Return what a mark says.

    Raises:
        LookupError, TypeError, ValueError: If it is no mark of this version.
    """
    if content["schema"] != SCHEMA:
        raise ValueError(content["schema"])
    load, result = content["load"], content["result"]
    return Outcome(
        result=None if result is None else dict(result),
        failure=str(content["failure"]),
        seconds=float(content["seconds"]),
        folder=folder,
        date=str(content["date"]),
        machine=dict(content["machine"]),
        load=None if load is None else (float(load[0]), float(load[1])),
        cpu_s=content["cpu_s"],
        versions=dict(content["versions"]),
        was_cut=bool(content["was_cut"]),
    )


def carried_out(
    cells: Sequence[Cell],
    root: Path,
    *,
    workers: int,
    told: Done = lambda *_: None,
    engine: str = LOCAL,
) -> list[Outcome]:
    """Return what came of every cell; those that have not finished are done now.

    Args:
        cells: The cells, done in this order; equal ones are done once.
        root: The folder of all cells; made where it is missing.
        workers: Number of worker processes of this machine.
        told: Called after each cell.
        engine: LOCAL, or the address of a scheduler of Dask, whose workers do the
            cells instead.

    Raises:
        FolderInUseError: If another command works there.
        RecordError: If nothing can be written to the folder.
        CodeChangedError: If the code was edited meanwhile.
        DaskError: If the cluster is not there, is lost, or has other code.
        KeyboardInterrupt: On Ctrl-C, saying what is kept.
    """
    keys = [cell.key for cell in cells]
    distinct = dict(zip(keys, cells, strict=True))
    with locked(root):
        outcomes = {key: _finished(root / key) for key in distinct}
        missing = {key: distinct[key] for key, one in outcomes.items() if one is None}
        _remove_rests(root, missing)
        count = len(distinct) - len(missing)
        told(count, len(distinct), "kept from before")
        try:
            worked = _worked(missing, root, workers, engine)
            with heeded(), closing(worked):
                for key, reply in worked:
                    outcomes[key] = _received(reply, root / key)
                    count += 1
                    told(count, len(distinct), distinct[key].label)
        except KeyboardInterrupt:
            _remove_rests(root, missing)
            kept = sum(_finished(root / key) is not None for key in distinct)
            raise KeyboardInterrupt(
                f"{kept} of {len(distinct)} runs are kept in {root}; the same command "
                "goes on from there"
            ) from None
    found = [outcomes[key] for key in keys]
    return [outcome for outcome in found if outcome is not None]


def _remove_rests(root: Path, keys: Mapping[str, Cell]) -> None:
    """Remove what killed workers left in the folders of cells that are to be done."""
    for key in keys:
        remove_rests(root / key)


def _worked(
    cells: Mapping[str, Cell], root: Path, workers: int, engine: str
) -> Generator[tuple[str, Mapping[str, Any]], None, None]:
    """Yield keys with the replies to their orders, as they finish."""
    if not cells:
        return
    if engine == LOCAL:
        orders = [cell.order(key, root / key) for key, cell in cells.items()]
        yield from _worked_here(orders, workers)
        return
    from swarmstart.cases.campaign.engine.dask_cells import worked_on_dask

    orders = [cell.order(key, None) for key, cell in cells.items()]
    yield from worked_on_dask(orders, engine)


def _worked_here(
    orders: Sequence[Mapping[str, Any]], workers: int
) -> Generator[tuple[str, Mapping[str, Any]], None, None]:
    """Yield keys with replies of processes of this machine, a thread for each."""
    waiting = deque(orders)
    replies: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()
    processes = [CellProcess() for _ in range(max(1, min(workers, len(orders))))]
    threads = [
        threading.Thread(target=_work, args=(process, waiting, replies), daemon=True)
        for process in processes
    ]
    try:
        with put_off(), _kept_from_threads():
            for thread in threads:
                thread.start()
        for _ in orders:
            key, reply = _next(replies)
            if isinstance(reply, OtherCodeError):
                raise CodeChangedError(
                    "the code of this package has been edited since the command began; "
                    "start it again, and what is finished of the same code is kept"
                )
            if isinstance(reply, BaseException):
                raise reply
            yield key, reply
    finally:
        with put_off():
            waiting.clear()
            for process in processes:
                process.stop()
            for thread in threads:
                if thread.ident is not None:
                    thread.join()


def _next(replies: queue.SimpleQueue[tuple[str, Any]]) -> tuple[str, Any]:
    while True:  # Signals are handled in between.
        with suppress(queue.Empty):
            return replies.get(timeout=POLL_S)


def _work(
    process: CellProcess,
    waiting: deque[Mapping[str, Any]],
    replies: queue.SimpleQueue[tuple[str, Any]],
) -> None:
    """Have a process do orders until there are none; a thread of the command."""
    while True:
        try:
            order = waiting.popleft()
        except IndexError:
            return
        try:
            replies.put((order["key"], process.done(order)))
        except StoppedError:
            return
        except BaseException as error:  # noqa: BLE001 - raised in the main thread
            replies.put((order["key"], error))
            return


@contextmanager
def _kept_from_threads() -> Iterator[None]:
    """Start threads, and processes of theirs, that Ctrl-C and a terminal do not reach.

    A terminal sends both to all processes of a command; the command itself ends its
    workers then.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    kept = {signal.SIGINT, signal.SIGHUP}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, kept)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _received(reply: Mapping[str, Any], folder: Path) -> Outcome:
    """Return a cell's outcome; what its process has not written is written here."""
    content = reply["content"]
    if reply.get("is_lost"):
        before = _finished(folder)
        if before is not None:  # It had ended well before its process died.
            return before
    if reply.get("is_lost") or "files" in reply:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in reply.get("files", {}).items():
            _write_sent(folder, name, base64.b64decode(text))
        commit(folder, to_json(content), seconds=content["seconds"])
    return _outcome(content, folder)


def _write_sent(folder: Path, name: str, content: bytes) -> None:
    """Write a file that a worker has sent; never outside of the cell's folder."""
    file = folder / name
    if not file.resolve().is_relative_to(folder.resolve()):
        raise SwarmstartError(f"expected a file within its cell, found {name!r}")
    write_atomically(file, lambda opened: opened.write(content))
