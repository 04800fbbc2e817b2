"""Completion scripts: names of commands, options, scenarios and searches."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.commands.front.completion import script
from swarmstart.cases.commands.front.options import SHELLS
from swarmstart.cases.commands.front.parser import parser
from swarmstart.errors import MissingPackageError

pytest.importorskip("shtab")

TRY = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1))
_shtab_swarmstart "$@"
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.mark.parametrize("shell", SHELLS)
def test_a_script_names_scenarios_and_searches(
    shell: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["completion", shell]) == 0
    said = capsys.readouterr().out
    assert all(
        word in said for word in ("pendulum", "lshade", "completion", "polishes")
    )


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("ru", "run"),
        ("run pend", "pendulum pendulum_on_cart"),
        ("run pendulum --search ls", "lshade"),
        ("run pendulum --no-f", "--no-figures"),
        ("list me", "measures"),
        ("completion z", "zsh"),
    ],
)
def test_bash_completes(typed: str, completed: str, tmp_path: Path) -> None:
    file = tmp_path / "completion.bash"
    file.write_text(script(parser(), "bash"))
    words = ["bash", "-c", TRY, "bash", str(file), "swarmstart", *typed.split()]
    done = subprocess.run(
        words, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.stdout.split() == completed.split(), done.stderr


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_a_shell_can_read_its_script(shell: str, tmp_path: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    file = tmp_path / "completion"
    file.write_text(script(parser(), shell))
    subprocess.run([shell, "-n", str(file)], check=True)


def test_without_shtab_one_sentence_says_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    with pytest.raises(MissingPackageError):
        script(parser(), "bash")
    assert main(["completion", "bash"]) == 2
    said = capsys.readouterr()
    assert (said.out, said.err.count("\n")) == ("", 1)
    assert (
        "pip install 'swarmstart[completion]' (in a clone: pip install '.[" in said.err
    )
