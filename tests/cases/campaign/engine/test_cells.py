"""Campaigns: nothing finished is lost or done twice, and no process is left."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from swarmstart.cases.campaign.engine.cell_work import MARK, machine
from swarmstart.cases.campaign.engine.cells import (
    Cell,
    CodeChangedError,
    Outcome,
    carried_out,
    finished,
)
from swarmstart.cases.record import files
from swarmstart.cases.record.files import FolderInUseError, locked
from swarmstart.cases.record.record import versions
from swarmstart.tests.processes import environment

WORK = "swarmstart.tests.cases.campaign.campaign_work"
PATIENCE_S = 120.0


def cell(
    work: str, number: int = 0, *, timeout_s: float | None = None, **job: float
) -> Cell:
    return Cell(
        work=f"{WORK}:{work}",
        job={"number": number, **job},
        label=f"{work} {number}",
        timeout_s=timeout_s,
    )


def done(cells: list[Cell], root: Path, workers: int = 2) -> list[Outcome]:
    return carried_out(cells, root, workers=workers)


def times_done(one: Cell, root: Path) -> int:
    return len((root / one.key / "done").read_text().splitlines())


def test_cells_are_done_once_whoever_asks(tmp_path: Path) -> None:
    cells = [cell("square", number) for number in (3, 4, 3)]
    told: list[tuple[int, int, str]] = []
    first = carried_out(
        cells, tmp_path, workers=2, told=lambda *what: told.append(what)
    )
    assert [outcome.result for outcome in first] == [
        {"square": 9}, {"square": 16}, {"square": 9}
    ]  # fmt: skip
    assert told[0] == (0, 2, "kept from before") and told[-1][:2] == (2, 2)
    assert done(cells, tmp_path) == first
    assert [times_done(one, tmp_path) for one in cells] == [1, 1, 1]


def test_a_key_is_of_the_work_and_the_job_and_nothing_else(tmp_path: Path) -> None:
    one = cell("square", 3)
    assert cell("square", 4).key != one.key
    assert cell("refuse", 3).key != one.key
    relabelled = Cell(work=one.work, job=dict(one.job), label="else", timeout_s=1.0)
    assert relabelled.key == one.key


def test_one_and_two_workers_give_the_same(tmp_path: Path) -> None:
    cells = [cell("square", number) for number in range(5)]
    results = [
        [outcome.result for outcome in done(cells, tmp_path / str(n), n)]
        for n in (1, 2)
    ]
    assert results[0] == results[1]


def test_a_cell_that_fails_is_recorded_and_the_others_are_kept(tmp_path: Path) -> None:
    cells = [
        cell("refuse", 3),
        cell("break_off"),
        cell("die"),
        cell("hang", timeout_s=1.0),
        cell("square", 5),
    ]
    failures = [outcome.failure for outcome in done(cells, tmp_path)]
    assert failures[0] == "expected an even number, found 3"
    assert failures[1] == "ZeroDivisionError: by nothing"
    assert failures[2].startswith("its process died")
    assert failures[3] == "it took longer than its time limit"
    assert failures[4] == ""
    again = done(cells[:2], tmp_path)
    assert [outcome.failure for outcome in again] == failures[:2]


def test_what_died_or_took_too_long_is_tried_when_asked_for_again(
    tmp_path: Path,
) -> None:
    slow = cell("square", 3, timeout_s=0.5, seconds=2.0)
    (first,) = done([slow], tmp_path)
    assert first.failure == "it took longer than its time limit"
    assert finished(slow, tmp_path) is None
    patient = cell("square", 3, timeout_s=60.0, seconds=2.0)
    assert done([patient], tmp_path)[0].result == {"square": 9}


def test_an_error_with_several_parts_fails_its_own_cell_only(
    tmp_path: Path,
) -> None:
    first, second = done([cell("refuse_budget"), cell("square", 5)], tmp_path, 1)
    assert first.failure.startswith("evaluations must be an integer of at least 1")
    assert second.result == {"square": 25}


def test_a_worker_that_dies_costs_nothing_but_another_attempt(tmp_path: Path) -> None:
    (outcome,) = done([cell("die_once", 7)], tmp_path)
    assert (outcome.result, outcome.failure) == ({"square": 49}, "")


def test_a_cell_that_ended_before_its_process_died_is_not_replaced(
    tmp_path: Path,
) -> None:
    first = cell("square_and_die", 3)
    (outcome,) = done([first], tmp_path)
    assert (outcome.result, outcome.failure) == ({"square": 9}, "")


def test_two_campaigns_do_not_work_in_one_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "PATIENCE_S", 0.1)
    with locked(tmp_path), pytest.raises(FolderInUseError):
        done([cell("square", 3)], tmp_path)


def test_workers_have_one_blas_thread_and_the_parent_keeps_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    (outcome,) = done([cell("threads")], tmp_path)
    assert outcome.result == {"threads": "1"}
    assert os.environ["OPENBLAS_NUM_THREADS"] == "7"


@pytest.mark.parametrize("content", ["", "{", '{"result": 1}', "[]"])
def test_a_mark_that_cannot_be_read_is_none(tmp_path: Path, content: str) -> None:
    one = cell("square", 3)
    (tmp_path / one.key).mkdir()
    (tmp_path / one.key / MARK).write_text(content)
    assert finished(one, tmp_path) is None
    assert done([one], tmp_path)[0].result == {"square": 9}


def test_a_mark_says_when_where_and_with_what(tmp_path: Path) -> None:
    before = datetime.now(UTC).replace(microsecond=0)
    one = cell("square", 3, seconds=0.05)
    (outcome,) = done([one], tmp_path)
    mark = json.loads((tmp_path / one.key / MARK).read_text())
    assert mark["schema"] == 2
    assert before <= datetime.fromisoformat(outcome.date) <= datetime.now(UTC)
    assert outcome.date.endswith("+00:00")
    assert outcome.machine == mark["machine"] == machine()
    assert outcome.versions == mark["versions"] == versions()
    assert outcome.load is None or list(outcome.load) == mark["load"]
    assert outcome.cpu_s is not None and 0 <= outcome.cpu_s < outcome.seconds
    assert outcome.was_cut is mark["was_cut"] is False
    assert finished(one, tmp_path) == outcome


def test_a_mark_of_the_former_version_is_computed_anew(tmp_path: Path) -> None:
    one = cell("square", 3)
    former = {"schema": 1, "label": "", "work": one.work, "job": dict(one.job)}
    former |= {"failure": "", "again": False, "seconds": 1.0, "result": {"square": 8}}
    (tmp_path / one.key).mkdir()
    (tmp_path / one.key / MARK).write_text(json.dumps(former))
    assert finished(one, tmp_path) is None
    assert done([one], tmp_path)[0].result == {"square": 9}


def test_results_are_data_or_the_cell_fails(tmp_path: Path) -> None:
    array, infinite, noisy = done(
        [cell("array"), cell("infinite"), cell("noisy")], tmp_path
    )
    assert array.failure == "TypeError: Object of type ndarray is not JSON serializable"
    assert infinite.result == {"cost": None, "nested": [None, 1.0]}
    assert noisy.result == {"read": ""}


def test_cells_are_done_in_their_order(tmp_path: Path) -> None:
    cells, told = [cell("square", number) for number in (5, 1, 4, 2)], list[str]()
    carried_out(cells, tmp_path, workers=1, told=lambda *what: told.append(what[2]))
    assert told[1:] == [one.label for one in cells]


def test_code_that_was_edited_meanwhile_is_not_mixed(tmp_path: Path) -> None:
    class Edited(Cell):
        @property
        def key(self) -> str:
            return "0123456789abcdef"

    one = Edited(work=f"{WORK}:square", job={"number": 3}, label="edited")
    with pytest.raises(CodeChangedError, match="has been edited since"):
        done([one], tmp_path)


def test_a_full_disk_stops_the_campaign_and_loses_nothing(tmp_path: Path) -> None:
    """RLIMIT_FSIZE makes writes fail like a full disk, in every process."""
    root = tmp_path / "cells"
    small, large = cell("square", 3), cell("text_of", 10**6)
    limited = program(root, [small, large], workers=1).replace(
        "if __name__", "import resource, signal\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (10**5, 10**5))\nif __name__"
    )  # fmt: skip
    ended = subprocess.run(
        [sys.executable, "-c", limited], env=environment(), capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert "RecordError" in ended.stderr and "File too large" in ended.stderr
    assert finished(small, root) is not None and finished(large, root) is None
    assert not any(files.is_temporary(file.name) for file in root.rglob("*"))
    assert [o.failure for o in done([small, large], root)] == ["", ""]
    assert times_done(small, root) == 1


def program(root: Path, cells: list[Cell], workers: int = 2) -> str:
    """Return a program that does cells."""
    return (
        "from swarmstart.cases.campaign.engine.cells import Cell, carried_out\n"
        "from pathlib import Path\n"
        "if __name__ == '__main__':\n"
        f"    cells = {cells!r}\n"
        f"    carried_out(cells, Path({str(root)!r}), workers={workers})\n"
    )


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    stat = Path(f"/proc/{pid}/stat")
    return not stat.exists() or ") Z " not in stat.read_text()


@pytest.mark.skipif(os.name != "posix", reason="kills as POSIX has them")
@pytest.mark.parametrize("after_s", [1.3, 1.9])
def test_a_killed_command_leaves_whole_cells_and_no_process(
    tmp_path: Path, after_s: float
) -> None:
    cells = [cell("square", number, seconds=0.2) for number in range(12)]
    root = tmp_path / "cells"
    command = subprocess.Popen(
        [sys.executable, "-c", program(root, cells)], env=environment()
    )
    time.sleep(after_s)
    command.send_signal(signal.SIGKILL)
    command.wait()
    marks = list(root.glob(f"*/{MARK}"))
    for mark in marks:
        assert json.loads(mark.read_text())["result"]
    require_gone(root)
    assert sum(finished(one, root) is not None for one in cells) >= len(marks)
    outcomes = done(cells, root)
    assert [o.result for o in outcomes] == [{"square": n**2} for n in range(12)]


@pytest.mark.skipif(sys.platform != "linux", reason="the system ends them on Linux")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_workers_in_native_code_end_with_the_command(
    tmp_path: Path, number: signal.Signals
) -> None:
    cells = [cell("spin", number) for number in range(2)]
    command = subprocess.Popen(
        [sys.executable, "-c", program(tmp_path, cells)],
        env=environment(),
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + PATIENCE_S
    while len(workers_of(tmp_path)) < 2 and time.monotonic() < deadline:
        time.sleep(0.02)
    command.send_signal(number)
    _, said = command.communicate(timeout=PATIENCE_S)
    assert ("0 of 2 runs are kept" in said) == (number == signal.SIGINT)
    require_gone(tmp_path)


def workers_of(root: Path) -> set[int]:
    """Return the processes that have marked that they work on a cell."""
    return {
        int(line)
        for file in root.glob("*/done")
        for line in file.read_text().splitlines()
    }


def require_gone(root: Path) -> None:
    """Wait for the workers to end."""
    workers = workers_of(root)
    deadline = time.monotonic() + PATIENCE_S
    while any(map(alive, workers)) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not any(map(alive, workers))
