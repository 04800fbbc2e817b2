"""Calls made ahead by copies of the process: as if made here, one after the other."""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import pytest

from swarmstart.cases.commands.terminal import Progress
from swarmstart.ocp.common.processes import Ahead, free_processors, processes_of

HERE = os.getpid()


def nothing() -> None:
    """Do nothing in a copy."""


def ahead(
    calls: Sequence[Callable[[], object]], most: int, first: tuple[int, ...] = ()
) -> Ahead[object]:
    """Return the results of calls, which are sent as they are."""
    return Ahead(
        calls,
        processes=most,
        begins=nothing,
        sent=lambda x: x,
        received=lambda x: x,
        first=first,
    )


def late(number: int) -> int:
    """Return a number, the earlier the later, so that copies end in another order."""
    time.sleep(0.02 * (5 - number))
    return number


def where(number: int) -> tuple[int, bool]:
    """Return a number, and whether it is computed here."""
    time.sleep(0.01)
    return number, os.getpid() == HERE


def children() -> set[str]:
    """Return the processes that this one has begun and not yet waited for."""
    # Of all threads; other tests of the same process may have left some.
    files = Path(f"/proc/{os.getpid()}/task").glob("*/children")
    return {child for file in files for child in file.read_text().split()}


@pytest.fixture(autouse=True)
def _leaves_no_process() -> Iterator[None]:
    before = children()
    yield
    assert children() <= before


@pytest.mark.parametrize("most", [1, 2, 3, 9])
def test_results_come_in_the_order_of_the_calls(most: int) -> None:
    with ahead([partial(late, n) for n in range(6)], most) as results:
        assert list(results) == list(range(6))


def test_copies_do_a_share_and_one_process_does_all() -> None:
    calls = [partial(where, n) for n in range(6)]
    for most, some in ((1, False), (2, True)):
        with ahead(calls, most) as results:
            assert ([*results] != [(n, True) for n in range(6)]) == some


def test_calls_that_are_left_out_are_not_made_here() -> None:
    made: list[int] = []
    calls = [partial(made.append, n) for n in range(5)]
    with ahead(calls, 2) as results:
        results.result(1)
        results.result(4)
    # A copy's list is another one.
    assert set(made) <= {1, 4}


def test_copies_begin_with_the_calls_that_are_wanted_first() -> None:
    calls = [partial(where, n) for n in range(5)]
    with ahead(calls, 2, first=(0, 3)) as results:
        results.result(0)
        found = [results.result(n) for n in (3, 4)]
    assert found[0] == (3, False)


def test_a_copy_can_begin_while_this_process_does_other_work() -> None:
    with ahead([partial(where, n) for n in range(3)], 2) as results:
        assert results.begin()
        assert results.result(0) == (0, False)
    with ahead([partial(where, 0)], 1) as results:
        assert not results.begin()
        assert results.result(0) == (0, True)


def test_large_results_arrive_whole() -> None:
    # Far beyond what a pipe holds, which the copy must wait to be read.
    calls: list[Callable[[], object]] = [partial(bytes, 3_000_000) for _ in range(3)]
    with ahead(calls, 2) as results:
        assert [len(one) for one in results] == [3_000_000] * 3  # type: ignore[arg-type]


def killed_in_a_copy(number: int, sign: int) -> int:
    """Return a number, but end a copy of the process before."""
    if os.getpid() != HERE:
        os.kill(os.getpid(), sign)
    return number


def test_what_a_killed_copy_should_do_is_done_here() -> None:
    calls = [partial(killed_in_a_copy, n, signal.SIGKILL) for n in range(4)]
    with ahead(calls, 3) as results:
        assert list(results) == [0, 1, 2, 3]


def test_ctrl_c_is_left_to_the_first_process() -> None:
    calls = [partial(killed_in_a_copy, n, signal.SIGINT) for n in range(4)]
    told = []
    with Ahead(
        calls,
        processes=2,
        begins=nothing,
        sent=lambda x: (x, os.getpid() == HERE),
        received=lambda x: told.append(x[1]) or x[0],  # type: ignore[func-returns-value]
    ) as results:
        assert list(results) == [0, 1, 2, 3]
    assert told and not any(told)


def test_the_error_of_a_call_comes_in_its_turn() -> None:
    calls: list[Callable[[], object]] = [
        partial(late, 3), partial(divmod, 1, 0), partial(late, 4)
    ]  # fmt: skip
    with ahead(calls, 2) as results:
        assert results.result(0) == 3
        with pytest.raises(ZeroDivisionError):
            results.result(1)


def test_an_interrupt_leaves_no_copies() -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    calls: list[Callable[[], object]] = [interrupted, partial(time.sleep, 1000)]
    with pytest.raises(KeyboardInterrupt), ahead(calls, 2) as results:
        results.result(0)


def test_a_copy_begins_silently_and_this_process_does_not() -> None:
    told: list[str] = []
    calls = [partial(lambda n: (n, tuple(told)), n) for n in range(2)]
    with Ahead(
        calls,
        processes=2,
        begins=partial(told.append, "a copy"),
        sent=lambda x: x,
        received=lambda x: x,
    ) as results:
        assert list(results) == [(0, ()), (1, ("a copy",))]


def test_progress_that_is_shown_by_default_keeps_no_process_from_being_copied(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    before = threading.enumerate()
    with Progress("work", waits=True):
        own = [one for one in threading.enumerate() if one not in before]
        assert own
        threads = [threading.current_thread(), *own]
        monkeypatch.setattr(threading, "enumerate", lambda: threads)
        assert processes_of(None) == free_processors()


def test_a_program_with_threads_of_its_own_is_not_copied_unasked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    this = threading.current_thread()
    own = threading.Thread(name="swarmstart_0")
    other = threading.Thread(name="Thread-1")
    for threads, most in (
        ([this], free_processors()), ([this, own], free_processors()),
        ([this, own, other], 1),
    ):  # fmt: skip
        monkeypatch.setattr(threading, "enumerate", lambda threads=threads: threads)
        assert processes_of(None) == most
        assert processes_of(3) == 3
    monkeypatch.setattr(sys, "platform", "darwin")
    assert processes_of(3) == 1
