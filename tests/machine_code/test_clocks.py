"""Time spent on machine code counts apart, and once."""

import logging
import math
import time

import pytest

from swarmstart.machine_code import clocks
from swarmstart.machine_code.clocks import (
    announce,
    compiling,
    done,
    now,
    stopwatch,
    working,
)


class Clock:
    """A clock that is put forward by hand."""

    def __init__(self) -> None:
        self.now = 0.0

    def perf_counter(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    by_hand = Clock()
    monkeypatch.setattr(clocks, "time", by_hand)
    return by_hand


def test_compiling_counts_apart_from_all_else(clock: Clock) -> None:
    with stopwatch() as watch:
        clock.now += 1.0
        with compiling():
            clock.now += 10.0
        clock.now += 2.0
        assert (watch.seconds, watch.compile_seconds) == (3.0, 10.0)


def test_compiling_within_compiling_counts_once(clock: Clock) -> None:
    with stopwatch() as watch, compiling():
        clock.now += 1.0
        with compiling():
            clock.now += 10.0
    assert (watch.seconds, watch.compile_seconds) == (0.0, 11.0)


def test_every_stopwatch_that_runs_takes_it_off(clock: Clock) -> None:
    with stopwatch() as outer:
        clock.now += 1.0
        with stopwatch() as inner, compiling():
            clock.now += 10.0
        with compiling():
            clock.now += 5.0
    assert (outer.seconds, outer.compile_seconds) == (1.0, 15.0)
    assert inner.compile_seconds == 10.0


def test_compiling_that_fails_counts_too(clock: Clock) -> None:
    with stopwatch() as watch:
        with pytest.raises(KeyboardInterrupt), compiling():
            clock.now += 10.0
            raise KeyboardInterrupt
        with compiling():
            clock.now += 1.0
    assert watch.compile_seconds == 11.0


def test_it_is_said_once_in_a_process(caplog: pytest.LogCaptureFixture) -> None:
    announce.cache_clear()
    with caplog.at_level(logging.INFO, "swarmstart"):
        announce("the search", "about 10 s")
        announce("the search", "about 10 s")
        announce("something else", "some seconds")
    assert caplog.messages == [
        "compiling the search for this machine, once, about 10 s",
        "compiling something else for this machine, once, some seconds",
    ]


def test_nothing_is_promised_once_that_is_done_in_each_process(
    caplog: pytest.LogCaptureFixture,
) -> None:
    announce.cache_clear()
    with caplog.at_level(logging.INFO, "swarmstart"):
        announce("the search", "about 10 s", is_kept=False)
    (message,) = caplog.messages
    assert "once" not in message and "no cache can be used" in message


def test_work_is_counted_in_its_block_and_in_the_one_around_it() -> None:
    done(1e12)  # Outside of a block it counts nowhere.
    with working() as outer:
        done(2e9)
        assert now() == 2.0
        with working() as inner:
            assert now() == 0.0
            done(5e8)
            assert (inner.now(), inner.was_late) == (0.5, False)
        assert now() == outer.work == 2.5
    assert not outer.was_late
    # Outside of a block the time is that of a clock.
    assert abs(now() - time.perf_counter()) < 60.0


def test_after_the_limit_no_work_is_left() -> None:
    with working(seconds=0.0) as clock:
        while time.perf_counter() <= clock.limit:
            pass
        assert now() == math.inf
    assert clock.was_late
    with working(seconds=1e9) as outer, working(seconds=0.0) as inner:
        while time.perf_counter() <= inner.limit:
            pass
        assert not now() < 1.0
    assert outer.was_late
