"""Ctrl-C in a search, in a process of its own: what was found until then is kept."""

import os
import pickle
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    LSHADE,
    Box,
    GenerationEvent,
    Search,
    SearchInterrupted,
    StopReason,
    minimize,
    run,
)

BOX = Box(lower=np.full(3, -1.0), upper=np.full(3, 2.0))

SCRIPT = """
import ctypes, sys, time
import numpy as np
from swarmstart.heuristics import (
    Box, Budget, SearchInterrupted, StopReason, minimize
)
from swarmstart.machine_code import Pointers

DIM = 4
DOUBLES = ctypes.POINTER(ctypes.c_double)
KERNEL = ctypes.CFUNCTYPE(
    None, ctypes.POINTER(DOUBLES), ctypes.POINTER(DOUBLES), ctypes.c_int64
)
calls = 0


def values(points):
    global calls
    calls += 1
    if calls == TELL_AT:
        print("ready", flush=True)
    if calls >= TELL_AT:
        time.sleep(0.002)
    return (points**2).sum(axis=0), np.maximum(0.5 - points[0], 0.0)


class Compiled:
    def __init__(self):
        self._function = KERNEL(self._evaluate)

    def __call__(self, points):
        raise AssertionError("called from Python")

    def attach(self, asked, cost, violation):
        self._in = (DOUBLES * 1)(asked.ctypes.data_as(DOUBLES))
        outputs = (a.ctypes.data_as(DOUBLES) for a in (cost, violation))
        self._out = (DOUBLES * 2)(*outputs)
        address = ctypes.cast(self._function, ctypes.c_void_p).value
        return Pointers(
            address, ctypes.addressof(self._in), ctypes.addressof(self._out)
        )

    def _evaluate(self, inputs, outputs, size):
        results = values(np.ctypeslib.as_array(inputs[0], (DIM, size)))
        for k, result in enumerate(results):
            np.ctypeslib.as_array(outputs[k], (size,))[:] = result


TELL_AT = int(sys.argv[2])
objective = Compiled() if sys.argv[1] == "compiled" else values
try:
    minimize(
        objective,
        Box(lower=-np.ones(DIM), upper=np.ones(DIM)),
        algorithm="de",
        budget=10**8,
        seed=0,
        basins=2,
    )
except SearchInterrupted as interrupted:
    found = interrupted.partial
    assert isinstance(interrupted, KeyboardInterrupt)
    assert found.stopped is StopReason.INTERRUPTED
    assert found.generations == found.history_cost.size == found.history_violation.size
    assert found.evaluations == 50 * found.generations
    spent = 50 * np.arange(1, found.generations + 1)
    assert (found.history_evaluations == spent).all()
    assert found.history_cost[-1] == found.cost
    cost, violation = (found.x**2).sum(), max(0.5 - found.x[0], 0.0)
    assert np.isclose(cost, found.cost) and violation == found.violation
    assert len(found.basins) == 2
    print("partial", found.generations, calls, flush=True)
except KeyboardInterrupt:
    print("plain", calls, flush=True)
"""


def interrupted(loop: str, tell_at: int) -> list[str]:
    """Return the script's output after SIGINT, sent as soon as it says it is ready."""
    command = [sys.executable, "-c", SCRIPT, loop, str(tell_at)]
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=env
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    return output.split()


@pytest.mark.parametrize("loop", ["python", "compiled"])
def test_ctrl_c_gives_what_was_found_until_then(loop: str) -> None:
    kind, generations, calls = interrupted(loop, tell_at=20)
    assert kind == "partial"
    # The generation under way may be lost.
    assert 20 <= int(calls) - 1 <= int(generations) <= int(calls)


def test_ctrl_c_before_the_first_generation_is_only_ctrl_c() -> None:
    def never(points: Array) -> Array:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        minimize(never, BOX, budget=1000, seed=0)
    assert not isinstance(caught.value, SearchInterrupted)


def sphere(points: Array) -> Array:
    return np.asarray((points**2).sum(axis=0))


def test_an_interrupted_search_runs_on() -> None:
    calls = 0

    def once(points: Array) -> Array:
        nonlocal calls
        calls += 1
        if calls == 4:
            raise KeyboardInterrupt
        return sphere(points)

    search = Search(LSHADE(size=10), BOX, rng=np.random.default_rng(1))
    with pytest.raises(SearchInterrupted, match="after 30 evaluations") as caught:
        run(search, once, budget=500)
    partial = caught.value.partial
    assert (partial.generations, partial.history_cost.size) == (3, 3)
    rng = np.random.default_rng(2)
    copied = Search(LSHADE(size=10), BOX, rng=rng, snapshot=partial.snapshot)
    one, other = (run(s, sphere, budget=500) for s in (search, copied))
    assert one.generations == 3 + one.history_cost.size
    np.testing.assert_array_equal(one.x, other.x)
    assert one.cost <= partial.cost


def test_ctrl_c_in_the_callback_keeps_the_generation() -> None:
    def stop(event: GenerationEvent) -> None:
        if event.generation == 2:
            raise KeyboardInterrupt

    with pytest.raises(SearchInterrupted) as caught:
        minimize(sphere, BOX, budget=2000, seed=0, on_generation=stop)
    partial = caught.value.partial
    assert partial.generations == partial.history_cost.size == 3
    assert partial.stopped is StopReason.INTERRUPTED


def test_an_interrupt_goes_to_another_process_with_its_result() -> None:
    def stop(event: GenerationEvent) -> None:
        raise KeyboardInterrupt

    with pytest.raises(SearchInterrupted) as caught:
        minimize(sphere, BOX, budget=2000, seed=0, on_generation=stop)
    copied = pickle.loads(pickle.dumps(caught.value))
    assert copied.partial.cost == caught.value.partial.cost
    assert str(copied) == str(caught.value)
