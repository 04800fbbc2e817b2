"""The permission to run a user's Python file; only an option of a command gives it."""

import argparse
from collections.abc import Callable
from dataclasses import replace

from swarmstart.cases.commands.terminal.output import say
from swarmstart.cases.format.scenario import Resolved


def allowing(
    resolved: Resolved,
    options: argparse.Namespace,
    told: Callable[[str], object] = say,
) -> Resolved:
    """Return the scenario with the permission that the options give, and print it.

    Args:
        resolved: The scenario.
        options: The options of the command.
        told: Prints a message.
    """
    if resolved.code is None or not options.allow_python:
        return resolved
    told(f"running {resolved.code}, as --allow-python allows")
    return replace(resolved, allow_python=True)
