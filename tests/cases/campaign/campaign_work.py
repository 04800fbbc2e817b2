"""Work for cells of tests: imported by name in worker processes."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swarmstart.cases.campaign.cell_work import Beginning, cell_content, commit
from swarmstart.cases.campaign.wall_limit import hard_limit
from swarmstart.cases.record.files import to_json
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics import Budget


def square(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Note that it was done, and return the square."""
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
    """Commit the square, as the worker does, and die before it is told."""
    order = {"work": f"{__name__}:square_and_die", "job": dict(job), "label": "dies"}
    content = cell_content(order, Beginning(), result=square(job, folder))
    commit(folder, to_json(content), seconds=1.0)
    os._exit(9)


def die_once(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Die, unless somebody has done so before."""
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
