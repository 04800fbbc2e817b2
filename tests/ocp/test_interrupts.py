from __future__ import annotations

import signal
import threading

import pytest

from swarmstart.heuristics.interrupts import SIGNALS
from swarmstart.ocp.interrupts import noticed


def handlers() -> list[object]:
    return [signal.getsignal(number) for number in SIGNALS]


def test_a_swallowed_interrupt_is_noticed_and_the_handlers_come_back() -> None:
    before = handlers()
    with noticed() as asked_to_stop:
        assert not asked_to_stop()
        with pytest.raises(KeyboardInterrupt):  # as a solver swallows it
            signal.raise_signal(signal.SIGINT)
        assert asked_to_stop()
    assert handlers() == before


def test_the_handlers_come_back_when_the_interrupt_is_not_swallowed() -> None:
    before = handlers()
    with pytest.raises(KeyboardInterrupt), noticed():
        signal.raise_signal(signal.SIGINT)
    assert handlers() == before


def test_an_ignored_signal_stays_ignored() -> None:
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with noticed() as asked_to_stop:
            signal.raise_signal(signal.SIGTERM)
            assert not asked_to_stop()
    finally:
        signal.signal(signal.SIGTERM, before)


def test_another_thread_leaves_the_handlers_alone() -> None:
    seen: list[object] = []

    def enter() -> None:
        with noticed() as asked_to_stop:
            seen.extend([handlers(), asked_to_stop()])

    before = handlers()
    thread = threading.Thread(target=enter)
    thread.start()
    thread.join()
    assert seen == [before, False]
