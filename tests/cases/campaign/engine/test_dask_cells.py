"""Cells on a Dask cluster: same results, also if parts of it are killed."""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from swarmstart.cases.campaign.engine import cells as campaign
from swarmstart.cases.campaign.engine import dask_cells
from swarmstart.cases.campaign.engine.cells import Cell, Outcome, carried_out, finished
from swarmstart.cases.campaign.engine.dask_cells import DaskError
from swarmstart.cases.record.record import versions
from swarmstart.errors import SwarmstartError
from swarmstart.tests.processes import environment

pytest.importorskip("distributed")
WORK = "swarmstart.tests.cases.campaign.campaign_work"
PATIENCE_S = 120.0
pytestmark = [
    pytest.mark.filterwarnings("default"),  # Of Dask and what it uses.
    pytest.mark.skipif(os.name != "posix", reason="kills as POSIX has them"),
]


def cell(work: str, number: int = 0, *, rescue: str = "", **job: float) -> Cell:
    return Cell(
        work=f"{WORK}:{work}",
        job={"number": number, **job},
        label=f"{work} {number}",
        timeout_s=20.0,
        rescue=rescue and f"{WORK}:{rescue}",
    )


@contextmanager
def scheduler(folder: Path) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """A scheduler as a user starts one; its address and its process."""
    file = folder / "scheduler.json"
    process = dask(
        "scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", file
    )
    try:
        deadline = time.monotonic() + PATIENCE_S
        while not (file.exists() and file.stat().st_size):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        yield json.loads(file.read_text())["address"], process
    finally:
        process.kill()
        process.wait()


@contextmanager
def workers(address: str, folder: Path, count: int = 2) -> Iterator[list[int]]:
    """Workers with a nanny, which restarts a killed worker."""
    options = ("--nworkers", str(count), "--nthreads", "1", "--no-dashboard")
    process = dask("worker", address, *options, "--local-directory", folder)
    try:
        yield [process.pid]
    finally:
        process.terminate()
        process.wait()


def dask(*arguments: object) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "dask", *map(str, arguments)],
        env=environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def on_dask(cells: list[Cell], root: Path, address: str) -> list[Outcome]:
    return carried_out(cells, root, workers=1, engine=address)


def test_what_is_missing_is_said_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_cells, "CONNECT_S", 0.3)
    addresses = ("tcp://127.0.0.1:9", "nonsense://x", "127.0.0.1:x", "")
    for address in addresses * 3:  # What is left of one is not to hold up the next.
        with pytest.raises(DaskError, match=r"expected a Dask scheduler at .*, found"):
            on_dask([cell("square", 3)], tmp_path, address)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(DaskError, match=r"pip install 'swarmstart\[dask\]'"):
        on_dask([cell("square", 3)], tmp_path, "tcp://127.0.0.1:9")


def test_a_cluster_gives_what_this_machine_gives(tmp_path: Path) -> None:
    cells = [
        cell("square", 3),
        cell("figure"),
        cell("refuse", 3),
        cell("die"),
        cell("spin", 1, limit=0.2, rescue="square"),
        cell("large"),
        cell("square", 5),
    ]
    here = carried_out(cells[:5], tmp_path / "here", workers=2)
    with scheduler(tmp_path) as (address, _), workers(address, tmp_path):
        there = on_dask(cells, tmp_path / "there", address)
    assert [(o.result, o.failure) for o in there[:5]] == [
        (o.result, o.failure) for o in here
    ]
    assert there[4].was_cut and there[4].machine == here[4].machine
    assert "at most 32 MiB of files" in there[5].failure
    assert there[6].result == {"square": 25}
    sent = tmp_path / "there" / cells[1].key / "figures" / "one.png"
    assert sent.read_bytes() == b"\x89PNG"
    assert [finished(one, tmp_path / "there") for one in cells[:3]] == there[:3]


def test_no_file_is_written_outside_of_its_cell(tmp_path: Path) -> None:
    with pytest.raises(SwarmstartError, match="a file within its cell"):
        campaign._write_sent(tmp_path / "cell", "../outside", b"")
    assert not (tmp_path / "outside").exists()


def children(pid: int) -> list[int]:
    """Return the children of all threads of a process."""
    found: list[int] = []
    for file in Path(f"/proc/{pid}/task").glob("*/children"):
        with contextlib.suppress(OSError):
            found += [int(child) for child in file.read_text().split()]
    return found


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_workers_that_are_killed_lose_no_cell(tmp_path: Path) -> None:
    cells = [cell("square", number, seconds=0.1) for number in range(40)]
    chance, killed = random.Random(0), list[int]()

    def kill(done: int, *_: object) -> None:
        """Kill a worker that is doing a cell: one that only starts is not replaced."""
        busy = [pid for pid in children(command) if children(pid)]
        if done in (3, 12, 24, 33) and busy:
            killed.append(chance.choice(busy))
            os.kill(killed[-1], signal.SIGKILL)

    with scheduler(tmp_path) as (address, _), workers(address, tmp_path) as (command,):
        root = tmp_path / "cells"
        found = carried_out(cells, root, workers=1, told=kill, engine=address)
    assert [o.result for o in found] == [{"square": n**2} for n in range(40)]
    assert len(killed) >= 2


def test_a_lost_scheduler_and_ctrl_c_keep_what_is_finished(tmp_path: Path) -> None:
    cells = [cell("square", number, seconds=0.1) for number in range(40)]
    root = tmp_path / "cells"

    def kept() -> int:
        return sum(finished(one, root) is not None for one in cells)

    def interrupt(done: int, *_: object) -> None:
        if done == 3:
            raise KeyboardInterrupt

    def lose(done: int, *_: object) -> None:
        if done == 6:
            process.kill()

    with scheduler(tmp_path) as (address, process), workers(address, tmp_path):
        with pytest.raises(
            KeyboardInterrupt, match=r"3 of 40 runs are kept .* again goes on"
        ):
            carried_out(cells, root, workers=1, told=interrupt, engine=address)
        assert kept() == 3
        with pytest.raises(
            DaskError, match="is finished is kept; the same command again"
        ):
            carried_out(cells, root, workers=1, told=lose, engine=address)
        assert 6 <= kept() < 40
    assert [o.result for o in carried_out(cells[:8], root, workers=2)] == [
        {"square": n**2} for n in range(8)
    ]


def test_workers_with_other_code_are_refused(tmp_path: Path) -> None:
    class Edited(Cell):
        @property
        def key(self) -> str:
            return "0123456789abcdef"

    one = Edited(work=f"{WORK}:square", job={"number": 3}, label="edited")
    with scheduler(tmp_path) as (address, _), workers(address, tmp_path, 1):
        with pytest.raises(DaskError, match="to have the same code as this command"):
            on_dask([one], tmp_path / "cells", address)
    assert dask_cells._other_code("w", {}).count("instead of") == len(versions())
