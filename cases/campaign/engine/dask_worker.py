"""Plugin of a Dask worker for cells: it keeps processes and sends orders to them.

A cell that crashes ends its own process, but not the worker. A worker's process can be
daemonic, and then has no children of `multiprocessing`. Orders and replies are JSON.
"""

from __future__ import annotations

import json
import threading
import time as clock
from typing import Any

from distributed import Reschedule, Worker, WorkerPlugin, get_worker

from swarmstart.cases.campaign.engine.cell_process import (
    CellProcess,
    OtherCodeError,
    StoppedError,
)
from swarmstart.cases.record.files import RecordError

IDLE_S = 60.0
"""Time after which an idle process ends, since the command can have been killed [s]."""
LOOK_S = 5.0


class CellProcesses(WorkerPlugin):
    """Processes of a worker for the cells of one command; one for each thread."""

    def setup(self, worker: Worker) -> None:
        """Start without processes; called by Dask on the worker."""
        del worker
        self._free: list[tuple[float, CellProcess]] = []
        self._all: set[CellProcess] = set()
        self._lock = threading.Lock()
        self._is_over = threading.Event()
        threading.Thread(target=self._end_idle, daemon=True).start()

    def teardown(self, worker: Worker) -> None:
        """End all processes; called by Dask on the worker."""
        del worker
        self._is_over.set()
        with self._lock:
            processes, self._free = [*self._all], []
        for process in processes:
            process.stop()

    def done(self, order: dict[str, Any]) -> dict[str, Any]:
        """Return the reply of a cell; see `CellProcess.done`."""
        with self._lock:
            process = self._free.pop()[1] if self._free else CellProcess()
            self._all.add(process)
        # Asked after adding: either `teardown` stops the process, or nothing starts it.
        if self._is_over.is_set():
            raise StoppedError
        try:
            return process.done(order)
        finally:
            with self._lock:
                self._free.append((clock.monotonic(), process))

    def _end_idle(self) -> None:
        while not self._is_over.wait(LOOK_S):
            last = clock.monotonic() - IDLE_S
            with self._lock:
                idle = [process for since, process in self._free if since < last]
                self._free = [one for one in self._free if one[0] >= last]
                self._all.difference_update(idle)
            for process in idle:
                process.stop()


def done_on_worker(plugin: str, order: str) -> str:
    """Return the reply of a cell done on this worker of Dask; called there.

    Args:
        plugin: Name of the worker's `CellProcesses`.
        order: The cell, as JSON.

    Returns:
        The reply as JSON: that of `CellProcess.done`, or "refused" with the worker's
        versions, or "unwritten" with the reason; and "worker", its address.
    """
    worker = get_worker()
    processes = worker.plugins.get(plugin)
    if not isinstance(processes, CellProcesses):  # The worker has just joined.
        raise Reschedule
    try:
        reply = processes.done(json.loads(order))
    except StoppedError:
        # The worker is closing: another one does the cell.
        raise Reschedule from None
    except OtherCodeError as error:
        reply = {"refused": error.versions}
    except RecordError as error:
        reply = {"unwritten": str(error)}
    return json.dumps({**reply, "worker": worker.address}, allow_nan=False)
