"""Progress on standard error: lines without a terminal, silence at first.

Calls of the library show it by default, on a terminal and in a notebook.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest

from swarmstart import compare, run
from swarmstart.cases.commands import terminal
from swarmstart.cases.commands.terminal import Progress
from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    Planner,
    Plant,
    RecedingHorizon,
    Solution,
    simulate,
    solve,
)
from swarmstart.ocp.common import hidden, shown


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(terminal, "QUIET_S", 0.0)
    monkeypatch.setattr(terminal, "LINE_EVERY_S", 0.0)


def test_a_line_says_what_is_done_and_how_far_it_is(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with Progress("swing-up") as shown:
        shown.update(300, 2000, "searching")
        shown.update(0, 0, "polishing")
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["swing-up: searching, step 300 of 2000", "swing-up: polishing"]


def test_what_is_counted_has_its_name_and_nothing_done_is_not_counted(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with Progress("slow", of="run") as shown:
        shown.update(0, 3, "drawing")
        shown.update(1, 3, "seed 0")
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["slow: drawing", "slow: seed 0, run 1 of 3"]


def test_a_bar_takes_work_of_a_length_that_cannot_be_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(terminal, "fancy", lambda: True)
    with Progress("swing-up") as shown:
        shown.update(300, 2000, "searching")
        shown.update(0, 0, "polishing")
        shown.update(1, 2, "verifying")


def test_nothing_is_said_of_short_work(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(terminal, "QUIET_S", 60.0)
    with Progress("swing-up") as shown:
        shown.update(1, 2, "searching")
    assert capsys.readouterr().err == ""


class Terminal(io.StringIO):
    """Standard error that is a terminal."""

    def isatty(self) -> bool:
        return True


class OfNotebook(io.StringIO):
    """Standard error that a notebook shows."""


OfNotebook.__module__ = "ipykernel.iostream"


class Timer:
    """A timer that a test lets run out."""

    made: ClassVar[list[Timer]] = []

    def __init__(self, seconds: float, act: Callable[[], None]) -> None:
        self.seconds, self.act, self.state = seconds, act, "made"
        self.daemon = False
        self.made.append(self)

    def start(self) -> None:
        self.state = "started"

    def cancel(self) -> None:
        self.state = "cancelled"


@pytest.fixture
def timers(monkeypatch: pytest.MonkeyPatch) -> list[Timer]:
    """All timers of the test, and a clock that shows nothing by itself."""
    monkeypatch.delenv("CI", raising=False)
    monkeypatch.setattr(terminal, "QUIET_S", 2.0)
    monkeypatch.setattr("threading.Timer", Timer)
    Timer.made = []
    return Timer.made


Solved = Callable[..., object]


def solved(**options: Any) -> object:
    """Solve a short problem."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4,
        stage_cost=u**2, bounds=Bounds(controls=(-2, 2)), terminal=[(x, 1)],
    )  # fmt: skip
    return solve(problem, [0.0], budget=400, lanes=0, seed=0, **options)


def simulated(**options: Any) -> object:
    """Simulate two steps."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4,
        stage_cost=u**2 + x**2, bounds=Bounds(controls=(-2, 2)),
    )  # fmt: skip
    planner = Planner(problem, search=None, polish=IpoptOptions())
    plant = Plant(problem.model, dt=0.25, substeps=1)
    loop = RecedingHorizon(planner=planner)
    return simulate(plant, loop, [1.0], steps=2, seed=0, **options)


def compared(**options: Any) -> object:
    """Compare two solvers."""
    return compare("double_integrator", "ipopt", seeds=1, budget=400, **options)


def ran(**options: Any) -> object:
    """Run a scenario."""
    return run("double_integrator", seed=0, search="none", **options)


CALLS = pytest.mark.parametrize("call", [solved, simulated, compared, ran])


@CALLS
def test_calls_of_the_library_show_what_is_done_after_two_seconds(
    call: Solved, timers: list[Timer], monkeypatch: pytest.MonkeyPatch
) -> None:
    stream, shown = Terminal(), list[str]()

    def draw(self: Progress, done: int, total: int, what: str) -> None:
        del self, done, total
        shown.append(what)

    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(Progress, "_draw", draw)
    call()
    (timer,) = timers
    assert timer.seconds == 2.0 and timer.daemon and timer.state == "cancelled"
    assert stream.getvalue() == "" and not shown  # It did not take two seconds.
    timer.act()
    assert not shown  # It is over.
    monkeypatch.setattr(terminal, "QUIET_S", 0.0)
    call()
    assert shown and stream.getvalue() == ""


def test_work_that_reports_nothing_is_shown_by_the_timer(
    timers: list[Timer], monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = OfNotebook()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(terminal, "REWRITTEN_EVERY_S", 0.0)
    with shown(True, "solve", "compiling") as told:
        assert stream.getvalue() == ""
        timers[0].act()
        assert stream.getvalue() == "\rsolve: compiling"
        told(300, 1200, "searching")  # Less than two seconds after its beginning.
        assert stream.getvalue() == "\rsolve: compiling"
        timers[0].act()
    # A line over the other one, and nothing at the end.
    told_lines = stream.getvalue().split("\r")
    assert told_lines[-2:] == [" " * len(told_lines[-3]), ""]


def test_a_notebook_sees_one_line_that_is_rewritten(
    timers: list[Timer], monkeypatch: pytest.MonkeyPatch
) -> None:
    del timers
    stream = OfNotebook()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(terminal, "QUIET_S", 0.0)
    monkeypatch.setattr(terminal, "REWRITTEN_EVERY_S", 0.0)
    with shown(True, "solve", "compiling") as told:
        told(480, 1200, "searching")
        told(0, 0, "polishing")
    searching = "solve: searching, 40 % of 1200"
    polishing = "solve: polishing".ljust(len(searching))
    blank = " " * len("solve: polishing")
    assert stream.getvalue() == (
        f"\rsolve: compiling\r{searching}\r{polishing}\r{blank}\r"
    )


@CALLS
@pytest.mark.parametrize("stream", [io.StringIO, None])
def test_nothing_is_shown_in_files_and_pipes(
    call: Solved,
    stream: type[io.StringIO] | None,
    timers: list[Timer],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "stderr", None if stream is None else stream())
    call()
    assert not timers


@CALLS
def test_progress_can_be_silenced(
    call: Solved, timers: list[Timer], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    call(progress=False)
    assert not timers
    monkeypatch.setenv("CI", "1")
    call()
    assert not timers


def test_progress_is_shown_once(
    timers: list[Timer], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    # Of the command line, a call in a call, and of a process for cells.
    for quiet in (True, False):
        with Progress("a command", quiet=quiet):
            solved()
    with shown(True, "outer", "working"):
        solved()
        assert len(timers) == 1
    with hidden():
        solved()
    assert len(timers) == 1
    solved()
    assert len(timers) == 2


def test_progress_ends_with_an_error(
    timers: list[Timer], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    with pytest.raises(InvalidProblemError, match="shape"):
        solved(guess=[[1.0, 2.0]])
    assert timers[0].state == "cancelled"
    solved()
    assert len(timers) == 2  # The next call may show its own.


def test_showing_changes_no_result(
    timers: list[Timer], monkeypatch: pytest.MonkeyPatch
) -> None:
    del timers
    silent = solved(progress=False)
    monkeypatch.setattr(terminal, "QUIET_S", 0.0)
    monkeypatch.setattr(sys, "stderr", OfNotebook())
    seen = solved()
    assert isinstance(silent, Solution) and isinstance(seen, Solution)
    assert silent.cost == seen.cost
    np.testing.assert_array_equal(silent.controls, seen.controls)


@pytest.mark.parametrize("given", ["yes", 1, None])
def test_progress_is_a_function_or_a_flag(given: object) -> None:
    with pytest.raises(InvalidProblemError, match="progress must be True or False"):
        solved(progress=given)
