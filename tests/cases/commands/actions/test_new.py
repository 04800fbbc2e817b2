"""`new`: files that run as they are, under a name that a scenario can have."""

import argparse
import re
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

from swarmstart.cases.commands.actions.checking import check
from swarmstart.cases.commands.actions.new import (
    InvalidNameError,
    NoTemplateError,
    new_command,
    new_files,
)
from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.format.registry import KINDS, words_of
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.problem.stated.parts import Prediction
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.record.files import RecordError

TEMPLATES = files("swarmstart.cases.kinds.problem.stated") / "templates"


def asked(name: object, *, kind: str = "problem", force: bool = False) -> int:
    options = argparse.Namespace(name=str(name), kind=kind, force=force)
    return new_command(options)


def test_a_new_problem_is_valid_and_solved_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert asked(tmp_path / "mine") == 0
    file = tmp_path / "mine.yaml"
    assert capsys.readouterr().out.splitlines() == [
        f"Wrote {file}. Next:",
        f"  swarmstart check {file}",
        f"  swarmstart run {file}",
    ]
    words = ["run", str(file), "--no-figures", "-q", "--out", str(tmp_path / "r")]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "Drive round a disc (mine): one plan of 6 s in 30 intervals" in said
    assert "a local optimum, confirmed" in said and "Claims: 1 holds." in said


def optional_lines() -> list[str]:
    lines = (TEMPLATES / "problem.yaml").read_text(encoding="utf-8").splitlines()
    begin = lines.index("kind: problem")
    keys = ("#   ", "# - {", "  # ")
    return [
        line
        for line in lines[begin:]
        if line.startswith(("# ", *keys)) and _is_entry(line)
    ]


def _is_entry(line: str) -> bool:
    text = line.strip().removeprefix("# ")
    known = {*ProblemScenario.model_fields, *Prediction.model_fields}
    return text.startswith("- {") or text.partition(": ")[0] in known


@pytest.mark.parametrize("line", optional_lines())
def test_each_optional_key_of_the_template_is_valid_if_it_is_used(
    line: str, tmp_path: Path
) -> None:
    text = (TEMPLATES / "problem.yaml").read_text(encoding="utf-8")
    used = line.replace("# ", "", 1) if not line.startswith("# -") else f"  {line[2:]}"
    file = tmp_path / "mine.yaml"
    file.write_text(text.replace(line, used, 1))
    resolve(read_document(str(file)))


def test_the_template_has_many_optional_keys() -> None:
    keys = {line.strip("# ").partition(":")[0] for line in optional_lines()}
    assert {"signals", "guess", "plant", "search", "feedback", "checks"} <= keys


def test_a_new_python_problem_is_valid_and_its_file_is_not_run(tmp_path: Path) -> None:
    assert asked(tmp_path / "mine.yml", kind="python") == 0
    assert check(str(tmp_path / "mine.yml")).endswith("mine.py was not run")
    spaces: dict[str, Any] = {}
    exec((tmp_path / "mine.py").read_text(), spaces)
    problem, x0 = spaces["build"](9.81)
    assert problem.model.nx == len(x0) == 2


def test_a_new_formation_flight_is_valid(tmp_path: Path) -> None:
    assert asked(tmp_path / "mine", kind="formation_flight") == 0
    assert check(str(tmp_path / "mine.yaml")).endswith("mine.yaml: valid")
    text = (tmp_path / "mine.yaml").read_text()
    assert "NAME" not in text
    optional = re.findall(r"^# ((?:polish|planning_order): .*)$", text, re.MULTILINE)
    assert len(optional) == 2
    used = tmp_path / "used.yaml"
    used.write_text("\n".join([text, *optional]))
    resolve(read_document(str(used)))


@pytest.mark.parametrize("kind", [k for k in KINDS if not words_of(k).templates])
def test_each_kind_has_a_template_or_a_scenario_to_start_from(kind: str) -> None:
    with pytest.raises(NoTemplateError, match=r"--print-config > NAME\.yaml") as caught:
        new_files("mine", kind=kind)
    name = str(caught.value).split("swarmstart run ")[1].split()[0]
    assert read_document(name).data["kind"] == kind


def test_an_existing_file_is_kept_unless_it_is_forced(tmp_path: Path) -> None:
    for name in ("mine.yaml", "other.py"):
        (tmp_path / name).write_text("mine")
    with pytest.raises(RecordError, match="expected a new file, found one"):
        asked(tmp_path / "mine")
    with pytest.raises(RecordError, match=r"other\.py: expected a new file"):
        asked(tmp_path / "other", kind="python")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["mine.yaml", "other.py"]
    assert asked(tmp_path / "mine", force=True) == 0
    assert "kind: problem" in (tmp_path / "mine.yaml").read_text()


@pytest.mark.parametrize(
    "name",
    [
        "",
        ".",
        "..",
        "a/",
        "a b",
        "a.txt",
        "\x1b[2J",
        "a\0b",
        "x" * 5000,
        "-a",
        "\u017c",
    ],
)
def test_a_name_that_no_scenario_can_have_is_refused(name: str) -> None:
    with pytest.raises(InvalidNameError, match="expected NAME of letters"):
        new_files(name, kind="problem")


def test_a_shipped_name_and_a_missing_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidNameError, match="no shipped scenario has"):
        new_files("pendulum", kind="problem")
    with pytest.raises(RecordError, match="there is no such folder"):
        asked(tmp_path / "away" / "mine")
    assert not (tmp_path / "away").exists()
