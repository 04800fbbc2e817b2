"""A hard limit ends a process of cells in native code, and no other process."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import pytest

from swarmstart.cases.campaign.engine.cells import Cell, carried_out, finished
from swarmstart.cases.campaign.engine.wall_limit import PLACE, hard_limit

WORK = "swarmstart.tests.cases.campaign.campaign_work"
pytestmark = pytest.mark.skipif(
    not hasattr(signal, "setitimer"), reason="limits as POSIX has them"
)


def cell(work: str, *, rescue: str = "", **job: float) -> Cell:
    return Cell(
        work=f"{WORK}:{work}",
        job={"number": 3, **job},
        label=work,
        timeout_s=60.0,
        rescue=rescue and f"{WORK}:{rescue}",
    )


def test_native_code_that_never_returns_ends_at_its_limit(tmp_path: Path) -> None:
    rescued = cell("spin", limit=0.3, rescue="rescue")
    lost = cell("spin", limit=0.2)
    twice = cell("spin", limit=0.25, rescue="spin")
    cells = [rescued, lost, twice, cell("within_limit"), cell("not_in_time")]
    first, second, third, fourth, fifth = carried_out(cells, tmp_path, workers=2)

    assert first.result is not None and first.result["rescued"] == 3
    assert (first.failure, first.was_cut) == ("", True)
    assert first.seconds >= 0.3
    assert first.cpu_s is not None and 0.0 < first.cpu_s <= first.seconds + 0.1
    assert finished(rescued, tmp_path) == first

    assert second.failure == "stopped by the hard limit of 0.2 s"
    assert not second.was_cut and finished(lost, tmp_path) is None
    assert third.failure == (
        "its rescue after the hard limit failed: stopped by the hard limit of 0.25 s"
    )
    assert fourth.result == {"left": 0.0}
    # The inner limit of 60 s counts no more than what the outer one leaves.
    assert fifth.failure == "stopped by the hard limit of 60 s"
    assert 0.2 <= fifth.seconds < 60.0


def test_making_machine_code_does_not_count(tmp_path: Path) -> None:
    (outcome,) = carried_out([cell("compile_in_limit", limit=0.5)], tmp_path, workers=1)
    assert outcome.result is not None and not outcome.was_cut
    assert 0.3 < outcome.result["left"] <= 0.5


@pytest.mark.parametrize("place", [None, "", "1:2", "text", "PID:text"])
def test_a_process_that_is_not_of_cells_is_not_ended(
    monkeypatch: pytest.MonkeyPatch, place: str | None
) -> None:
    monkeypatch.delenv(PLACE, raising=False)
    if place is not None:
        monkeypatch.setenv(PLACE, place.replace("PID", str(os.getpid())))
    before = signal.getsignal(signal.SIGALRM)
    with hard_limit(0.01):
        assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
        time.sleep(0.03)
    assert signal.getsignal(signal.SIGALRM) is before


def test_what_was_set_before_is_set_afterwards(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    read, write = os.pipe()
    monkeypatch.setenv(PLACE, f"{os.getpid()}:{write}")
    before = signal.getsignal(signal.SIGALRM)
    with pytest.raises(ZeroDivisionError), hard_limit(60.0):
        assert signal.getsignal(signal.SIGALRM) is signal.SIG_DFL
        assert 59.0 < signal.getitimer(signal.ITIMER_REAL)[0] <= 60.0
        with hard_limit(30.0):
            assert 29.0 < signal.getitimer(signal.ITIMER_REAL)[0] <= 30.0
        assert 59.0 < signal.getitimer(signal.ITIMER_REAL)[0] <= 60.0
        raise ZeroDivisionError
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert signal.getsignal(signal.SIGALRM) is before
    armed: list[float] = []

    def elsewhere() -> None:
        with hard_limit(60.0):
            armed.append(signal.getitimer(signal.ITIMER_REAL)[0])

    other = threading.Thread(target=elsewhere)
    other.start()
    other.join()
    assert armed == [0.0]
    os.close(read)
    os.close(write)


@pytest.mark.parametrize("seconds", [-1.0, float("nan")])
def test_a_limit_that_is_no_time_is_refused(seconds: float) -> None:
    with pytest.raises(ValueError, match="expected a limit of 0 s or more"):
        with hard_limit(seconds):
            pass
