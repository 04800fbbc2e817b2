"""Ctrl-C keeps finished steps, and the same command continues from there."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from swarmstart.cases.campaign.running import run as run_module
from swarmstart.cases.commands.actions import listing as listing_module
from swarmstart.cases.commands.front.cli import main
from swarmstart.heuristics.running.interrupts import SIGNALS
from swarmstart.ocp import Step, fly

if TYPE_CHECKING:
    from swarmstart.tests.system.conftest import Command

STEPS = 6
SMALL = (
    *("run", "formation_v", "--variant", "literal", "--no-figures", "--quiet"),
    *("--set", f"steps={STEPS}", "--set", "budget.evaluations=40"),
)
SLOW = (
    *("run", "formation_v", "--variant", "literal", "--no-figures"),
    *("--set", f"steps={STEPS}", "--set", "budget.evaluations=2000"),
)
# Only IPOPT plans, some 20 ms at a time.
SOLVER = (
    *("run", "formation_v", "--variant", "literal", "--no-figures", "--quiet"),
    *("--search", "none", "--polish", "ipopt"),
    *(
        "--set",
        "steps=3",
        "--set",
        "prediction.horizon_s=60",
        "--set",
        "prediction.intervals=60",
    ),
)


def arrays(folder: Path) -> dict[str, Any]:
    with np.load(folder / "trajectory.npz", allow_pickle=False) as file:
        return {name: file[name] for name in file if name != "step_seconds"}


def assert_same_flight(one: Path, other: Path) -> None:
    first, second = arrays(one), arrays(other)
    assert first.keys() == second.keys()
    for name, values in first.items():
        assert values.tobytes() == second[name].tobytes(), name


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    assert main([*SMALL, "--out", str(folder)]) == 0
    return folder


def interrupted_after(count: int) -> Callable[..., Iterator[Step]]:
    """Return a simulation that is interrupted after some steps."""

    def interrupted(*arguments: Any, **keywords: Any) -> Iterator[Step]:
        for number, step in enumerate(fly(*arguments, **keywords)):
            if number == count:
                raise KeyboardInterrupt
            yield step

    return interrupted


def test_a_run_goes_on_from_every_interruption_with_the_same_bits(
    command: Command,
    uninterrupted: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for kept in (2, 4):
        monkeypatch.setattr(run_module, "fly", interrupted_after(2))
        said = command(*SMALL, "--out", tmp_path)
        assert (said.code, said.out) == (130, "")
        assert said.err == (
            f"swarmstart: interrupted: {kept} finished steps are kept in "
            f"{tmp_path}; the same command again goes on from there\n"
        )
        assert {file.name for file in tmp_path.iterdir()} == {
            *("partial.json", "partial.npz")
        }
    monkeypatch.setattr(run_module, "fly", fly)
    said = command(*SMALL, "--out", tmp_path, "--json")
    assert (said.code, said.err) == (0, "")
    assert_same_flight(tmp_path, uninterrupted)
    whole = json.loads((uninterrupted / "run.json").read_text())
    assert json.loads(said.out)["evaluations"] == whole["evaluations"]
    assert {file.name for file in tmp_path.iterdir()} == {
        *("scenario.yaml", "trajectory.npz", "steps.csv", "run.json")
    }


def test_an_interruption_before_the_first_step_leaves_no_record(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_module, "fly", interrupted_after(0))
    said = command(*SMALL, "--out", tmp_path)
    assert (said.code, said.out, said.err) == (130, "", "swarmstart: interrupted\n")
    assert not list(tmp_path.iterdir())


def test_an_interruption_while_drawing_keeps_the_flight(
    command: Command,
    uninterrupted: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(run_module, "_recorded", interrupt)
        said = command(*SMALL, "--out", tmp_path)
    assert said.code == 130
    assert f"{STEPS} finished steps are kept in {tmp_path}" in said.err
    flown = []

    def noted(*arguments: Any, **keywords: Any) -> Iterator[Step]:
        for step in fly(*arguments, **keywords):
            flown.append(step)
            yield step

    monkeypatch.setattr(run_module, "fly", noted)
    assert command(*SMALL, "--out", tmp_path).code == 0
    assert not flown
    assert_same_flight(tmp_path, uninterrupted)


def test_what_another_run_left_is_not_gone_on_from(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(run_module, "fly", interrupted_after(2))
        assert command(*SMALL, "--out", tmp_path).code == 130
    other = (*SMALL, "--seed", "1", "--out", tmp_path, "--force")
    assert command(*other).code == 0
    alone = tmp_path / "alone"
    assert command(*SMALL, "--seed", "1", "--out", alone).code == 0
    assert_same_flight(tmp_path, alone)


def test_a_broken_partial_record_is_named_and_not_overwritten(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(run_module, "fly", interrupted_after(2))
        assert command(*SMALL, "--out", tmp_path).code == 130
    whole = (tmp_path / "partial.npz").read_bytes()
    for broken in (whole[: len(whole) // 2], b""):
        (tmp_path / "partial.npz").write_bytes(broken)
        said = command(*SMALL, "--out", tmp_path)
        assert (said.code, said.out) == (5, "")
        assert said.err.startswith(f"swarmstart: {tmp_path / 'partial.json'}: expected")
        assert (tmp_path / "partial.npz").read_bytes() == broken


def test_a_crash_between_the_two_files_of_a_checkpoint_costs_no_bit(
    command: Command,
    uninterrupted: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    marks = []
    for _ in range(2):
        with monkeypatch.context() as patched:
            patched.setattr(run_module, "fly", interrupted_after(2))
            assert command(*SMALL, "--out", tmp_path).code == 130
        marks.append((tmp_path / "partial.json").read_bytes())
    # Arrays of four steps beside the mark of two: as if killed between the files.
    (tmp_path / "partial.json").write_bytes(marks[0])
    assert command(*SMALL, "--out", tmp_path).code == 0
    assert_same_flight(tmp_path, uninterrupted)


def broken_by_a_conversion(becomes: Exception | None) -> Callable[..., Iterator[Step]]:
    """Return a simulation in whose third step a conversion swallows Ctrl-C."""

    def interrupted(*arguments: Any, **keywords: Any) -> Iterator[Step]:
        for number, step in enumerate(fly(*arguments, **keywords)):
            if number == 2:
                with contextlib.suppress(KeyboardInterrupt):
                    signal.raise_signal(signal.SIGINT)
                if becomes is not None:
                    raise becomes
            yield step

    return interrupted


@pytest.mark.parametrize(
    "becomes",
    [NotImplementedError("Wrong number or type of arguments"), None],
    ids=["another exception", "nothing"],
)
def test_a_signal_that_a_conversion_swallows_keeps_the_steps_before(
    becomes: Exception | None,
    command: Command,
    uninterrupted: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The step itself does not count: another overload may have been tried."""
    with monkeypatch.context() as patched:
        patched.setattr(run_module, "fly", broken_by_a_conversion(becomes))
        said = command(*SMALL, "--out", tmp_path)
    assert (said.code, said.out) == (130, "")
    assert "interrupted: 2 finished steps are kept" in said.err
    assert command(*SMALL, "--out", tmp_path).code == 0
    assert_same_flight(tmp_path, uninterrupted)


@pytest.mark.parametrize("asked", [True, False])
def test_what_an_interrupt_became_ends_as_an_interrupt(
    asked: bool, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        if asked:
            with contextlib.suppress(KeyboardInterrupt):
                signal.raise_signal(signal.SIGTERM)
        raise NotImplementedError("Wrong number or type of arguments")

    monkeypatch.setattr(listing_module, "listing", broken)
    before = [signal.getsignal(number) for number in SIGNALS]
    said = command("list")
    assert said.code == (130 if asked else 1)
    assert ("interrupted" in said.err) is asked
    assert [signal.getsignal(number) for number in SIGNALS] == before


# --- real signals

# The command line, which tells of every step at once.
# It waits after each line, so that a signal finds it at work however busy the machine.
TALKATIVE = """
import sys, time
from swarmstart.cases.commands.front import cli
from swarmstart.cases.commands import terminal
def tell_and_wait(text, tell=terminal.tell):
    tell(text)
    time.sleep(0.1)
terminal.QUIET_S = terminal.LINE_EVERY_S = 0.0
terminal.tell = tell_and_wait
sys.exit(cli.main())
"""

# An interrupt within the execution of a text, as on the way of an import, for which
# Python would end the process by SIGINT.
WITHIN_A_TEXT = """
import sys
from swarmstart.cases.commands.front import cli
from swarmstart.cases.commands.actions import listing
def interrupted(*arguments, **options):
    exec("raise KeyboardInterrupt")
listing.list_command = interrupted
sys.exit(cli.program())
"""

# The command line, sent SIGINT while IPOPT solves for the twelfth time: in step 3.
INSIDE_IPOPT = """
import os, signal, sys, time
from swarmstart.cases.commands.front import cli
from swarmstart.ocp.nlp.polish import Polisher
solve, calls = Polisher._solve, []
def signalled(self, *arguments, **options):
    calls.append(self)
    if len(calls) == 12 and os.fork() == 0:
        time.sleep(0.004)
        os.kill(os.getppid(), signal.SIGINT)
        os._exit(0)
    return solve(self, *arguments, **options)
Polisher._solve = signalled
sys.exit(cli.main())
"""


def started(program: str, *arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", program, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )


def finished(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Return a command's exit code and its output; never leave it running."""
    try:
        out, err = process.communicate(timeout=60)
    finally:
        if process.poll() is None:
            process.kill()
            process.communicate()
    return process.returncode, out, err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_keeps_the_steps_and_the_same_command_goes_on(
    number: int, command: Command, tmp_path: Path
) -> None:
    if signal.getsignal(number) is signal.SIG_IGN:
        pytest.skip("the tests ignore it (nohup), so commands do too")
    folder, whole = tmp_path / "interrupted", tmp_path / "whole"
    process = started(TALKATIVE, *SLOW, "--out", folder)
    assert process.stderr is not None
    while "step 2 of" not in (line := process.stderr.readline()):
        assert line, "the command has ended"
    os.kill(process.pid, number)
    code, out, err = finished(process)
    assert (code, out) == (130, "")
    assert "Traceback" not in err
    assert f"finished steps are kept in {folder}" in err
    kept = json.loads((folder / "partial.json").read_text())["steps"]
    assert 2 <= kept < STEPS and not (folder / "run.json").exists()
    assert command(*SLOW, "--out", folder).code == 0
    assert command(*SLOW, "--out", whole).code == 0
    assert_same_flight(folder, whole)


def test_an_interrupt_within_an_import_has_its_exit_code() -> None:
    code, out, err = finished(started(WITHIN_A_TEXT, "list"))
    assert (code, out, err) == (130, "", "swarmstart: interrupted\n")


def test_ctrl_c_inside_ipopt_is_not_swallowed(command: Command, tmp_path: Path) -> None:
    folder, whole = tmp_path / "interrupted", tmp_path / "whole"
    code, out, err = finished(started(INSIDE_IPOPT, *SOLVER, "--out", folder))
    assert (code, out) == (130, "")
    assert "Traceback" not in err
    assert "swarmstart: interrupted: 2 finished steps are kept in" in err
    assert command(*SOLVER, "--out", folder).code == 0
    assert command(*SOLVER, "--out", whole).code == 0
    assert_same_flight(folder, whole)


def test_a_polished_run_goes_on_with_the_multipliers_of_its_last_plans(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = ("run", "formation_obstacle", "--search", "none", "--polish", "ipopt",
           "--set", "steps=5", "--quiet", "--no-figures", "--out")  # fmt: skip
    assert command(*run, tmp_path / "whole").code == 0
    with monkeypatch.context() as patched:
        patched.setattr(run_module, "fly", interrupted_after(2))
        for _ in range(2):
            assert command(*run, tmp_path / "again").code == 130
    assert command(*run, tmp_path / "again").code == 0
    assert_same_flight(tmp_path / "again", tmp_path / "whole")
