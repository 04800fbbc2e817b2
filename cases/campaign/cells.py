"""Many independent cells of work in worker processes, each finished once and kept.

A cell is a piece of work that a few plain data determine: their hash is its key and the
name of its folder, whose `cell.json` is written last and is the commit mark. So a
campaign that was interrupted or killed goes on from what is there at the next call.

Workers are spawned, not forked (a fork of a process that has used BLAS can hang), with
one BLAS thread each. One that dies costs only its own cell, which is tried once more. A
cell that fails is recorded with the reason, and the others are kept; where its process
died or it took too long, the next campaign tries it again. When the command itself is
killed, its workers notice that their parent is gone, and go too.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import signal
import threading
import time as clock
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from multiprocessing import resource_tracker
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from swarmstart.cases.record.files import locked, remove_rests, write_json
from swarmstart.cases.record.record import environment
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics.interrupts import heeded, put_off

MARK = "cell.json"
ATTEMPTS, POOLS = 2, 3
BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
POLL_S = 0.2

Done = Callable[[int, int, str], None]
"""(finished cells, all cells, what has finished) -> None."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Cell:
    """A piece of work.

    Attributes:
        work: "module:function" of what does it: (job, folder) -> a mapping to keep.
            The function writes what else it makes into the folder.
        job: Plain data that determine the result, with the versions of the packages.
        label: What it is, for progress and errors.
        timeout_s: After how many seconds it is given up; None: never.
        permissions: Further arguments of the work: what the command at hand allows,
            which changes no result, is in no key, and is not kept.
    """

    work: str
    job: Mapping[str, Any]
    label: str
    timeout_s: float | None = None
    permissions: Mapping[str, Any] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """The 16 characters that name the cell."""
        determines = {"work": self.work, "job": self.job, **environment()}
        text = json.dumps(
            determines, sort_keys=True, separators=(",", ":"), allow_nan=False
        )
        return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True, kw_only=True, slots=True)
class Outcome:
    """Result of a cell.

    Attributes:
        result: What the work returned; None where it failed.
        failure: Why it failed, in a sentence; empty where it did not.
        seconds: Wall time in the worker [s].
        folder: Its folder.
    """

    result: Mapping[str, Any] | None
    failure: str
    seconds: float
    folder: Path


def finished(cell: Cell, root: Path) -> Outcome | None:
    """Return what came of a cell before, or None.

    Args:
        cell: The cell.
        root: The folder of all cells.

    Returns:
        None where it has not finished, it may do better another time, or its mark
        cannot be read.
    """
    found = _read(root / cell.key)
    return None if found is None or found[1] else found[0]


def _read(folder: Path) -> tuple[Outcome, bool] | None:
    """Return what a folder's mark says, and whether to try again; None without one."""
    try:
        kept = json.loads((folder / MARK).read_text(encoding="utf-8"))
        outcome = Outcome(
            result=kept["result"],
            failure=kept["failure"],
            seconds=kept["seconds"],
            folder=folder,
        )
        return outcome, bool(kept["again"])
    except (OSError, ValueError, LookupError, TypeError):
        return None


def carried_out(
    cells: Sequence[Cell], root: Path, *, workers: int, told: Done = lambda *_: None
) -> list[Outcome]:
    """Return what came of every cell; those that have not finished are done now.

    Args:
        cells: The cells; equal ones are done once.
        root: The folder of all cells; made where it is missing.
        workers: Number of worker processes.
        told: Called after each cell.

    Raises:
        FolderInUseError: If another command works there.
        RecordError: If nothing can be written to the folder.
        KeyboardInterrupt: On Ctrl-C, saying what is kept.
    """
    distinct = {cell.key: cell for cell in cells}
    with locked(root):
        outcomes = {key: finished(cell, root) for key, cell in distinct.items()}
        missing = [cell for key, cell in distinct.items() if outcomes[key] is None]
        _remove_rests(root)
        told(len(distinct) - len(missing), len(distinct), "kept from before")
        try:
            with heeded(), closing(_worked(missing, root, workers)) as worked:
                for cell, outcome in worked:
                    outcomes[cell.key] = outcome
                    count = sum(outcome is not None for outcome in outcomes.values())
                    told(count, len(distinct), cell.label)
        except KeyboardInterrupt:
            _remove_rests(root)
            kept = sum(finished(cell, root) is not None for cell in distinct.values())
            raise KeyboardInterrupt(
                f"{kept} of {len(distinct)} runs are kept in {root}; the same command "
                "goes on from there"
            ) from None
    found = [outcomes[cell.key] for cell in cells]
    return [outcome for outcome in found if outcome is not None]


def _remove_rests(root: Path) -> None:
    """Remove what workers that were killed left in the cells' folders."""
    for folder in root.iterdir():
        remove_rests(folder)


def _worked(
    cells: Sequence[Cell], root: Path, workers: int
) -> Generator[tuple[Cell, Outcome], None, None]:
    """Yield each cell with its outcome, as they finish."""
    left = list(cells)
    for _ in range(POOLS):
        left = yield from _worked_in_pool(left, root, workers)
    for cell in left:
        yield cell, _outcome(cell, root, "its process died, and others with it")


def _worked_in_pool(
    cells: Sequence[Cell], root: Path, workers: int
) -> Generator[tuple[Cell, Outcome], None, list[Cell]]:
    """Yield cells with their outcomes; return those left when a pool breaks.

    A pool breaks if a worker dies at the wrong moment; then all of its cells end.
    """
    left: list[Cell] = []
    if not cells:
        return left
    with _pool(min(workers, len(cells))) as pool:
        with put_off(), _kept_from_workers():  # Half a pool cannot be stopped.
            pending = {_scheduled(pool, cell, root): (cell, 1) for cell in cells}
        while pending:
            done, _ = wait(pending, timeout=POLL_S, return_when=FIRST_COMPLETED)
            for future in done:
                cell, attempt = pending.pop(future)
                if isinstance(future.exception(), BrokenProcessPool):
                    left.append(cell)
                elif attempt < ATTEMPTS and _is_death(future):
                    try:
                        pending[_scheduled(pool, cell, root)] = (cell, attempt + 1)
                    except RuntimeError:  # The pool has broken meanwhile.
                        left.append(cell)
                else:
                    yield cell, _outcome(cell, root, _failure(future))
    return left


@contextmanager
def _pool(workers: int) -> Iterator[Any]:
    """Make a pool whose processes have one BLAS thread each; they end with it."""
    from pebble import ProcessPool

    before = {name: os.environ.get(name) for name in BLAS_THREADS}
    os.environ.update(dict.fromkeys(BLAS_THREADS, "1"))  # Read when NumPy is imported.
    pool = ProcessPool(
        max_workers=workers,
        context=multiprocessing.get_context("spawn"),
        initializer=_follow_parent,
    )
    try:
        yield pool
    finally:
        with put_off():
            pool.stop()  # type: ignore[no-untyped-call]
            pool.join()
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


@contextmanager
def _kept_from_workers() -> Iterator[None]:
    """Start processes and threads that Ctrl-C and the end of a terminal do not reach.

    A terminal sends both to all processes of a command; the command itself ends its
    workers then.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    kept = {signal.SIGINT, signal.SIGHUP}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, kept)
    try:
        # Multiprocessing's own helper: when it starts, it lets SIGINT in again.
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, kept)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _scheduled(pool: Any, cell: Cell, root: Path) -> Future[None]:
    scheduled: Future[None] = pool.schedule(
        work_on, args=(cell, root / cell.key), timeout=cell.timeout_s
    )
    return scheduled


def _is_death(future: Future[None]) -> bool:
    """Return whether the worker died, which need not be the cell's fault."""
    from pebble import ProcessExpired

    return isinstance(future.exception(), ProcessExpired)


def _failure(future: Future[None]) -> str:
    """Return how a cell came to an end of its own kind; empty where it did not."""
    error = future.exception()
    if error is None:
        return ""
    if isinstance(error, TimeoutError):
        return "it took longer than its time"
    return f"its process died: {error}"


def _outcome(cell: Cell, root: Path, failure: str) -> Outcome:
    """Return a finished cell's outcome; that of one without an end is recorded here."""
    folder = root / cell.key
    if failure and finished(cell, root) is None:  # It may have ended all the same.
        _commit(cell, folder, failure=failure, again=True)
    found = _read(folder)
    if found is None:
        raise SwarmstartError(f"{cell.label}: expected its result in {folder}")
    return found[0]


def work_on(cell: Cell, folder: Path) -> None:
    """Do a cell's work and commit its result, or why it failed; in a worker.

    Errors end here, as text: not every one of them can be sent to another process.
    """
    began = clock.perf_counter()
    folder.mkdir(parents=True, exist_ok=True)
    result, failure = None, ""
    try:
        result = resolve_name(cell.work)(dict(cell.job), folder, **cell.permissions)
    except SwarmstartError as error:
        failure = str(error)
    except Exception as error:  # noqa: BLE001 - whatever it is, the others go on
        failure = f"{type(error).__name__}: {error}"
    seconds = clock.perf_counter() - began
    _commit(cell, folder, result=result, failure=failure, seconds=seconds)


def _commit(
    cell: Cell,
    folder: Path,
    *,
    result: Mapping[str, Any] | None = None,
    failure: str = "",
    seconds: float = 0.0,
    again: bool = False,
) -> None:
    content = {
        "schema": 1,
        "label": cell.label,
        "work": cell.work,
        "job": dict(cell.job),
        "failure": failure,
        "again": again,
        "seconds": seconds,
        "result": result,
    }
    write_json(folder / MARK, content)


def _follow_parent() -> None:
    """Leave when the parent does: run in every worker before its first cell."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
