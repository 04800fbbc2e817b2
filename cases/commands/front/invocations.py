"""Commands by name, each of which imports what it needs when it is called."""

import argparse
import json

from swarmstart.cases.commands.terminal.output import DONE, answer


def run(options: argparse.Namespace) -> int:
    """Run one scenario; return the exit code."""
    from swarmstart.cases.commands.actions.run import run_command

    return run_command(options)


def replicate(options: argparse.Namespace) -> int:
    """Judge the chapter's claims; return the exit code."""
    from swarmstart.cases.commands.actions.replicate import replicate_command

    return replicate_command(options)


def compare(options: argparse.Namespace) -> int:
    """Compare solvers; return the exit code."""
    from swarmstart.cases.commands.actions.compare import compare_command

    return compare_command(options)


def report(options: argparse.Namespace) -> int:
    """Write pages of records; return the exit code."""
    from swarmstart.cases.commands.actions.report import report_command

    return report_command(options)


def open_record(options: argparse.Namespace) -> int:
    """Open the figures of a record; return the exit code."""
    from swarmstart.cases.commands.actions.opening import open_command

    return open_command(options)


def new(options: argparse.Namespace) -> int:
    """Write a scenario to start from; return the exit code."""
    from swarmstart.cases.commands.actions.new import new_command

    return new_command(options)


def listing(options: argparse.Namespace) -> int:
    """List what there is; return the exit code."""
    from swarmstart.cases.commands.actions.listing import list_command

    return list_command(options)


def check(options: argparse.Namespace) -> int:
    """Check scenarios; return the exit code."""
    from swarmstart.cases.commands.actions.checking import check_command

    return check_command(options)


def schema(options: argparse.Namespace) -> int:
    """Print the schema of a kind; return the exit code."""
    from swarmstart.cases.format.schema import scenario_schema

    answer(json.dumps(scenario_schema(options.kind), indent=2))
    return DONE


def cache(options: argparse.Namespace) -> int:
    """Show the cache of machine code, or clear it; return the exit code."""
    from swarmstart.cases.commands.actions.cache import cache_command

    return cache_command(options)


def completion(options: argparse.Namespace) -> int:
    """Print a completion script; return the exit code."""
    from swarmstart.cases.commands.front.completion import completion_command

    return completion_command(options)
