"""Many independent cells of work in worker processes; each result is computed once.

A cell is a piece of work that a few plain data determine: their hash is its key and the
name of its folder. The file `cell.json` in it is written last and marks a complete
cell. So the next call continues a campaign that was interrupted or killed.

Each worker is a process with one BLAS thread. It does one cell after another, and keeps
the functions that it has built. If a worker dies, only its own cell is lost, and is
tried once more. A failed cell is recorded with the reason, and the other cells are
kept. If a cell failed because its process died, or because it took too long, the next
campaign tries it again. Workers end together with the command.

Workers run on this machine, or on a cluster of Dask (`dask_cells.py`), which sends
results back. The marks are written here in both cases.
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
from swarmstart.heuristics.running import heeded, put_off

LOCAL = "local"
POLL_S = 0.2

Done = Callable[[int, int, str], None]
"""(finished cells, all cells, label of the finished one) -> None."""


class CodeChangedError(SwarmstartError):
    """The code of this package was edited during a campaign."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Cell:
    """A piece of work.

    Attributes:
        work: "module:function" that does the work: (job, folder) -> a mapping, the
            result. The function can write further files into the folder.
        job: Plain data that determine the result, with the versions of the packages
            and the code that they use.
        label: Description for progress and errors.
        timeout_s: Time limit [s]; None means no limit.
        permissions: Further arguments of the work: permissions of the current command.
            They change no result, are in no key, and are not kept.
        rescue: "module:function" that is called instead if a hard limit
            (`wall_limit.py`) has ended the work; if it is empty, the cell then counts
            as failed.
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
        """Return the order for a process of cells.

        Args:
            key: The cell's key.
            folder: Folder of the cell; None if the process sends everything back.
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
        result: Result of the work; None if it failed.
        failure: Reason of the failure, in a sentence; empty if it did not fail.
        seconds: Wall time in the worker [s].
        folder: Folder of the cell.
        date: Date and time of the beginning, ISO 8601, UTC; empty if not known.
        machine: "processor", "cores", "system" and "python"; empty if not known.
        load: Load average of the machine over one minute, at the beginning and at the
            end of the cell; None if the system has none.
        cpu_s: CPU seconds of the worker; None if not known.
        versions: Versions of packages.
        was_cut: Whether a hard limit ended the work, and this is the result of its
            rescue.
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
    """Return the outcome of a cell that has finished before, or None.

    Returns:
        None if the cell has not finished, if another attempt can succeed, or if its
        mark cannot be read.
    """
    return _finished(root / cell.key)


def _finished(folder: Path) -> Outcome | None:
    try:
        kept = json.loads((folder / MARK).read_text(encoding="utf-8"))
        return None if kept["again"] else _outcome(kept, folder)
    # A mark that is missing, cut or of another version: the cell is done again.
    except (OSError, ValueError, LookupError, TypeError):
        return None


def _outcome(content: Mapping[str, Any], folder: Path) -> Outcome:
    """Return the outcome that a mark contains.

    Raises:
        LookupError, TypeError, ValueError: If it is not a mark of this version.
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
    """Return the outcomes of cells, which are independent pieces of work (`Cell`).

    A cell is done now if `root` has no outcome of it yet, or if it has failed and
    another attempt may succeed.

    Args:
        cells: The cells, done in this order; equal ones are done once.
        root: The folder of all cells; made if it is missing.
        workers: Number of worker processes of this machine.
        told: Function that is called at the beginning and after each cell, with the
            number of finished cells, the number of all, and the label of the cell.
        engine: LOCAL, or the address of a scheduler of Dask, whose workers do the cells
            instead.

    Raises:
        FolderInUseError: If another command uses the folder.
        RecordError: If the folder cannot be written to.
        CodeChangedError: If the code was edited while cells were done.
        DaskError: If the cluster cannot be reached, is lost, or has other code.
        KeyboardInterrupt: On Ctrl-C; the message has the number of finished cells.
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
            # Closing it stops its processes, also if an error occurs in this loop.
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
                "again goes on from there"
            ) from None
    found = [outcomes[key] for key in keys]
    return [outcome for outcome in found if outcome is not None]


def _remove_rests(root: Path, keys: Mapping[str, Cell]) -> None:
    """Remove the files of killed workers from the folders of cells to be done."""
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
            # No thread takes a further order, and `stop` ends the present one.
            waiting.clear()
            for process in processes:
                process.stop()
            for thread in threads:
                # A thread that could not be started cannot be joined.
                if thread.ident is not None:
                    thread.join()


def _next(replies: queue.SimpleQueue[tuple[str, Any]]) -> tuple[str, Any]:
    while True:  # Signals are handled between two calls.
        with suppress(queue.Empty):
            return replies.get(timeout=POLL_S)


def _work(
    process: CellProcess,
    waiting: deque[Mapping[str, Any]],
    replies: queue.SimpleQueue[tuple[str, Any]],
) -> None:
    """Send orders to a process until there are none; the main function of a thread."""
    while True:
        try:
            # Atomic: no two threads take the same order.
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
    """Start threads and their processes, protected from signals of the terminal.

    A terminal sends Ctrl-C and its own end to all processes of a command; the command
    itself ends its workers then.
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
    """Return a cell's outcome; write files that its process has not written."""
    content = reply["content"]
    if reply.get("is_lost"):
        before = _finished(folder)
        if before is not None:  # The cell was complete before its process died.
            return before
    # A dead or a remote process has not written here.
    if reply.get("is_lost") or "files" in reply:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in reply.get("files", {}).items():
            _write_sent(folder, name, base64.b64decode(text))
        commit(folder, to_json(content), seconds=content["seconds"])
    return _outcome(content, folder)


def _write_sent(folder: Path, name: str, content: bytes) -> None:
    """Write a file that a worker has sent, inside the cell's folder only."""
    file = folder / name
    if not file.resolve().is_relative_to(folder.resolve()):
        raise SwarmstartError(f"expected a file within its cell, found {name!r}")
    write_atomically(file, lambda opened: opened.write(content))
