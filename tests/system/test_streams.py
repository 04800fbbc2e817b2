"""Streams that are closed, full or limited to ASCII, as a shell can give them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from swarmstart.cases.commands.terminal import AT_WORK

if TYPE_CHECKING:
    from swarmstart.tests.system.conftest import Command, Said

PROGRAM = f"'{sys.executable}' -m swarmstart"
FULL = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device of Linux")


def typed(line: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a line of a shell, in which $S is the program, without progress messages."""
    said = subprocess.run(
        ["sh", "-c", line.replace("$S", PROGRAM)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        stdin=subprocess.DEVNULL,
        env={**os.environ, **environment},
    )
    said.stderr = said.stderr.replace(f"swarmstart: {AT_WORK}\n", "")
    return said


@FULL
@pytest.mark.parametrize("arguments", ["list", "--help", "run --help", "--version"])
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_an_answer_on_a_full_device_leaves_with_5(
    arguments: str, unbuffered: str
) -> None:
    said = typed(f"$S {arguments} > /dev/full", PYTHONUNBUFFERED=unbuffered)
    assert said.returncode == 5
    assert said.stderr == (
        "swarmstart: standard output: expected to write to it: No space left on "
        "device\n"
    )


def test_an_answer_without_standard_output_leaves_with_5() -> None:
    said = typed("$S list >&-")
    assert said.returncode == 5
    assert said.stderr == (
        "swarmstart: standard output: expected to write to it: it is closed\n"
    )


@pytest.mark.parametrize(
    "stderr", ["2>&-", pytest.param("2>/dev/full", marks=FULL), "2>/dev/null"]
)
def test_an_error_is_never_said_on_standard_output(stderr: str) -> None:
    said = typed(f"$S run formation_w {stderr}")
    assert (said.returncode, said.stdout, said.stderr) == (2, "", "")
    said = typed(f"$S list --bogus {stderr}")
    assert (said.returncode, said.stdout, said.stderr) == (2, "", "")


def test_no_file_takes_the_place_of_a_closed_stream(tmp_path: Path) -> None:
    """Otherwise output of a library goes into the first file that is opened."""
    program = (
        "import os; from swarmstart.cases.commands import terminal; "
        "terminal.occupy_closed_streams(); "
        f"file = open(r'{tmp_path / 'mine'}', 'w'); os.write(1, b'printed'); "
        "os.write(2, b'printed')"
    )
    done = subprocess.run(
        ["sh", "-c", f"'{sys.executable}' -c \"{program}\" >&- 2>&-"], check=False
    )
    assert done.returncode == 0
    assert (tmp_path / "mine").read_bytes() == b""


TITLE = 'title="\u017c\\e[31m\\0\\ny"'


def test_a_title_that_a_terminal_cannot_show_is_escaped() -> None:
    line = f"$S run formation_v --print-config --set '{TITLE}'"
    said = typed(line, LC_ALL="C", PYTHONIOENCODING="ascii")
    assert (said.returncode, said.stderr) == (0, "")
    assert said.stdout.isascii() and "\x1b" not in said.stdout


def test_titles_and_claims_never_command_the_terminal(
    command: Command, tmp_path: Path
) -> None:
    claims = (
        r'claims=[{id: "\e[1m", text: "\e[2J\nforged", source: s, '
        'measure: linear_steps, relation: "<", bound: 0, when: {steps: 1}}]'
    )
    said: Said = command(
        *("run", "formation_v", "--variant", "literal", "--no-figures", "--quiet"),
        *("--set", "steps=1", "--set", "budget.evaluations=20"),
        *("--set", r'title="a\rb\u202e"', "--set", claims, "--out", tmp_path),
    )
    assert said.code == 0
    assert not {"\x1b", "\r", "\u202e"} & {*said.out, *said.err}
    assert r"\x1b[2J\nforged" in said.out
    assert said.out.startswith(r"a\rb\u202e (formation_v")


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["run", "x" * 5000], 2),
        (["run", "./" + "x" * 5000], 5),
        (["run", "a\0b"], 2),
        (["run", "./a\0b"], 5),
        (["run", "formation_v", "--out", "x" * 5000], 5),
        (["run", "formation_v", "--out", "a\0b"], 5),
        (["run", "formation_v", "--variant", "x" * 5000], 2),
        (["run", "formation_v", "--set", "x" * 5000 + "=1"], 2),
        (["compare", "passing_side", "--out", "a\0b"], 5),
        (["compare", "passing_side", "--solvers", "x" * 5000], 2),
        (["replicate", "--only", "24", "--out", "x" * 5000], 5),
        (["schema", "x" * 5000], 2),
        (["list", "x" * 5000], 2),
    ],
    ids=lambda value: " ".join(v[:12] for v in value) if type(value) is list else "",
)
def test_a_name_that_no_file_can_have_is_refused(
    arguments: list[str], code: int, command: Command
) -> None:
    said = command(*arguments)
    assert (said.code, said.out) == (code, "")
    assert "expected" in said.err and "internal error" not in said.err
