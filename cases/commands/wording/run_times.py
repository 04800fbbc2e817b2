"""Rough run times of the shipped scenarios, for the list.

Measured once, one scenario after the other, with seed 0 and figures, after machine
code had been compiled: the CPU time on a machine that others used as well. They only
distinguish seconds from minutes.
"""

import importlib.resources
import json

_FILE = importlib.resources.files("swarmstart.cases") / "scenarios" / "run_times.json"
RUN_TIMES_S: dict[str, float] = json.loads(_FILE.read_text(encoding="utf-8"))
"""Name of a scenario -> time of `swarmstart run` [s]."""

_STEPS_S = (1, 2, 5, 10, 20, 30)
_MINUTE_S = 60.0


def rough(seconds: float | None) -> str:
    """Return a run time as a round number; "?" if it was not measured.

    Example:
        >>> rough(0.7), rough(3.1), rough(26.0), rough(70.0), rough(None)
        ('1 s', '5 s', '30 s', '1 min', '?')
    """
    if seconds is None:
        return "?"
    for step in _STEPS_S:
        if seconds <= step:
            return f"{step} s"
    return f"{max(1, round(seconds / _MINUTE_S))} min"
