"""`swarmstart completion`: a script that completes commands in a shell, by shtab."""

import argparse
import shlex

from swarmstart.cases.commands.front.options import TOPICS
from swarmstart.cases.commands.front.parsing import subcommands_of
from swarmstart.cases.commands.terminal import DONE, answer
from swarmstart.cases.format.scenario import by_name
from swarmstart.errors import load_optional


def completion_command(options: argparse.Namespace) -> int:
    """Print the script for a shell; return the exit code.

    Raises:
        MissingPackageError: If shtab is not installed.
    """
    answer(script(options.top, options.shell).rstrip())
    return DONE


def script(top: argparse.ArgumentParser, shell: str) -> str:
    """Return the script for a shell.

    Args:
        top: The parser of the command line; its actions are marked for completion.
        shell: bash, zsh or tcsh.

    Raises:
        MissingPackageError: If shtab is not installed.
    """
    shtab = load_optional("shtab", extra="completion", need="completion")
    completed = {
        "SCENARIO": _scenarios(),
        "TEXT": _scenarios(),
        "TOPIC": _topics(),
        "DIR": shtab.DIRECTORY,
    }
    for command in subcommands_of(top).values():
        for action in command._actions:
            if action.metavar in completed:
                # shtab reads this attribute, which argparse does not know.
                vars(action)["complete"] = completed[str(action.metavar)]
    return str(shtab.complete(top, shell=shell, preamble=_preamble()))


def _scenarios() -> dict[str, str]:
    """Return what completes the name of a scenario or of a file, by shell."""
    function = "_swarmstart_complete_scenario"
    # tcsh calls no functions, so it gets the present names and no files.
    return {"bash": function, "zsh": function, "tcsh": f"({' '.join(by_name())})"}


def _topics() -> dict[str, str]:
    """Return what completes a topic of the list, by shell."""
    words = f"({' '.join(TOPICS)})"
    return {"bash": "_swarmstart_complete_topic", "zsh": words, "tcsh": words}


def _preamble() -> dict[str, str]:
    """Return the functions that the scripts call."""
    # In bash -X removes what matches, so '!*.y*ml' keeps YAML files only, and
    # -S / adds the slash after which the completion goes on.
    names = " ".join(map(shlex.quote, by_name()))
    return {
        "bash": f"""\
_swarmstart_complete_scenario() {{
  compgen -W "{names}" -- "$1"
  compgen -f -X '!*.y*ml' -- "$1"
  compgen -d -S / -- "$1"
}}
_swarmstart_complete_topic() {{
  compgen -W "{" ".join(TOPICS)}" -- "$1"
}}""",
        "zsh": f"""\
_swarmstart_complete_scenario() {{
  _alternative 'scenarios:scenario:({names})' 'files:file:_files -g "*.y*ml"'
}}""",
    }
