"""The tutorial's commands run as they stand, and its figures are there."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from swarmstart.tests.examples.shell import (
    ROOT,
    TUTORIAL,
    Terminal,
    blocks,
    commands,
    save_files,
)

if not TUTORIAL.is_dir():
    pytest.skip("there are no such files beside the tests", allow_module_level=True)
INDEX = TUTORIAL / "index.md"
PAGES = [path for path in sorted(TUTORIAL.glob("*.md")) if path != INDEX]
LARGEST_FIGURE = 150_000
"""Size of a figure [bytes]."""


@pytest.fixture
def terminal(tmp_path: Path) -> Terminal:
    return Terminal(tmp_path)


def test_index_names_every_page_in_the_order_of_its_number() -> None:
    listed = re.findall(r"\| \[(\d)\. .*?\]\((\w+\.md)\)", INDEX.read_text("utf-8"))
    assert [number for number, _ in listed] == list("123456")
    assert sorted(name for _, name in listed) == [page.name for page in PAGES]
    for number, name in listed:
        assert (TUTORIAL / name).read_text("utf-8").startswith(f"# {number}. ")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_page_says_what_one_learns_shows_a_figure_and_what_to_try(page: Path) -> None:
    text = page.read_text("utf-8")
    assert text.splitlines()[2].startswith("You will learn ")
    assert "\n## Try next\n" in text
    shown = re.findall(r"^!\[.{20,}\]\((\w+\.png)\)$", text, re.MULTILINE)
    assert shown
    for figure in shown:
        assert (TUTORIAL / figure).stat().st_size < LARGEST_FIGURE


def test_page_shows_every_line_of_an_answer() -> None:
    text = (TUTORIAL / "swing_up.md").read_text("utf-8")
    (shown,) = re.findall(r"```text\n(Solution: .*?)```", text, re.DOTALL)
    names: dict[str, object] = {}
    for block in blocks(TUTORIAL / "swing_up.md", "python")[:4]:
        exec(block, names)
    found = repr(names["solution"])
    labels = [re.findall(r"^(?:Solution:|  \w+)", t, re.M) for t in (shown, found)]
    assert labels[0] == labels[1]
    assert shown.splitlines()[0] == found.splitlines()[0]


def test_commands_that_write_and_check_files_run(terminal: Terminal) -> None:
    page = TUTORIAL / "own_file.md"
    save_files(page, terminal.folder)
    short = [c for c in commands(page) if c.split()[1] in {"new", "check"}]
    assert [c.split()[1] for c in short] == ["new", "check", "check"]
    for command in short:
        said = terminal(command)
    assert "vehicle.yaml: valid" in said


def test_commands_of_the_file_and_of_the_comparison_run(terminal: Terminal) -> None:
    said = {}
    for name in ("own_file", "compare"):
        save_files(TUTORIAL / f"{name}.md", terminal.folder)
        for command in commands(TUTORIAL / f"{name}.md"):
            said[command] = terminal(command)
    (read,) = [c for c in said if c.startswith("python -c")]
    fast, slow = (float(word) for word in said[read].split())
    text = (TUTORIAL / "own_file.md").read_text("utf-8")
    run = next(said[c] for c in said if c.endswith("vehicle.yaml --out vehicle"))
    (shown,) = re.findall(r"^`run` says.*\n\n((?:    .+\n)+)", text, re.M)
    for line in shown.splitlines():
        certain = 1 if re.match(" *(Solved|Picture)", line) else 4  # Words.
        start = " ".join(line.split()[:certain])
        assert any(found.startswith(start) for found in run.splitlines()), start
    assert f"to {fast:.2f}, with 12 s it falls to {slow:.2f}" in text
    table = (TUTORIAL / "compare.md").read_text("utf-8")
    (shown,) = re.findall(r"```text\n(vehicle\n.*?)```", table, re.DOTALL)
    compared = next(iter(said[c] for c in said if c.startswith("swarmstart compare")))
    found = compared[compared.index("vehicle\n") :].splitlines()
    for line, own in zip(shown.splitlines(), found, strict=False):
        require_alike(own, line)


def require_alike(found: str, shown: str) -> None:
    """Raise unless two lines of a table have the same words.

    Evaluations depend on the last bits of a machine, and with them which of two equal
    costs is lower; so they are compared within a tenth, and p if it shows something.
    """
    columns = [re.split(r"\s{2,}", line.strip()) for line in (found, shown)]
    for own, theirs in zip(*columns, strict=True):
        if theirs.startswith("no difference shown"):
            assert own.startswith("no difference shown")
        elif own.replace(".", "").isdigit() and float(theirs) > 100:
            assert float(own) == pytest.approx(float(theirs), rel=0.1)
        else:
            assert own == theirs


def test_error_that_is_shown_is_what_check_says(terminal: Terminal) -> None:
    page = TUTORIAL / "own_file.md"
    save_files(page, terminal.folder)
    file = terminal.folder / "vehicle.yaml"
    wrong = file.read_text("utf-8").replace("rate: vx,", "rate: vxx,", 1)
    file.write_text(wrong, encoding="utf-8")
    said = terminal("swarmstart check vehicle.yaml 2>&1 || true")
    (shown,) = re.findall(r"^    (vehicle\.yaml:.*)$", page.read_text("utf-8"), re.M)
    assert shown in said


def test_certificate_is_checked_by_the_command(terminal: Terminal) -> None:
    pytest.importorskip("flint")
    page = TUTORIAL / "terminal_set.md"
    (terminal.folder / "page.py").write_text("\n".join(blocks(page, "python")))
    terminal("MPLBACKEND=agg python page.py")
    (command,) = commands(page)
    assert "    " + terminal(command).splitlines()[-1] in page.read_text("utf-8")


def test_installation_of_the_index_works_in_a_fresh_clone(tmp_path: Path) -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("only a clone can be cloned")
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "-q", str(ROOT), str(clone)], check=True)
    script = "\n".join(["set -e", *blocks(INDEX, "sh"), "cd /", "swarmstart --version"])
    done = subprocess.run(
        ["/bin/sh", "-c", script],
        cwd=clone,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
