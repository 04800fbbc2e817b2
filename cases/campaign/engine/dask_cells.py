"""Run cells, the independent units of a campaign, on the workers of a Dask cluster.

The scheduler distributes cells; if a worker dies, its cells go to other workers. The
workers send the results and the files of a cell back as data, so no disk is shared. The
extra `dask` installs the packages.
"""

from __future__ import annotations

import json
import logging
import queue
import time as clock
import uuid
from collections import deque
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from swarmstart.cases.campaign.engine.cell_keys import recorded_versions
from swarmstart.cases.record.files import RecordError
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics.running import put_off

CONNECT_S = 10.0
NO_WORKER_S = 60.0
"""Longest time without workers: those that died need time to restart [s]."""
POLL_S = 0.2
LOOK_S = 2.0
AHEAD = 2
"""Number of cells sent in advance for each thread of the cluster."""
LOST = 5
"""Number of times that a cell is sent again after several workers have died with it."""
CLOSE_S = 5.0

Reply = tuple[str, Mapping[str, Any]]
"""A key, and the reply to its order."""


class DaskError(SwarmstartError):
    """A Dask cluster is missing, was lost, or cannot do these cells."""


def worked_on_dask(
    orders: Sequence[Mapping[str, Any]], address: str
) -> Generator[Reply, None, None]:
    """Yield the key of each order with its reply, as the orders are finished.

    Args:
        orders: Orders of cells, as from `Cell.order` without a folder.
        address: Address of the scheduler, such as "tcp://host:8786".

    Raises:
        DaskError: If Dask is not installed, the scheduler cannot be reached or is lost,
            there are no workers, or a worker has another version of the code.
        RecordError: If a worker cannot write the files of a cell.
    """
    with _quiet(), _connected(address) as client:
        name = f"swarmstart-cells-{uuid.uuid4().hex}"
        try:
            _prepare(client, name, address)
            yield from _Campaign(client, name, address).worked(orders)
        finally:
            with put_off(), suppress(Exception):  # It can have ended already.
                if client.status == "running":
                    client.unregister_worker_plugin(name)


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    try:
        import distributed
    except ImportError as error:
        raise DaskError(
            "the engine dask needs the package distributed, found none: "
            "pip install 'swarmstart[dask]'"
        ) from error
    kind: Any = distributed.Client  # Partly typed.
    # A client without a connection is closed here, too: Dask's own `__del__` would
    # close it at a later time, and the next client could wait for that.
    client = kind.__new__(kind)
    try:
        try:
            client.__init__(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise DaskError(
                f"expected a Dask scheduler at {address}, found none: "
                f"{' '.join(str(error).split())}"
            ) from error
        yield client
    finally:
        with put_off(), suppress(Exception):
            client.close(timeout=CLOSE_S)


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the messages of Dask: errors are reported in one sentence instead."""
    logger = logging.getLogger("distributed")
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(level)


def _prepare(client: Any, name: str, address: str) -> None:
    """Wait for a worker, and make all workers start processes for cells."""
    from distributed import TimeoutError as NoWorkerError

    try:
        client.wait_for_workers(1, timeout=NO_WORKER_S)
    except (NoWorkerError, TimeoutError) as error:
        raise DaskError(_no_workers(address)) from error
    from swarmstart.cases.campaign.engine.dask_worker import CellProcesses

    for attempt in range(LOST + 1):
        try:
            client.register_plugin(CellProcesses(), name=name)
        except Exception as error:  # Any error of a worker.
            # A worker that dies closes its connection: an OSError.
            if isinstance(error, OSError) and attempt < LOST:
                clock.sleep(POLL_S)
                continue
            raise DaskError(
                f"expected the workers of {address} to have this package with its "
                f"extra dask, found {type(error).__name__}: {error}"
            ) from error
        return


class _Campaign:
    """Orders for a cluster, a few sent ahead of the finished ones."""

    def __init__(self, client: Any, name: str, address: str) -> None:
        self._client, self._name, self._address = client, name, address
        self._pending: dict[Any, Mapping[str, Any]] = {}
        self._ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._deaths: dict[str, int] = {}
        self._threads, self._looked = 0, -LOOK_S
        self._last_worker = clock.monotonic()

    def worked(
        self, orders: Sequence[Mapping[str, Any]]
    ) -> Generator[Reply, None, None]:
        """Yield the key of each order with its reply, until every order has one."""
        waiting = deque(orders)
        try:
            while waiting or self._pending:
                self._look()
                while waiting and len(self._pending) < AHEAD * max(1, self._threads):
                    self._hand_out(waiting.popleft())
                for order, future in self._finished():
                    reply = self._reply(order, future)
                    if reply is None:
                        self._hand_out(order)
                    else:
                        yield order["key"], reply
        finally:
            with put_off(), suppress(Exception):
                if self._pending and self._client.status == "running":
                    self._client.cancel([*self._pending])

    def _look(self) -> None:
        """Count the cluster's threads; raise if the cluster is lost."""
        if self._client.status != "running":
            raise DaskError(self._lost())
        if clock.monotonic() - self._looked < LOOK_S:
            return
        try:
            self._threads = sum(self._client.nthreads().values())
        except Exception as error:  # Dask has many types of errors.
            raise DaskError(self._lost()) from error
        self._looked = clock.monotonic()
        if self._threads:
            self._last_worker = self._looked
        elif self._looked - self._last_worker > NO_WORKER_S:
            raise DaskError(_no_workers(self._address))

    def _hand_out(self, order: Mapping[str, Any]) -> None:
        from swarmstart.cases.campaign.engine.dask_worker import done_on_worker

        future = self._client.submit(
            done_on_worker,
            self._name,
            json.dumps(order, allow_nan=False),
            key=f"swarmstart-cell-{order['key']}-{uuid.uuid4().hex}",
            pure=False,
        )
        self._pending[future] = order
        future.add_done_callback(self._ended.put)

    def _finished(self) -> list[tuple[Mapping[str, Any], Any]]:
        """Return orders whose futures have ended; empty after a while."""
        found = []
        with suppress(queue.Empty):
            found.append(self._ended.get(timeout=POLL_S))
            while True:
                found.append(self._ended.get_nowait())
        return [(self._pending.pop(one), one) for one in found if one in self._pending]

    def _reply(self, order: Mapping[str, Any], future: Any) -> dict[str, Any] | None:
        """Return the reply to an order; None if it must be sent again."""
        try:
            reply: dict[str, Any] = json.loads(future.result(timeout=NO_WORKER_S))
        except Exception as error:
            # The client's status can follow after the first call that fails.
            is_closed = type(error).__name__ == "CommClosedError"
            if is_closed or self._client.status != "running":
                raise DaskError(self._lost()) from error
            if type(error).__name__ not in ("KilledWorker", "CancelledError"):
                raise DaskError(
                    f"{order['label']}: expected the workers of {self._address} to do "
                    f"it, found {type(error).__name__}: {error}"
                ) from error
            key = order["key"]
            self._deaths[key] = self._deaths.get(key, 0) + 1
            return _lost_cell(order) if self._deaths[key] > LOST else None
        if "refused" in reply:
            raise DaskError(_other_code(reply["worker"], reply["refused"]))
        if "unwritten" in reply:
            raise RecordError(f"{reply['worker']}: {reply['unwritten']}")
        return reply

    def _lost(self) -> str:
        return (
            f"the Dask scheduler at {self._address} has been lost; what is finished is "
            "kept; the same command again goes on from there"
        )


def _lost_cell(order: Mapping[str, Any]) -> dict[str, Any]:
    """Return the reply for a cell during which several workers died."""
    from swarmstart.cases.campaign.engine.cell_work import Beginning, cell_content

    failure = "every Dask worker that did it died"
    content = cell_content(order, Beginning(), failure=failure, again=True)
    return {"content": content, "is_lost": True}


def _no_workers(address: str) -> str:
    return (
        f"expected the Dask scheduler at {address} to have workers, found none for "
        f"{NO_WORKER_S:g} s"
    )


def _other_code(worker: str, found: Mapping[str, str]) -> str:
    """Return the message on how a worker's code differs."""
    expected = recorded_versions()
    differ = [
        f"{name} {found.get(name, 'none')} instead of {version}"
        for name, version in expected.items()
        if found.get(name) != version
    ]
    what = ", ".join(differ) or "code of this package that has been edited"
    return (
        f"expected the Dask worker {worker} to have the same code as this command, "
        f"found {what}; install the same there, and start its workers again"
    )
