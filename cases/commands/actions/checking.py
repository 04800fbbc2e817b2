"""`swarmstart check`: whether scenarios are valid, in all their variants."""

import argparse

from swarmstart.cases.commands.options.angles import angle_warnings
from swarmstart.cases.commands.terminal.output import DONE, answer, say
from swarmstart.cases.commands.wording.failures import reported
from swarmstart.cases.format.document import printable
from swarmstart.cases.format.scenario import (
    Flaw,
    InvalidScenarioError,
    read_document,
    resolve,
)
from swarmstart.cases.kinds.flight import flight_of
from swarmstart.errors import SwarmstartError


def check_command(options: argparse.Namespace) -> int:
    """Check the scenarios that the options name; return the worst exit code."""
    worst = DONE
    for name in options.scenarios:
        try:
            answer(check(name))
        except SwarmstartError as error:
            worst = max(worst, reported(error))
    return worst


def check(name_or_path: str) -> str:
    """Return one sentence on a valid scenario.

    Every variant is validated and built, so that a scenario that passes also runs. The
    Python file of a scenario is never run. Angles that look like degrees give a warning
    on standard error.

    Args:
        name_or_path: The name of a shipped scenario or a path.

    Raises:
        SwarmstartError: If it is invalid; the message lists every error.
    """
    document = read_document(name_or_path)
    flaws: dict[Flaw, None] = {}  # Errors that variants share are reported once.
    variants = document.data.get("variants")
    not_run: dict[str, None] = {}
    warnings: dict[str, None] = {}
    names: list[str | None] = [*variants] if isinstance(variants, dict) else [None]
    for variant in names or [None]:
        try:
            resolved = resolve(document, variant=variant)
            warnings |= dict.fromkeys(angle_warnings(resolved.settings))
            if resolved.code is None:
                flight_of(resolved.posed(), resolved.scenario)
            else:
                not_run[f"; {printable(str(resolved.code))} was not run"] = None
        except InvalidScenarioError as error:
            flaws |= dict.fromkeys(error.flaws)
    for warning in warnings:
        say(f"warning: {printable(document.name)}: {warning}")
    if flaws:
        raise InvalidScenarioError([*flaws])
    listed = ", ".join(filter(None, names))
    valid = f"{document.name}: valid" + (f" ({listed})" if listed else "")
    return valid + "".join(not_run)
