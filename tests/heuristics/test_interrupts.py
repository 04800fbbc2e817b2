"""Signals that come while a kernel is called wait until the call is over."""

import signal
import subprocess
import sys
import threading

import pytest

from swarmstart.heuristics.interrupts import put_off

# Half a second of searches, with a signal every millisecond, in a process of its own:
# before signals were put off, it ended in a segmentation fault.
BOMBARDED = """
import os, signal, threading, time
import numpy as np
from swarmstart.heuristics import Box, Budget, ChaoticPSO, minimize
box = Box(lower=-np.ones(4), upper=np.ones(4))
def search():
    minimize(lambda x: ((x ** 2).sum(axis=0), np.zeros(x.shape[1])), box,
             algorithm=ChaoticPSO(), budget=Budget(evaluations=400),
             rng=np.random.default_rng(0))
search()
stop = threading.Event()
def bombard():
    while not stop.is_set():
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(1e-3)
caught = 0
end = time.monotonic() + 0.5
thread = threading.Thread(target=bombard)
signal.signal(signal.SIGINT, signal.default_int_handler)
try:
    thread.start()
except KeyboardInterrupt:
    caught += 1
while time.monotonic() < end:
    try:
        search()
    except KeyboardInterrupt:
        caught += 1
signal.signal(signal.SIGINT, signal.SIG_IGN)
stop.set()
thread.join()
print("caught" if caught > 10 else caught)
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
    finished = subprocess.run(
        [sys.executable, "-c", BOMBARDED],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (finished.returncode, finished.stdout.strip()) == (0, "caught")
