"""Signals that come while a kernel is called wait until the call is over."""

import signal
import subprocess
import sys
import threading
import time

import pytest

from swarmstart.heuristics.interrupts import put_off

# Searches for a second, while somebody sends signals; a process of its own, because
# before signals were put off it ended in a segmentation fault.
BOMBARDED = """
import signal, time
import numpy as np
from swarmstart.heuristics import Box, Budget, ChaoticPSO, minimize
box = Box(lower=-np.ones(4), upper=np.ones(4))
def search():
    minimize(lambda x: ((x ** 2).sum(axis=0), np.zeros(x.shape[1])), box,
             algorithm=ChaoticPSO(), budget=Budget(evaluations=400),
             rng=np.random.default_rng(0))
search()
end = time.monotonic() + 1.0
print("ready", flush=True)
while time.monotonic() < end:
    try:
        while time.monotonic() < end:
            search()
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    except KeyboardInterrupt:
        pass
"""


def test_handler_runs_after_the_call_and_is_in_force_again() -> None:
    events: list[str] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: events.append("signal"))
    try:
        with put_off():
            signal.raise_signal(signal.SIGINT)
            events.append("call")
        assert events == ["call", "signal"]
        signal.raise_signal(signal.SIGINT)
        assert events == ["call", "signal", "signal"]
    finally:
        signal.signal(signal.SIGINT, before)


def test_ctrl_c_is_raised_at_the_end() -> None:
    done = False
    with pytest.raises(KeyboardInterrupt):
        with put_off():
            signal.raise_signal(signal.SIGINT)
            done = True
    assert done


def test_nested_calls_put_off_to_the_outermost_end() -> None:
    done = False
    with pytest.raises(KeyboardInterrupt):
        with put_off():
            with put_off():
                signal.raise_signal(signal.SIGINT)
            done = True
    assert done


def test_ignored_signal_stays_ignored() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with put_off():
            signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_nothing_is_done_in_another_thread() -> None:
    entered: list[bool] = []

    def work() -> None:
        with put_off():
            entered.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert entered == [True]


def test_searches_survive_a_hail_of_signals() -> None:
    command = [sys.executable, "-c", BOMBARDED]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        for _ in range(200):  # Over before the searches are.
            process.send_signal(signal.SIGINT)
            time.sleep(2e-3)
        process.communicate(timeout=60)
    # Python's own end by KeyboardInterrupt is fine: one may come between two searches.
    assert process.returncode in (0, -signal.SIGINT)
