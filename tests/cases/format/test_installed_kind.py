"""A kind of another package: one folder and one entry point."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

import swarmstart
from swarmstart.tests.processes import announced, installed_beside, python

ROOT = Path(swarmstart.__file__).parent
KIND = ROOT / "cases" / "kinds" / "transfer"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A package `gate_course` with a copy of a kind under its own name."""
    root = tmp_path_factory.mktemp("installed")
    shutil.copytree(
        KIND, root / "gate_course", ignore=shutil.ignore_patterns("__pycache__")
    )
    for file in (root / "gate_course").glob("*.py"):
        text = file.read_text(encoding="utf-8")
        text = text.replace("swarmstart.cases.kinds.transfer", "gate_course")
        text = text.replace('Literal["transfer"]', 'Literal["gate_course"]')
        text = text.replace("UAVs that change places", "UAVs that pass gates")
        file.write_text(text, encoding="utf-8")
    (root / "gate_course" / "templates").mkdir()
    names = root / "gate_course" / "names.py"
    text = names.read_text(encoding="utf-8")
    assert 'example="swap_5"' in text
    template = 'templates={"gate_course.yaml": ""}'
    names.write_text(text.replace('example="swap_5"', template), encoding="utf-8")
    scenario = (ROOT / "cases" / "scenarios" / "swap_5.yaml").read_text("utf-8")
    own = scenario.replace("kind: transfer", "kind: gate_course")
    assert own != scenario
    (root / "gate_course" / "templates" / "gate_course.yaml").write_text(
        own.replace("name: swap_5", "name: NAME"), encoding="utf-8"
    )
    announced(
        root,
        "gate_course",
        "[swarmstart.kinds]\ngate_course = gate_course.names:WORDS\n",
    )
    return root


def command(folder: Path, *arguments: str) -> str:
    """Return what a command prints, run in the folder with the package on the path."""
    beside = installed_beside(folder)
    done = python("-m", "swarmstart", *arguments, root=folder, variables=beside)
    return done.stdout


def test_the_kind_is_listed_with_its_measures(folder: Path) -> None:
    kinds = json.loads(command(folder, "list", "kinds", "--json"))["kinds"]
    assert kinds["gate_course"]["title"] == "UAVs that pass gates without a collision"
    measures = command(folder, "list", "measures", "--kind", "gate_course")
    assert "goal_error_m" in measures


def test_a_scenario_of_it_begins_runs_and_is_reported(folder: Path) -> None:
    command(folder, "new", "gates", "--kind", "gate_course")
    polished = ["--search", "none", "--polish", "ipopt"]
    said = command(folder, "run", "gates.yaml", *polished, "--out", "run")
    assert "flight of 5 UAVs" in said and "m of its goal" in said
    assert (folder / "run" / "figures" / "a_sheet.png").is_file()
    command(folder, "report", "run")
    page = (folder / "run" / "report.html").read_text(encoding="utf-8")
    assert "crosses: the goals" in page and "cost, integrated ten times finer" in page


def test_a_kind_may_not_replace_one_of_this_package(folder: Path) -> None:
    info = folder / "gate_course-1.0.dist-info" / "entry_points.txt"
    before = info.read_text()
    info.write_text(before + "transfer = gate_course.names:WORDS\n")
    kinds = json.loads(command(folder, "list", "kinds", "--json"))["kinds"]
    info.write_text(before)
    assert kinds["transfer"]["title"] == "UAVs that change places without a collision"
