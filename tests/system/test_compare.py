"""The command `compare`, as a user types it."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from swarmstart.cases.campaign.judging.results_table import COLUMNS

if TYPE_CHECKING:
    from swarmstart.tests.system.conftest import Command

SMALL = (
    *("compare", "van_der_pol", "--solvers", "lshade+ipopt,de,ipopt"),
    *("--seeds", "2", "--budget", "600evals", "--quiet"),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("comparison")


def test_the_table_and_the_runs_are_there(folder: Path, command: Command) -> None:
    said = command(*SMALL, "--out", folder)
    assert said.code == 0
    lines = said.out.splitlines()
    assert lines[0] == (
        "budget of 600 evaluations for each planning problem, seeds 0 to 1"
    )
    cold = next(line for line in lines if line.startswith("  ipopt "))
    assert "1 of 1" in cold and "one run" in cold and "2.86937" in cold
    with (folder / "results.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == tuple(COLUMNS)
    assert [(row["solver"], row["seed"]) for row in rows] == [
        ("lshade+ipopt", "0"), ("lshade+ipopt", "1"), ("de", "0"), ("de", "1"),
        ("ipopt", "0"), ("repeated-ipopt", "0"), ("repeated-ipopt", "1"),
    ]  # fmt: skip
    for row in rows:
        assert row["failure"] == ""
        assert float(row["verified_cost"]) == pytest.approx(
            float(row["claimed_cost"]), rel=1e-3
        )


def test_what_is_missing_is_computed_and_the_table_is_the_same(
    folder: Path, command: Command
) -> None:
    first = command(*SMALL, "--out", folder)
    marks = sorted(folder.glob("cells/*/cell.json"))
    kept = {file: file.stat().st_mtime_ns for file in marks[1:]}
    marks[0].unlink()
    again = command(*SMALL, "--out", folder)
    assert (again.code, again.out) == (first.code, first.out)
    assert marks[0].exists()
    assert kept == {file: file.stat().st_mtime_ns for file in kept}


def test_one_worker_and_two_print_the_same(
    folder: Path, tmp_path: Path, command: Command
) -> None:
    two = command(*SMALL, "--out", folder)
    one = command(*SMALL, "--workers", "1", "--out", tmp_path)
    assert one.out.replace(str(tmp_path), "") == two.out.replace(str(folder), "")


def test_json_is_one_object(folder: Path, command: Command) -> None:
    content = json.loads(command(*SMALL, "--json", "--out", folder).out)
    assert content["schema"] == 2
    (scenario,) = content["scenarios"]
    rows = {row["solver"]: row for row in scenario["rows"]}
    assert rows["ipopt"]["deterministic"] and rows["ipopt"]["runs"] == 1
    assert rows["de"]["near_intervals"][0][0] >= 0
    assert rows["de"]["against_first"]["words"].startswith("not compared: 2 seeds")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["formation_v", "--of", "plan"], "all but one agent; found 5 that plan"),
        (
            ["passing_side", "--fail-on", "regression"],
            "expected --baseline with --fail-on regression",
        ),
        (["passing_side", "--engine", "dask"], "expected --engine dask and --sched"),
        (
            ["passing_side", "--solvers", "snopt"],
            "expected a solver: one of solve",
        ),
        (
            ["passing_side", "--solvers", "lshade[sizes=4]"],
            "did you mean 'size'?",
        ),
        (["passing_side", "--budget", "5x"], "expected a budget such as 4000evals"),
        (
            ["passing_side", "--budget", "10evals"],
            "expected at least 20, one generation",
        ),
        (["nowhere"], "expected a scenario or a path"),
        (["passing_side", "--set", "steps=0"], "expected steps to be at least 1"),
    ],
)
def test_what_cannot_be_compared_is_refused(
    arguments: list[str], said: str, command: Command, tmp_path: Path
) -> None:
    answer = command("compare", *arguments, "--out", tmp_path)
    assert answer.code == 2
    assert said in answer.err
    assert not list(tmp_path.iterdir())


def test_what_run_refuses_is_refused_before_any_work(
    command: Command, tmp_path: Path
) -> None:
    file, out = tmp_path / "late.yaml", tmp_path / "out"
    file.write_text(
        "kind: problem\nstates: {x: {start: 0, rate: u}}\n"
        "controls: {u: {bounds: [-1, 1], delay_s: 0.5}}\nstage_cost: u**2\n"
        "vehicles: {members: [{name: a}, {name: b}], planning: priority}\n"
        "prediction: {horizon_s: 1, intervals: 2}\nfeedback: receding_horizon\n"
    )
    said = command("compare", file, "--quiet", "--out", out)
    assert (said.code, said.out) == (2, "")
    assert said.err == command("run", file, "--quiet", "--out", out).err
    assert "takes no delay_s" in said.err
    assert not out.exists()


def test_a_table_of_another_program_is_refused_before_any_work(
    command: Command, tmp_path: Path
) -> None:
    (tmp_path / "results.csv").write_text("mine\n")
    said = command(*SMALL, "--out", tmp_path)
    assert (said.code, said.out) == (2, "")
    assert "expected a table of comparisons, found another file" in said.err
    assert [file.name for file in tmp_path.iterdir()] == ["results.csv"]
    assert (tmp_path / "results.csv").read_text() == "mine\n"


@pytest.mark.parametrize("more", [[], ["--dry-run"]])
def test_a_folder_of_a_run_is_refused_before_any_work(
    more: list[str], command: Command, tmp_path: Path
) -> None:
    (tmp_path / "run.json").write_text("{}")
    said = command(*SMALL, *more, "--out", tmp_path)
    assert (said.code, said.out) == (2, "")
    assert "expected an empty folder or one of comparisons, found the rec" in said.err
    assert [file.name for file in tmp_path.iterdir()] == ["run.json"]


def test_another_comparison_appends_to_the_table(
    folder: Path, command: Command
) -> None:
    before = (folder / "results.csv").read_text()
    fewer = (*SMALL[:2], "--solvers", "ipopt", *SMALL[4:], "--out", folder)
    assert command(*fewer).code == 0
    assert (folder / "results.csv").read_text() == before
    assert command(*fewer, "--budget", "700evals").code == 0
    after = (folder / "results.csv").read_text()
    # IPOPT once, and from random starts with two seeds.
    assert after.startswith(before) and after.count("\n") == before.count("\n") + 3


def test_a_comparison_of_other_things_moves_an_earlier_one_aside(
    folder: Path, command: Command
) -> None:
    command(*SMALL, "--out", folder)
    earlier = (folder / "comparison.json").read_bytes()
    before = set(folder.glob("comparison-*.json"))
    command(*SMALL, "--out", folder)  # The same again moves nothing.
    assert set(folder.glob("comparison-*.json")) == before
    command(*SMALL[:2], "--solvers", "ipopt", *SMALL[4:], "--out", folder)
    (aside,) = set(folder.glob("comparison-*.json")) - before
    assert json.loads(aside.read_text()) == json.loads(earlier)


def test_no_feasible_answer_has_an_exit_code_of_its_own(
    command: Command, tmp_path: Path
) -> None:
    """A disc on the start: every plan begins within it."""
    said = command(
        *("compare", "passing_side", "--solvers", "random", "--seeds", "1"),
        *("--budget", "40evals", "--quiet", "--out", tmp_path),
        *("--set", "avoidance.safe_distance_m=3", "--set", "obstacles.0.radius_m=55"),
    )
    assert said.code == 4
    assert "0 of 1" in said.out


def test_a_plan_in_yaml_is_what_the_options_say_and_an_option_comes_before_it(
    folder: Path, command: Command, tmp_path: Path
) -> None:
    file = tmp_path / "plan.yaml"
    file.write_text(
        "schema: 1\ncompare:\n  scenarios: [van_der_pol]\n"
        "  solvers: [lshade+ipopt, de, ipopt]\n  seeds: 5\n  budget: 600evals\n"
    )
    asked = command(*SMALL, "--out", folder)
    planned = command("compare", str(file), "--seeds", "2", "-q", "--out", folder)
    assert planned.out == asked.out
    counted = command(
        "compare", str(file), "--dry-run", "--workers", "1", "--out", folder
    )
    # Of three solvers with five seeds two are kept, and that of IPOPT.
    assert counted.out.startswith("16 runs: 7 kept, 9 to be done")
    assert counted.out.endswith(" with 1 process\n")


def test_the_same_again_is_no_regression_and_a_costlier_one_fails_the_gate(
    folder: Path, command: Command, tmp_path: Path
) -> None:
    command(*SMALL, "--out", folder)
    same = command(
        *(*SMALL, "--out", folder, "--baseline", folder, "--fail-on", "regression")
    )
    assert same.code == 0
    assert "same" in same.out
    content = json.loads((folder / "comparison.json").read_text())
    assert not content["regression"]["is_regression"]


def test_a_baseline_that_is_none_is_refused_before_any_work(
    command: Command, tmp_path: Path
) -> None:
    (tmp_path / "comparison.json").write_text('{"record": "comparison"}')
    said = command(*SMALL, "--baseline", tmp_path, "--out", tmp_path / "new")
    assert said.code == 5
    assert "comparison.json: expected a comparison" in said.err
    assert not (tmp_path / "new").exists()


def test_a_page_of_a_comparison_is_written_beside_it(
    folder: Path, command: Command
) -> None:
    command(*SMALL, "--out", folder)
    forms = ("--format", "html", "--format", "md", "--format", "latex")
    said = command("report", folder, *forms)
    assert said.code == 0
    for name in ("report.html", "report.md", "report.tex"):
        text = (folder / name).read_text(encoding="utf-8")
        assert "repeated-ipopt" in text
    assert command("report", folder / "cells").code == 5


def test_a_larger_value_of_an_earlier_run_is_the_best_known_of_what_is_maximised(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "hill.yaml"
    file.write_text(
        "kind: problem\nstates: {x: {start: 0, rate: u}}\n"
        "controls: {u: {bounds: [-1, 1]}}\nmaximize: true\n"
        "terminal_cost: 3 + x\nprediction: {horizon_s: 1, intervals: 5}\n"
    )
    assert command("run", file, "--search", "none", "--no-figures").code == 0
    said = command(
        *("compare", file, "--solvers", "random,repeated-ipopt", "--seeds", "1"),
        *("--budget", "30", "--json", "-q"),
    )
    (one,) = json.loads(said.out)["scenarios"]
    # x reaches 1, and costs are minimised in the file.
    assert one["known_cost"] == pytest.approx(-4.0, abs=1e-5)
    assert one["known_from"].startswith("an earlier run, results/hill/")
