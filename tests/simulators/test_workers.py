"""A crash, a hang or a NaN costs one roll-out, and no process stays."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.simulators.workers import Failure, Order, Workers
from swarmstart.tests.simulators import foreign
from swarmstart.tests.simulators.foreign import Faulty


def order(kind: float, force: float = 1.0) -> Order:
    return Order(np.array([0.0, kind]), np.full((1, 4), force), 0.25)


def children(of: int) -> list[int]:
    """Return the processes whose parent is a process."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            stat = (folder / "stat").read_text(encoding="ascii").rpartition(")")[2]
            words = (folder / "cmdline").read_text(encoding="utf-8")
        except OSError:  # It has ended meanwhile.
            continue
        if int(stat.split()[1]) == of and "simulators.worker" in words:
            found.append(int(folder.name))
    return found


@pytest.mark.parametrize("count", [1, 2])
def test_a_fault_costs_one_rollout_and_is_named(count: int) -> None:
    kinds = [0, foreign.CRASHES, 0, foreign.HANGS, foreign.NAN, 0, foreign.FAILS,
             foreign.LEAVES, 0]  # fmt: skip
    with Workers(Faulty(), count=count, limit_s=1.0) as workers:
        found = workers.results([order(k, i) for i, k in enumerate(kinds)])
    assert [one.kind if isinstance(one, Failure) else "" for one in found] == [
        "", "ended", "", "late", "not finite", "", "RuntimeError", "ended", ""
    ]  # fmt: skip
    words = [one.words for one in found if isinstance(one, Failure)]
    assert words == [
        "by SIGSEGV", "took longer than 1 s", "a state is NaN or infinite",
        "the pump is broken", "with code 3",
    ]  # fmt: skip
    for number in (0, 2, 5, 8):
        states = found[number]
        assert isinstance(states, np.ndarray)
        assert states[0] == pytest.approx(number * np.arange(5) / 4)
    assert children(os.getpid()) == []


def test_more_processes_give_the_same_bits() -> None:
    rng = np.random.default_rng(0)
    orders = [
        Order(rng.random(2), rng.random((1, 20)), 0.1) for _ in range(30)
    ]  # fmt: skip

    def results(count: int) -> Array:
        with Workers(foreign.Cart(), count=count, limit_s=60.0) as workers:
            return np.stack([*workers.results(orders)])  # type: ignore[list-item]

    assert np.array_equal(results(1), results(3))


def test_what_cannot_be_sent_is_refused() -> None:
    with pytest.raises(ss.SimulatorError, match="that can be pickled"):
        Workers(lambda x: x, count=1, limit_s=1.0)  # type: ignore[arg-type]
    with Workers(foreign.Unloadable(), count=1, limit_s=1.0) as workers:
        with pytest.raises(ss.SimulatorError, match="cannot be loaded by a worker: Fi"):
            workers.results([order(0)])
    assert children(os.getpid()) == []


PROGRAM = """
import numpy as np
from swarmstart.simulators.workers import Order, Workers
from swarmstart.tests.simulators.foreign import HANGS, Faulty
with Workers(Faulty(), count=2, limit_s=1000.0) as workers:
    workers.results([Order(np.zeros(2), np.ones((1, 4)), 0.1)] * 4)
    print("ready", flush=True)
    workers.results([Order(np.array([0.0, HANGS]), np.ones((1, 4)), 0.1)] * 4)
"""


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_no_process_is_left(how: signal.Signals, tmp_path: Path) -> None:
    """Workers hang when the program is interrupted, or killed."""
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL, text=True, env=os.environ, cwd=tmp_path,
    ) as program:  # fmt: skip
        assert program.stdout is not None and program.stdout.readline() == "ready\n"
        time.sleep(0.2)
        workers = children(program.pid)
        assert len(workers) == 2
        program.send_signal(how)
        program.wait(30)
    end = time.monotonic() + 30
    while any(map(is_alive, workers)) and time.monotonic() < end:
        time.sleep(0.05)
    assert not any(map(is_alive, workers))


def test_no_process_is_left_in_twenty_tries(tmp_path: Path) -> None:
    for _ in range(20):
        test_no_process_is_left(signal.SIGINT, tmp_path)


def is_alive(process: int) -> bool:
    """Return whether a process runs; one that only waits to be counted does not."""
    try:
        stat = Path(f"/proc/{process}/stat").read_text(encoding="ascii")
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"
