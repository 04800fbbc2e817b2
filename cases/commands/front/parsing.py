"""Parts of the command line's parser: its errors, and the types of its options."""

import argparse
import math
import textwrap
from typing import Any, NoReturn

from swarmstart.cases.commands.terminal import INVALID, answer, tell
from swarmstart.cases.format.document import meant, shown

LARGEST_COUNT = 10_000
LONGEST_SEED = 18
"""Digits of a seed, which has to fit 64 bits."""
_LISTED = 12
"""Choices that a message lists."""


class HelpFormatter(argparse.RawDescriptionHelpFormatter):
    """A layout of help: paragraphs are wrapped, texts of several lines stay as is."""

    def __init__(self, prog: str) -> None:
        """Leave room for the longest name of a command."""
        super().__init__(prog, max_help_position=26)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        """Wrap a text of one line; argparse calls this."""
        if "\n" in text:
            return super()._fill_text(text, width, indent)
        return textwrap.fill(
            text, width, initial_indent=indent, subsequent_indent=indent
        )


class Parser(argparse.ArgumentParser):
    """A parser whose help and errors go through the streams of `terminal`.

    The message of an error first asks whether a similar word was meant, if there is
    one, and then shows the usage of the command in one line.
    """

    def print_help(self, file: object = None) -> None:
        """Print the help on standard output."""
        answer(self.format_help().rstrip())

    def error(self, message: str) -> NoReturn:
        """Print error and usage on standard error, if it is open; exit with code 2."""
        tell(f"{self.prog}: error: {message}\n{self._short_usage()}")
        raise SystemExit(INVALID)

    def refuse(self, unknown: list[str]) -> NoReturn:
        """Report one or more words that no option takes; exit with code 2."""
        known = [*self._option_string_actions]
        hints = [
            meant(word.partition("=")[0], known, otherwise="")
            for word in unknown
            if word.startswith("-")
        ]
        hint = next(filter(None, hints), f"see {self.prog} --help")
        # Escaped and shortened, but without the quotes of `shown`.
        listed = shown(" ".join(unknown)).strip("'\"")
        self.error(f"unrecognized arguments: {listed}; {hint}")

    def _short_usage(self) -> str:
        """Return one line: the words that must be given, and where the options are."""
        # Words with "?" or "*" may be left out.
        words = [
            str(action.metavar or action.dest)
            for action in self._actions
            if not action.option_strings and action.nargs not in ("?", "*")
        ]
        typed = " ".join([self.prog, *words, "[options]"])
        return f"usage: {typed}; all options: {self.prog} --help"

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a value that is not among the choices; argparse calls this."""
        if action.choices is None or value in action.choices:
            return
        known = [str(choice) for choice in action.choices]
        expected = ", ".join(known[:_LISTED])
        expected += ", ..." if len(known) > _LISTED else ""
        hint = meant(str(value), known, otherwise="")
        if not hint and isinstance(action, argparse._SubParsersAction):
            hint = _as_run(str(value))
        raise argparse.ArgumentError(
            action,
            f"unknown {shown(str(value))}; {hint + ' ' if hint else ''}"
            f"expected one of {expected}",
        )


def _as_run(word: str) -> str:
    """Return a question if a scenario stands where a command is expected."""
    # Only after an error: the parser of a right command imports no YAML.
    from swarmstart.cases.format.scenario import by_name

    if word in by_name() or word.endswith((".yaml", ".yml")):
        return f"did you mean {shown(f'run {word}')}?"
    return ""


def subcommands_of(top: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return, by name, the parsers of a parser's subcommands, in their given order."""
    for action in top._actions:
        # argparse has no public way to the parsers of subcommands.
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}


def share(text: str) -> float:
    """Return a share, given as text such as 10% or 0.1, as a number below 1."""
    try:
        number = float(text.removesuffix("%"))
    except ValueError:
        number = -1.0  # Refused below.
    part = number / 100 if text.endswith("%") else number
    if not 0.0 <= part < 1.0:
        raise argparse.ArgumentTypeError(
            f"expected a part such as 10%, below 100%; found {shown(text)}"
        )
    return part


def finite(text: str) -> float:
    """Return a finite number."""
    return _finite(text, -math.inf, "a finite number")


def positive(text: str) -> float:
    """Return a finite number above 0."""
    return _finite(text, 0.0, "a finite number above 0")


def _finite(text: str, above: float, expected: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan  # Refused below.
    if not above < number < math.inf:
        raise argparse.ArgumentTypeError(f"expected {expected}, found {shown(text)}")
    return number


def count(text: str) -> int:
    """Return a whole number from 1."""
    if not _is_whole(text) or not 1 <= int(text) <= LARGEST_COUNT:
        raise argparse.ArgumentTypeError(
            f"expected a whole number from 1 to {LARGEST_COUNT}, found {shown(text)}"
        )
    return int(text)


def seed(text: str) -> int:
    """Return a seed: a whole number from 0."""
    if not _is_whole(text):
        raise argparse.ArgumentTypeError(
            f"expected a whole number from 0 to 10^18, found {shown(text)}"
        )
    return int(text)


def _is_whole(text: str) -> bool:
    # int() also reads " 1_0 ", and has an error of its own for thousands of digits.
    return text.isdecimal() and len(text) <= LONGEST_SEED
