"""The command line's options as Markdown, from its parser."""

import argparse
from collections.abc import Iterator

from swarmstart.cases.commands.front.cli import parser

WIDTH = 78
EXIT_CODES = "exit codes:"
"""Head of the last part of an epilog, which the page has as a table."""
MARKS = str.maketrans({"<": "&lt;", "*": "\\*", "_": "\\_", "[": "\\["})


def commands_page() -> str:
    """Return a section for the program and for every command."""
    return "\n".join(_sections(parser(), "", 2))


def _sections(of: argparse.ArgumentParser, about: str, level: int) -> Iterator[str]:
    yield f"{'#' * level} `{of.prog}`\n"
    description = of.description or (about[:1].upper() + about[1:] + "." * bool(about))
    yield f"{_text(description)}\n"
    formatter = _formatter(of)
    formatter.add_usage(of.usage, of._actions, of._mutually_exclusive_groups, prefix="")
    yield f"```text\n{formatter.format_help().strip()}\n```\n"
    for group in of._action_groups:
        actions = [action for action in group._group_actions if _is_shown(action)]
        if actions:
            yield f"{(group.title or 'options').capitalize()}:\n"
            for action in actions:
                yield _entry(action, of)
    examples = (of.epilog or "").partition(EXIT_CODES)[0].strip()
    if examples:
        yield f"```text\n{examples}\n```\n"
    for command, help_ in _commands(of):
        yield from _sections(command, help_, level + 1)


def _entry(action: argparse.Action, of: argparse.ArgumentParser) -> str:
    """Return an option as an entry of a definition list."""
    formatter = _formatter(of)
    shown = formatter._format_action_invocation(action)
    text = formatter._expand_help(action) if action.help else "see the usage"
    return f"`{shown}`\n: {_text(text)}\n"


def _commands(
    of: argparse.ArgumentParser,
) -> Iterator[tuple[argparse.ArgumentParser, str]]:
    """Yield the commands of a parser with their line of help."""
    for action in of._actions:
        if isinstance(action, argparse._SubParsersAction):
            helps = {
                choice.dest: choice.help or "" for choice in action._choices_actions
            }
            for name, command in action.choices.items():
                if name in helps:  # else an alias, or hidden
                    yield command, helps[name]


def _is_shown(action: argparse.Action) -> bool:
    is_of_every_command = isinstance(action, argparse._HelpAction)
    is_commands = isinstance(action, argparse._SubParsersAction)
    is_hidden = action.help == argparse.SUPPRESS
    return not (is_of_every_command or is_commands or is_hidden)


def _text(words: str) -> str:
    """Return words as Markdown: what is within backticks stays code."""
    parts = words.split("`")
    if len(parts) % 2 == 0:
        return words.translate(MARKS)
    parts[::2] = [part.translate(MARKS) for part in parts[::2]]
    return "`".join(parts)


def _formatter(of: argparse.ArgumentParser) -> argparse.HelpFormatter:
    return argparse.HelpFormatter(prog=of.prog, width=WIDTH)
