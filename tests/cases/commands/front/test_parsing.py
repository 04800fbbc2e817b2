"""Errors of the command line: the usage of the command that is wrong, and a hint."""

import argparse

import pytest

from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.commands.front.parsing import count, seed, share
from swarmstart.cases.commands.terminal import INVALID


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    with pytest.raises(SystemExit) as left:
        main(list(words))
    said = capsys.readouterr()
    assert (left.value.code, said.out) == (INVALID, "")
    return said.err


@pytest.mark.parametrize(
    ("words", "usage", "hint"),
    [
        (["rnu"], "usage: swarmstart COMMAND ", "did you mean 'run'?"),
        (["pendulum"], "usage: swarmstart COMMAND ", "did you mean 'run pendulum'?"),
        (["./a.yaml"], "usage: swarmstart COMMAND ", "did you mean 'run ./a.yaml'?"),
        (["run", "a", "--serch", "x"], "usage: swarmstart run ", "mean '--search'?"),
        (["run", "a", "--outt=x"], "usage: swarmstart run ", "mean '--out'?"),
        (["run", "a", "--search", "shade"], "usage: swarmstart run ", "'lshade'?"),
        (["list", "--kind", "problemx"], "usage: swarmstart list ", "'problem'?"),
        (["schema", "transferx"], "usage: swarmstart schema ", "mean 'transfer'?"),
        (["new", "a", "--kind", "pythonx"], "usage: swarmstart new ", "'python'?"),
        (["completion", "bsh"], "usage: swarmstart completion ", "mean 'bash'?"),
        (["check", "a", "--zzz"], "usage: swarmstart check ", "check --help"),
    ],
)
def test_a_mistyped_word_is_answered_by_its_command_with_a_suggestion(
    words: list[str], usage: str, hint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(capsys, *words)
    error, typed = said.splitlines()
    assert typed.startswith(usage)
    assert typed.endswith(" --help")
    assert hint in error
    assert error.find("expected one of") in (-1, error.find(hint) + len(hint) + 1)


def test_long_words_and_control_characters_are_shortened_and_escaped(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for words in (["x" * 5000], ["\x1b[2J"], ["run", "a", "--" + "x" * 5000]):
        said = refused(capsys, *words)
        assert len(said) < 1500 and "\x1b" not in said


@pytest.mark.parametrize("text", ["0", "-1", "1.5", "10001", "²", "9" * 5000])
def test_a_count_is_a_whole_number_from_1(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="whole number from 1 to"):
        count(text)


@pytest.mark.parametrize("text", ["-1", "1.5", "1" * 19, "x"])
def test_a_seed_is_a_whole_number_from_0(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="whole number from 0 to"):
        seed(text)


@pytest.mark.parametrize("text", ["100%", "1", "-1%", "x", "nan"])
def test_a_share_is_below_one(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="a part such as 10%"):
        share(text)


def test_numbers_are_taken() -> None:
    assert (count("3"), seed("0"), share("10%"), share("0.1")) == (3, 0, 0.1, 0.1)
