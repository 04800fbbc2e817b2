"""Work for cells of tests: imported by name in worker processes."""

from __future__ import annotations

import collections
import itertools
import math
import os
import signal
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from swarmstart.cases.campaign.engine.cell_work import Beginning, cell_content, commit
from swarmstart.cases.campaign.engine.wall_limit import hard_limit
from swarmstart.cases.record.files import to_json
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics import Budget
from swarmstart.machine_code.clocks import compiling


def square(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Write a mark and return the square."""
    with (folder / "done").open("a") as file:
        file.write(f"{os.getpid()}\n")
    time.sleep(job.get("seconds", 0.0))
    return {"square": job["number"] ** 2}


def refuse(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    raise SwarmstartError(f"expected an even number, found {job['number']}")


def refuse_budget(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    Budget(evaluations=0)
    return {}


def break_off(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    raise ZeroDivisionError("by nothing")


def die(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    os._exit(9)


def square_and_die(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Commit the square, as the worker does, and die before the reply."""
    order = {"work": f"{__name__}:square_and_die", "job": dict(job), "label": "dies"}
    content = cell_content(order, Beginning(), result=square(job, folder))
    commit(folder, to_json(content), seconds=1.0)
    os._exit(9)


def die_once(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Die in the first call only."""
    mark = folder / "died"
    if not mark.exists():
        mark.touch()
        os._exit(9)
    return {"square": job["number"] ** 2}


def hang(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    time.sleep(600)
    return {}


def threads(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    return {"threads": os.environ.get("OPENBLAS_NUM_THREADS")}


def nothing(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    return {}


def spin(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Loop in native code that never returns to Python, under a hard limit."""
    with (folder / "done").open("a") as file:
        file.write(f"{os.getpid()}\n")
    with hard_limit(job.get("limit")):
        collections.deque(itertools.repeat(0), maxlen=0)
    return {}


def rescue(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    return {"rescued": job["number"], "limits": os.environ["SWARMSTART_CELL_PROCESS"]}


def within_limit(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return the time that nested limits leave, after an end in time."""
    with hard_limit(60.0):
        for _ in range(3):
            with hard_limit(30.0):
                time.sleep(0.01)
    with hard_limit(None), hard_limit(math.inf):
        return {"left": signal.getitimer(signal.ITIMER_REAL)[0]}


def not_in_time(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Exceed an outer limit within an inner one that allows more time."""
    with hard_limit(0.2), hard_limit(60.0):
        time.sleep(60.0)
    return {}


def array(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    return {"array": np.zeros(2)}


def infinite(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    return {"cost": math.inf, "nested": [math.nan, 1.0]}


def noisy(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Print as libraries do, in Python and in native code."""
    sys.stdout.write("said by Python\n")
    sys.stdout.flush()
    os.write(1, b'{"content": {}}\n')
    return {"read": sys.stdin.read()}


def figure(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    (folder / "figures").mkdir()
    (folder / "figures" / "one.png").write_bytes(b"\x89PNG")
    return {"figures": ["one.png"]}


def large(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    (folder / "large.bin").write_bytes(bytes(40 * 2**20))
    return {}


def text_of(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    return {"text": "x" * job["number"]}


def compile_in_limit(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Compile for longer than the limit, and work for less."""
    del folder
    with hard_limit(job["limit"]):
        with compiling():
            time.sleep(3 * job["limit"])
        left, _ = signal.getitimer(signal.ITIMER_REAL)
    return {"left": left}
