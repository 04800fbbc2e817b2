"""Signals that come while a kernel is called wait; none that is swallowed gets lost."""

import signal
import subprocess
import sys
import threading
import time
from typing import Any

import pytest

from swarmstart.heuristics.running.interrupts import SIGNALS, heeded, put_off

# Searches for a second, while the test sends signals; a process of its own, because
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


def handlers() -> list[object]:
    return [signal.getsignal(number) for number in SIGNALS]


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
        with put_off(), heeded() as asked_to_stop:
            entered.append(not asked_to_stop())

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert entered == [True]


def test_a_hang_up_is_put_off_too() -> None:
    events: list[str] = []
    before = signal.signal(signal.SIGHUP, lambda number, frame: events.append("signal"))
    try:
        with put_off():
            signal.raise_signal(signal.SIGHUP)
            events.append("call")
        assert events == ["call", "signal"]
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_handler_left_behind_passes_signals_on() -> None:
    """It is left behind if a signal comes while two handlers are restored."""
    with put_off():
        left_behind = signal.getsignal(signal.SIGINT)
    before = signal.signal(signal.SIGINT, left_behind)
    try:
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        done = False
        with pytest.raises(KeyboardInterrupt), put_off():
            signal.raise_signal(signal.SIGINT)
            done = True
        assert done
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_signal_while_handlers_are_replaced_leaves_none_behind(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = handlers()
    replace, calls = signal.signal, []

    def signalled(number: int, handler: Any) -> None:
        replace(number, handler)
        calls.append(number)
        if len(calls) == 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(signal, "signal", signalled)
    with pytest.raises(KeyboardInterrupt), put_off():
        pass
    assert handlers() == before


# --- swallowed


def test_a_swallowed_request_is_raised_at_the_end() -> None:
    before = handlers()
    done = False
    with pytest.raises(KeyboardInterrupt):
        with heeded() as asked_to_stop:
            assert not asked_to_stop()
            with pytest.raises(KeyboardInterrupt):  # as a solver swallows it
                signal.raise_signal(signal.SIGINT)
            assert asked_to_stop()
            done = True
    assert done and handlers() == before


def test_a_request_that_became_another_exception_is_raised_as_what_it_was() -> None:
    with pytest.raises(KeyboardInterrupt) as raised, heeded():
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        raise NotImplementedError("Wrong number or type of arguments")  # as CasADi does
    assert isinstance(raised.value.__cause__, NotImplementedError)


def test_an_exception_of_another_cause_stays_what_it_is() -> None:
    before = handlers()
    with pytest.raises(NotImplementedError), heeded():
        raise NotImplementedError
    assert handlers() == before


def test_what_is_raised_for_the_request_keeps_what_it_carries() -> None:
    with pytest.raises(KeyboardInterrupt, match="kept"), heeded():
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise KeyboardInterrupt("kept") from None


def test_an_ignored_request_is_not_heeded() -> None:
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with heeded() as asked_to_stop:
            signal.raise_signal(signal.SIGTERM)
            assert not asked_to_stop()
    finally:
        signal.signal(signal.SIGTERM, before)


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
