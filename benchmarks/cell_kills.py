"""Campaigns of cells killed at random moments: no finished cell lost, same outcomes.

    python benchmarks/cell_kills.py --moments 30 --seed 0 [--dask] [--full-disk]

A campaign of short cells is started again and again in one folder, with one worker,
with two, with the workers of a Dask cluster, and sent SIGKILL, SIGTERM or SIGINT at a
random moment, or one of its workers is killed before. After each:

- the mark of every cell that had finished is there, the same bytes;
- no process of the campaign is left, and after a signal no file under a temporary name.

When a campaign ends by itself, its outcomes must equal those of an undisturbed one;
then its folder is emptied, and the next begins. With --full-disk (on Linux, if a file
system in memory can be mounted) the disk is full again and again, and is enlarged.
"""

import argparse
import contextlib
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarmstart.benchmarks.kills import (
    Ending,
    ended,
    listens,
    temporary_files,
    waited,
    workers,
)
from swarmstart.cases.campaign.engine.cell_work import MARK
from swarmstart.cases.campaign.engine.cells import LOCAL, Cell, carried_out
from swarmstart.cases.record.files import RecordError

CELLS = 40
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
INTERRUPTED = 130
FULL = 5
STEP = 48 * 2**10
"""Step by which the full disk is enlarged [B]."""


def work(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return numbers that the seed determines, after a while."""
    del folder
    rng = np.random.default_rng(job["seed"])
    time.sleep(float(rng.uniform(0.0, 0.08)))
    return {"numbers": rng.normal(size=200).tolist()}


def cells() -> list[Cell]:
    """Return the cells of the campaign."""
    return [
        Cell(
            work="swarmstart.benchmarks.cell_kills:work",
            job={"seed": seed},
            label=f"seed {seed}",
            timeout_s=60.0,
        )
        for seed in range(CELLS)
    ]


def campaign(folder: Path, count: int, engine: str) -> int:
    """Do the cells as a command does; return the exit code."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        found = carried_out(cells(), folder, workers=count, engine=engine)
    except KeyboardInterrupt:
        return INTERRUPTED
    except RecordError as error:
        print(error, file=sys.stderr)
        return FULL
    for number in SIGNALS[1:]:  # As of a command that is over.
        signal.signal(number, signal.SIG_IGN)
    text = json.dumps([[outcome.result, outcome.failure] for outcome in found])
    print(hashlib.sha256(text.encode()).hexdigest())  # No more than a pipe takes.
    return 0


def started(folder: Path, count: int, engine: str) -> subprocess.Popen[str]:
    """Start a campaign in a process group of its own; return when it listens."""
    process = subprocess.Popen(
        [sys.executable, __file__, "--campaign", str(folder), str(count), engine],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while process.poll() is None and not listens(process.pid):
        time.sleep(1e-3)
    return process


def marks(folder: Path) -> dict[str, bytes]:
    """Return the marks of cells by their folders; one that cannot be read raises."""
    found = {file.parent.name: file.read_bytes() for file in folder.glob(f"*/{MARK}")}
    return {key: text for key, text in found.items() if not json.loads(text)["again"]}


def besieged(
    count: int, engine: str, *, moments: int, chance: random.Random, cluster: int = 0
) -> tuple[Counter[str], list[str]]:
    """Attack a campaign at random moments.

    Args:
        count: Number of local workers.
        engine: Of `carried_out`.
        moments: Number of attacks.
        chance: Source of randomness of moments and signals.
        cluster: Process whose children are workers of Dask, which are killed too; 0 for
            none.

    Returns:
        The number of attacks of each kind, and all complaints.
    """
    happened, wrong = Counter[str](), list[str]()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "cells"
        process, began = started(folder, count, engine), time.monotonic()
        whole = ended(process).out
        seconds = time.monotonic() - began
        shutil.rmtree(folder)
        while happened.total() < moments:
            before, rests = marks(folder), temporary_files(folder)
            process = started(folder, count, engine)
            what = ""
            if waited(process, chance.uniform(0.0, seconds)):
                what = _attack(process, chance, cluster)
            ending = ended(process, what)
            after = marks(folder)
            if any(after.get(key) != text for key, text in before.items()):
                wrong.append(f"{what}: finished cells are lost or changed")
            if ending.code == 0:
                if ending.out != whole:
                    wrong.append("other outcomes than undisturbed")
                wrong += [f"left: {file}" for file in temporary_files(folder)]
                shutil.rmtree(folder)
                continue
            happened[what] += 1
            print(f"{happened.total()}: {what}, {len(after)} kept", file=sys.stderr)
            wrong += _complaints(ending, temporary_files(folder) - rests)
        if ended(started(folder, count, engine)).out != whole:
            wrong.append("other outcomes than undisturbed at the end")
        if len(marks(folder)) != CELLS or temporary_files(folder):
            wrong.append("cells or rests at the end")
    return happened, wrong


def _complaints(ending: Ending, rests: set[Path]) -> list[str]:
    """Return what is wrong after a signal; a kill may leave rests."""
    if ending.sent.startswith("SIGKILL"):
        return []
    wrong = [f"{ending.sent}: left {file}" for file in rests]
    if ending.code != INTERRUPTED or "Traceback" in ending.err:
        wrong.append(f"{ending.sent}: {ending.code} {ending.err[-500:]}")
    return wrong


def _attack(process: subprocess.Popen[str], chance: random.Random, cluster: int) -> str:
    """Send a signal, perhaps after the death of a worker; return what was done."""
    number = chance.choice(SIGNALS)
    what = signal.Signals(number).name
    pids = workers(process.pid) if not cluster else busy_below(cluster)
    if pids and chance.random() < 0.4:
        with contextlib.suppress(ProcessLookupError):
            os.kill(chance.choice(pids), signal.SIGKILL)
        what = f"{what} after SIGKILL of a worker"
        if not waited(process, chance.uniform(0.0, 0.5)):
            return what
    if number == signal.SIGINT and chance.random() < 0.5:
        os.killpg(process.pid, number)  # As a terminal does.
    else:
        process.send_signal(number)
    return what


def children(pid: int) -> list[int]:
    """Return the children of all threads of a process, from /proc."""
    found: list[int] = []
    for file in Path(f"/proc/{pid}/task").glob("*/children"):
        with contextlib.suppress(OSError):
            found += [int(child) for child in file.read_text().split()]
    return found


def busy_below(cluster: int) -> list[int]:
    """Return the workers of Dask that have begun with cells."""
    return [pid for pid in children(cluster) if children(pid)]


@contextlib.contextmanager
def dask_cluster() -> Iterator[tuple[str, int]]:
    """A scheduler with two workers: its address, and the workers' parent."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        file = Path(place) / "scheduler.json"
        options = ("--port", "0", "--no-dashboard", "--scheduler-file", str(file))
        scheduler = _dask("scheduler", *options)
        while not file.exists():
            time.sleep(0.05)
        address = json.loads(file.read_text())["address"]
        threads = ("--nworkers", "2", "--nthreads", "1", "--no-dashboard")
        nannies = _dask("worker", address, *threads, "--local-directory", place)
        try:
            yield address, nannies.pid
        finally:
            for process in (nannies, scheduler):
                process.terminate()
                process.wait()


def _dask(*arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "dask", *arguments],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def full_disk(count: int) -> tuple[Counter[str], list[str]]:
    """Do the campaign on a disk that is full again and again, and made larger."""
    happened, wrong = Counter[str](), list[str]()
    with tempfile.TemporaryDirectory() as place:
        whole = ended(started(Path(place) / "whole", count, LOCAL)).out
        disk, size = Path(place) / "disk", STEP
        disk.mkdir()
        mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(disk)]
        subprocess.run(mount, check=True)
        try:
            while True:
                before = marks(disk / "cells")
                ending = ended(started(disk / "cells", count, LOCAL))
                after = marks(disk / "cells")
                if any(after.get(key) != text for key, text in before.items()):
                    wrong.append("full disk: finished cells are lost or changed")
                if ending.code == 0:
                    break
                if ending.code != FULL or "No space left" not in ending.err:
                    wrong.append(f"full disk: {ending.code} {ending.err[-500:]}")
                if left := temporary_files(disk):
                    wrong.append(f"full disk: {left}")
                happened[f"full disk, {len(after)} of {CELLS} cells kept"] += 1
                size += STEP
                remount = f"remount,size={size}"
                subprocess.run(["mount", "-o", remount, str(disk)], check=True)
            if ending.out != whole:
                wrong.append("full disk: other outcomes than undisturbed")
        finally:
            subprocess.run(["umount", str(disk)], check=True)
    return happened, wrong


def main(arguments: Sequence[str] | None = None) -> int:
    """Attack, and say what was wrong; 3 if anything was."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--moments", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--dask", action="store_true")
    parser.add_argument("--full-disk", action="store_true")
    parser.add_argument("--campaign", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.campaign:
        folder, count, engine = options.campaign
        return campaign(Path(folder), int(count), engine)
    chance, moments = random.Random(options.seed), options.moments
    found = {
        f"{count} workers": besieged(count, LOCAL, moments=moments, chance=chance)
        for count in (1, 2)
    }
    if options.full_disk:
        found["2 workers, full disk"] = full_disk(2)
    if options.dask:
        with dask_cluster() as (address, cluster):
            found["Dask"] = besieged(
                1, address, moments=moments, chance=chance, cluster=cluster
            )
    for name, (happened, wrong) in found.items():
        print(f"{name}: {happened.total()} moments, wrong: {len(wrong)}")
        for what, count in sorted(happened.items()):
            print(f"  {count:3d}  {what}")
        for text in wrong:
            print(f"  wrong: {text}")
    return 3 if any(wrong for _, wrong in found.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
