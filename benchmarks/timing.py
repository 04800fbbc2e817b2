"""Timing side by side: ratios from one run, for machines whose speed varies."""

import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np


class Timing(NamedTuple):
    """Seconds of one call, over the rounds.

    Attributes:
        median: Median.
        lower: Lower quartile.
        upper: Upper quartile.
    """

    median: float
    lower: float
    upper: float


def timings(
    calls: Mapping[str, Callable[[], object]],
    *,
    rounds: int,
    at_least_s: float = 0.01,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, Timing]:
    """Return how long each call takes, measured in turns.

    Args:
        calls: Name -> timed function; each is called once before, so that nothing is
            compiled or first touched while the clock runs.
        rounds: Number of turns of each.
        at_least_s: A call is repeated until a turn takes about this long [s].
        clock: The clock, such as that of CPU time, `time.process_time`.
    """
    repeats = {name: _repeats(call, at_least_s) for name, call in calls.items()}
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            begin = clock()
            for _ in range(repeats[name]):
                call()
            spent = clock() - begin
            seconds[name].append(spent / repeats[name])
    return {
        name: Timing(
            *(float(q) for q in np.quantile(values, [0.5, 0.25, 0.75]).tolist())
        )
        for name, values in seconds.items()
    }


def _repeats(call: Callable[[], object], at_least_s: float) -> int:
    call()
    begin = time.perf_counter()
    call()
    once = time.perf_counter() - begin
    return max(1, round(at_least_s / max(once, 1e-9)))
