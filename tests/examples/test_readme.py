"""The README's commands, code and numbers are right."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

from swarmstart.tests.examples.shell import ROOT, Terminal, blocks, commands

README = ROOT / "README.md"
if not (ROOT / "docs").is_dir():
    pytest.skip("there are no such files beside the tests", allow_module_level=True)
MOST_LINES, MOST_WORDS, LARGEST_PICTURE = 90, 660, 2_000_000


def test_readme_is_one_screen_with_a_picture_that_moves() -> None:
    text = README.read_text("utf-8")
    assert len(text.splitlines()) <= MOST_LINES
    assert len(text.split()) <= MOST_WORDS
    (picture,) = re.findall(r"!\[.{20,}\]\(([\w/]+\.gif)\)", text)
    assert (ROOT / picture).stat().st_size < LARGEST_PICTURE


def test_code_prints_what_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    text = README.read_text("utf-8")
    (code,) = blocks(README, "python")
    (shown,) = re.findall(r"prints:\n\n```text\n(.*?)```", text, re.DOTALL)
    exec(compile(code, str(README), "exec"), {})
    assert capsys.readouterr().out == shown


def test_seconds_are_those_of_the_measured_page() -> None:
    rows = re.findall(r"^\| `(\w+)`.*?\| (.*) \|$", README.read_text("utf-8"), re.M)
    assert 4 <= len(rows) <= 6
    measured = (ROOT / "docs" / "when.md").read_text("utf-8")
    for name, cells in rows:
        (line,) = re.findall(rf"^\| {name} \(.*$", measured, re.MULTILINE)
        found = [cell.split(", ")[1].strip() for cell in line.split("|")[3:8]]
        # Seconds have no unit there, since the head of the table has it.
        found = [c if c.startswith("none") else c.removesuffix(" s") for c in found]
        assert cells.replace("*", "").split(" | ") == found


def test_share_of_problems_is_that_of_the_measured_page() -> None:
    measured = (ROOT / "docs" / "when.md").read_text("utf-8")
    (all_of, alone) = re.findall(r"Of (\d+) shipped.*?choice on (\d+)", measured)[0]
    for page in (README, ROOT / "docs" / "tutorial" / "obstacle.md"):
        assert f"{alone} of {all_of}" in " ".join(page.read_text("utf-8").split())


def test_links_lead_to_files() -> None:
    for link in re.findall(r"\]\(([^)#]+)[^)]*\)", README.read_text("utf-8")):
        assert (ROOT / link).is_file(), link


def test_commands_are_targets_of_make() -> None:
    targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text("utf-8"), re.M)
    made = [c.split() for c in commands(README) if c.startswith("make")]
    assert len(made) == 2
    assert {command[1] for command in made} <= set(targets)


def test_what_make_expands_to_is_in_the_makefile() -> None:
    makefile = (ROOT / "Makefile").read_text("utf-8").replace("$(VENV)", ".venv")
    run, test = re.findall(r"`make \w+` is\s+`([^`]+)`", README.read_text("utf-8"))
    assert f"\t{run}\n" in makefile
    program, marked = test.split(" -m pytest ")
    assert f"{program} -m pytest" in makefile
    assert f"\t$(TESTS) {marked}\n" in makefile


def test_commands_of_a_yaml_user_write_a_valid_file(tmp_path: Path) -> None:
    terminal = Terminal(tmp_path)
    own = [c for c in commands(README) if c.startswith("swarmstart")]
    assert [c.split()[1] for c in own] == ["new", "check", "run", "list"]
    terminal(own[0])
    assert "valid" in terminal(own[1])
    assert own[1].split()[2] == own[2].split()[2]


def test_commands_run_in_a_fresh_clone(tmp_path: Path) -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("only a clone can be cloned")
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "-q", str(ROOT), str(clone)], check=True)
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "MAKE"))}
    kept.pop("PYTHONPATH", None)
    # Of all tests one file, so that this test does not run them all, and itself, again.
    variables = {**kept, "PYTEST_ADDOPTS": "tests/test_long.py"}
    for script in blocks(README, "sh"):
        done = subprocess.run(
            ["/bin/sh", "-e", "-c", script],
            cwd=clone,
            env=variables,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{script}\n{done.stdout}\n{done.stderr}"
    for name in ("formation_v", "my_problem"):
        assert list(clone.glob(f"results/{name}/*/run.json"))
