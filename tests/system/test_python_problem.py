"""A user's file is run with --allow-code, and by no other command or file."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml

import swarmstart as ss
from swarmstart.cases.campaign.judging.runs import entry_of
from swarmstart.cases.campaign.running.finished_run import Interrupted
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.campaign.trials.solvers import solve_cell, solver_of
from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.record.record import OccupiedFolderError, Recording
from swarmstart.tests.cases.kinds.python.conftest import (
    MODEL,
    Project,
    allowed,
    project,
)
from swarmstart.tests.system.conftest import Command

__all__ = ["project"]
PAGE = Path(__file__).parents[2] / "docs" / "python_problem.md"
QUICK = ["--set", "steps=2", "--set", "feedback=receding_horizon", "--no-figures"]
COMPARED = ["--seeds", "1", "--budget", "200evals", "--solvers", "ipopt,lshade"]


def test_no_command_runs_the_file_unless_told_to(
    project: Project, command: Command, tmp_path: Path
) -> None:
    file = project.scenario
    checked = command("check", file)
    assert checked.code == 0
    assert checked.out == f"{file}: valid; {project.model} was not run\n"
    assert command("schema", "python").code == 0
    assert command("list").code == 0
    shown = command("run", file, "--print-config", "--allow-code")
    assert shown.code == 0 and "problem: my_model.py:build" in shown.out
    expected = f"swarmstart: {project.model}: expected --allow-code "
    for refused in (
        command("run", file, *QUICK, "--out", tmp_path / "out"),
        command("compare", file, *COMPARED, "--out", tmp_path / "compared"),
    ):
        assert (refused.code, refused.out) == (2, "")
        assert refused.err.startswith(expected) and refused.err.count("\n") == 1
    with pytest.raises(ss.CodeNotAllowedError):
        ss.run(file, seed=0)
    with pytest.raises(ss.CodeNotAllowedError):
        ss.compare(file, "ipopt", seeds=1)
    assert project.runs == 0


def test_a_run_says_so_and_keeps_a_copy_that_can_be_run_again(
    project: Project, command: Command, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    arguments = [*QUICK, "--allow-code", "--json", "--quiet", "--out"]
    said = command("run", project.scenario, *arguments, out)
    assert said.code == 0 and project.runs == 1
    assert said.err == (
        f"swarmstart: running {project.model}, as --allow-code allows\n"
    )
    summary = json.loads(said.out)
    assert summary["documents"] == ["my_model.py"]
    assert (out / "my_model.py").read_text() == MODEL
    recorded = yaml.safe_load((out / "scenario.yaml").read_text())
    assert recorded["problem"] == "my_model.py:build" and len(recorded["sha256"]) == 64

    again = command(
        "run", out / "scenario.yaml", "--allow-code", "--json", "-q", "--no-figures",
        "--out", tmp_path / "again",
    )  # fmt: skip
    assert again.code == 0 and project.runs == 1  # It was the copy.
    assert json.loads(again.out)["key"] == summary["key"]
    (out / "my_model.py").write_text("raise SystemExit")
    forged = command("run", out / "scenario.yaml", "--allow-code")
    assert forged.code == 2 and "the file has changed" in forged.err


def test_a_traceback_is_shown_only_with_debug(
    project: Project, command: Command, caplog: pytest.LogCaptureFixture
) -> None:
    project.model.write_text("def build(gravity):\n    return gravity / 0\n")
    said = command("run", project.scenario, "--allow-code")
    assert said.code == 2 and "found ZeroDivisionError: " in said.err
    assert "Traceback" not in said.err
    with caplog.at_level("DEBUG", logger="swarmstart"):
        main(["run", str(project.scenario), "--allow-code"])
    assert "return gravity / 0" in caplog.text


def test_an_interrupted_run_goes_on_only_with_permission_and_the_same_file(
    project: Project, tmp_path: Path
) -> None:
    changes = ("steps=3", "feedback=receding_horizon", "polish=none")
    recording = Recording(folder=tmp_path / "out", figures=False)

    def interrupt(done: int, of: int, what: str) -> None:
        if (done, what) == (2, "simulating"):
            raise KeyboardInterrupt

    resolved = allowed(project.resolved(*changes))
    with pytest.raises(Interrupted):
        run(resolved, seed=0, recording=recording, progress=interrupt)
    assert project.runs == 1
    with pytest.raises(ss.CodeNotAllowedError):
        run(project.resolved(*changes), seed=0, recording=recording)
    project.model.write_text(MODEL + "\n")
    changed = allowed(project.resolved(*changes))
    with pytest.raises(OccupiedFolderError):
        run(changed, seed=0, recording=recording)
    assert project.runs == 1
    project.model.write_text(MODEL)
    assert run(resolved, seed=0, recording=recording).resumed == 2
    assert project.runs == 2


def test_the_file_itself_is_never_written_over(
    project: Project, command: Command
) -> None:
    said = command(
        "run", project.scenario, "--allow-code", "--force", "--out", project.folder
    )
    assert said.code == 2 and "another folder than that of the file" in said.err
    assert project.model.read_text() == MODEL and project.runs == 0


def test_workers_of_compare_have_the_permission_and_keep_none(
    project: Project, command: Command, tmp_path: Path
) -> None:
    out = tmp_path / "compared"
    arguments = ["compare", project.scenario, *COMPARED, "--out", out, "-q"]
    said = command(*arguments, "--workers", "1", "--json", "--allow-code")
    assert said.code == 0
    assert said.err.count("as --allow-code allows") == 1
    [entry] = json.loads(said.out)["scenarios"]
    rows = {row["solver"]: row for row in entry["rows"]}
    assert set(rows) == {"ipopt", "lshade", "repeated-ipopt"}
    assert rows["ipopt"]["costs"] == [pytest.approx(36.7126, abs=1e-3)]
    runs = project.runs
    assert runs >= 4  # In this process, and once in a worker for each cell.
    marks = list((out / "cells").glob("*/cell.json"))
    assert len(marks) == 3
    for mark in marks:
        text = mark.read_text()
        assert "code_in" not in text and str(project.folder) not in text
        with pytest.raises(InvalidScenarioError, match="No such file"):
            solve_cell(json.loads(text)["job"], out)
    refused = command(*arguments)  # Though all is there already.
    assert refused.code == 2 and project.runs == runs


def test_a_cell_has_the_permission_of_the_present_command_alone(
    project: Project,
) -> None:
    solver = solver_of("ipopt")
    cells = [
        entry_of(
            resolved, solver, seeds=1, budget={}, timeout_s=1.0, repair=True
        ).cells[0]
        for resolved in (project.resolved(), allowed(project.resolved()))
    ]
    without, with_permission = cells
    assert without.key == with_permission.key
    assert not without.permissions
    assert with_permission.permissions == {"code_in": str(project.folder.resolve())}


def test_the_library_runs_the_file_where_the_call_allows_it(project: Project) -> None:
    finished = ss.run(project.scenario, seed=0, allow_code=True)
    assert finished.measures["final_angle"] == pytest.approx(3.14159, abs=1e-4)
    (row,) = ss.compare(project.scenario, "ipopt", seeds=1, allow_code=True)
    assert row.costs == pytest.approx([36.7126], abs=1e-3)


def test_the_files_of_the_page_give_what_it_says(
    tmp_path: Path, command: Command
) -> None:
    if not PAGE.exists():
        pytest.skip("the documentation is not beside an installed package")
    page = PAGE.read_text("utf-8")
    for language in ("python", "yaml"):
        (text,) = re.findall(rf"```{language}\n(# (\S+)\n.*?)```", page, re.DOTALL)
        (tmp_path / text[1]).write_text(text[0], "utf-8")
    cost = re.search(r"--allow-code +# cost (\S+)", page)
    assert cost is not None
    said = command(
        "run", tmp_path / "mine.yaml", "--allow-code", "--json", "--no-figures",
        "--out", tmp_path / "out",
    )  # fmt: skip
    assert said.code == 0
    assert f"{json.loads(said.out)['measures']['verified_cost']:.4f}" == cost.group(1)
