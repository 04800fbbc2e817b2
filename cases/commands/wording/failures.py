"""Errors as one message on standard error, and their exit codes."""

from swarmstart.cases.commands.terminal.output import (
    FILE,
    INTERNAL,
    INVALID,
    OutputError,
    say,
    tell,
)
from swarmstart.errors import SwarmstartError

MOST_FLAWS = 20
"""Errors of a scenario that are printed; further ones are counted."""


def reported(error: Exception) -> int:
    """Print an error as one message; return its exit code."""
    from swarmstart.cases.format.document import UnreadableFileError, YamlError
    from swarmstart.cases.format.scenario import InvalidScenarioError
    from swarmstart.cases.record.files import RecordError

    if isinstance(error, InvalidScenarioError):
        for flaw in error.flaws[:MOST_FLAWS]:
            _tell_with_frame(str(flaw), flaw.frame)
        if len(error.flaws) > MOST_FLAWS:
            say(f"and {len(error.flaws) - MOST_FLAWS} more errors")
        return INVALID
    if isinstance(error, YamlError):
        _tell_with_frame(str(error), error.frame)
        return INVALID
    if isinstance(error, SwarmstartError):
        say(str(error))
        of_file = isinstance(error, UnreadableFileError | RecordError | OutputError)
        return FILE if of_file else INVALID
    return _reported_of_system(error)


def _reported_of_system(error: Exception) -> int:
    """Report an error from outside this package and return its exit code."""
    if isinstance(error, OSError):
        say(f"expected to read and write files, found: {error}")
        return FILE
    if isinstance(error, MemoryError):
        say(f"expected enough memory, found too little: {error}")
        return INVALID
    say(f"internal error: {type(error).__name__}: {error} (--debug shows where)")
    return INTERNAL


def _tell_with_frame(text: str, frame: str) -> None:
    tell("\n".join(filter(None, (text, frame))))
