"""Help of every command: complete, with examples that parse, within 80 columns."""

import argparse
import re
import shlex
from pkgutil import resolve_name

import pytest

from swarmstart.cases.commands.front.options import OPTIONS, TOPICS
from swarmstart.cases.commands.front.parser import (
    SUBCOMMANDS,
    parser,
    subcommands,
)


@pytest.mark.parametrize("name", [*SUBCOMMANDS])
def test_help_fits_80_columns_and_has_an_example(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    text = subcommands()[name].format_help()
    assert max(map(len, text.splitlines())) <= 80
    assert f"  swarmstart {name}" in text or f"  bash   swarmstart {name}" in text


def test_help_of_the_program_fits_80_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert max(map(len, parser().format_help().splitlines())) <= 80


def examples() -> list[str]:
    texts = [parser().epilog or "", *(one.epilog for one in SUBCOMMANDS.values())]
    lines = [line for text in texts for line in text.splitlines()]
    found = [re.match(r"  swarmstart (.*?)(?:  .*)?$", line) for line in lines]
    return [one[1] for one in found if one and not one[1].startswith("COMMAND")]


@pytest.mark.parametrize("words", examples())
def test_an_example_of_a_help_text_is_valid(words: str) -> None:
    parsed = parser().parse_args(shlex.split(re.sub(r" > [\w.]+$", "", words)))
    assert callable(resolve_name(parsed.command))


def test_every_option_is_explained_and_says_its_default() -> None:
    """A flag is off by default, and a required word has none."""
    for name, command in subcommands().items():
        for action in command._actions:
            assert action.help, (name, action)
            takes = action.option_strings and action.nargs != 0
            repeatable = isinstance(action, argparse._AppendAction)
            if takes and not repeatable and action.dest != "fail_on":
                says = "default" in action.help or action.dest in ("seeds", "scheduler")
                assert says, (name, action.dest)


@pytest.mark.parametrize("words", [
    "run a -q", "compare a -q", "replicate -q", "report a -q",
])  # fmt: skip
def test_commands_with_records_take_quiet(words: str) -> None:
    assert parser().parse_args(shlex.split(words)).quiet


def test_topics_of_the_list_are_in_its_help() -> None:
    text = subcommands()["list"].format_help()
    assert all(topic in text for topic in TOPICS)


def test_table_of_options_has_every_command() -> None:
    assert [*OPTIONS] == [*SUBCOMMANDS]
