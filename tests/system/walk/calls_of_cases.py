"""Calls of the walk: what the commands do, and records."""

from __future__ import annotations

import swarmstart as ss
from swarmstart.tests.system.walk import made
from swarmstart.tests.system.walk.wrong_values import Call, Calls, record, with_defaults


def calls() -> Calls:
    """Return the calls by name, each with valid arguments by name."""
    finished = made.finished()
    folder = finished.folder or ""
    return {
        "compare": with_defaults(
            ss.compare,
            problems=(made.problem(), [0, 0]),
            solvers="ipopt",
            seeds=1,
            budget=30,
        ),
        "run": with_defaults(
            ss.run,
            scenario="double_integrator",
            seed=0,
            search="none",
            polish="ipopt",
            figures=False,
        ),
        "sweep": with_defaults(
            ss.sweep,
            scenario="double_integrator",
            seed=0,
            polish="ipopt",
            figures=False,
            settings={"instances.values.position": [1.0, 0.5]},
        ),
        "Run": record(finished),
        "Run.linearised": Call(finished.linearised, {"time": 0.0}),
        "Row": record(made.rows()[0]),
        "load": Call(ss.load, {"folder": folder}),
        "Record": record(ss.load(folder)),
        "Progress": with_defaults(ss.Progress, title="swing-up"),
        "Progress.update": Call(
            ss.Progress("swing-up", quiet=True).update,
            {"done": 1, "total": 2, "what": "searching"},
        ),
    }
