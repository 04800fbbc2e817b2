"""`swarmstart check`: whether scenarios are valid, in all their variants.

Angles that look like degrees give a warning, here and in `swarmstart run`. Units that
contradict each other give a warning here only, since reading units takes a second. Two
further findings give a warning here only, since a run reports them at its end: a start
outside of a limit, and signals that plans wrongly take as linear between two checks.
"""

import argparse
import math
from collections.abc import Iterator, Mapping
from typing import Any

from swarmstart.cases.commands.terminal import DONE, answer, reported, say
from swarmstart.cases.drawing.wording import is_number, quantity
from swarmstart.cases.format.document import printable
from swarmstart.cases.format.flaws import Flaw, InvalidScenarioError
from swarmstart.cases.format.kind import Flight, Posed, SeveralPlansError
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import flight_of
from swarmstart.errors import SwarmstartError
from swarmstart.ocp.common import Paragraph

ENDING = "_rad"
"""End of the names of keys whose values are angles [rad]."""


def check_command(options: argparse.Namespace) -> int:
    """Check the scenarios that the options name; return the worst exit code."""
    worst = DONE
    for name in options.scenarios:
        try:
            answer(check(name))
        except SwarmstartError as error:
            # A file that cannot be read has the larger code, and is the worse case.
            worst = max(worst, reported(error))
    return worst


def check(name_or_path: str) -> str:
    """Return one sentence on a valid scenario.

    Every variant is validated and built, so that a scenario that passes also runs. The
    Python file of a scenario is never run. Warnings on standard error name angles that
    look like degrees, units that contradict each other, signals that plans wrongly take
    as linear, and limits that the start breaks.

    Raises:
        SwarmstartError: If the scenario is invalid; the message lists every error.
    """
    document = read_document(name_or_path)
    flaws: dict[Flaw, None] = {}  # Errors that variants share are reported once.
    variants = document.data.get("variants")
    not_run: dict[str, None] = {}
    warnings: dict[str, None] = {}
    names: list[str | None] = [*variants] if isinstance(variants, dict) else [None]
    # An empty mapping of variants: `resolve` refuses it, with its place.
    for variant in names or [None]:
        try:
            resolved = resolve(document, variant=variant)
            warnings |= dict.fromkeys(angle_warnings(resolved.settings))
            if not resolved.kind.posed_by_code:
                # A part of the errors shows only when the closed loop is built.
                flight = flight_of(resolved.posed(), resolved.scenario)
                warnings |= dict.fromkeys(unit_warnings(flight.posed))
                warnings |= dict.fromkeys(ramp_warnings(flight.posed))
                warnings |= dict.fromkeys(start_warnings(flight))
            if resolved.code is not None:
                not_run[f"; {printable(resolved.code)} was not run"] = None
        except InvalidScenarioError as error:
            flaws |= dict.fromkeys(error.flaws)
    for warning in warnings:
        say(f"warning: {printable(document.name)}: {warning}")
    if flaws:
        raise InvalidScenarioError([*flaws])
    listed = ", ".join(filter(None, names))
    valid = f"{document.name}: valid" + (f" ({listed})" if listed else "")
    return valid + "".join(not_run)


def unit_warnings(posed: Posed) -> list[str]:
    """Return a warning for each equation whose units contradict each other."""
    models = [agent.problem.model for agent in posed.agents]
    # Vehicles that plan alone have the same equations, each with its own names.
    return [words for model in models for words in model.unit_conflicts()]


def ramp_warnings(posed: Posed) -> list[str]:
    """Return a warning for each signal that plans wrongly take as linear."""
    advice = f"; more checks make it shorter (more: {Paragraph.RAMP})"
    return [f"{ramp}{advice}" for ramp in posed.ramps]


def warn_of_ramps(name: str, posed: Posed) -> None:
    """Print a warning for each signal that plans wrongly take as linear.

    Args:
        name: Name of the scenario.
        posed: The scenario as it is posed.
    """
    for warning in ramp_warnings(posed):
        say(f"warning: {printable(name)}: {warning}")


def start_warnings(flight: Flight[Posed]) -> list[str]:
    """Return a warning for each limit that the start breaks, whatever the plan is."""
    posed = flight.posed
    if not posed.agents:
        return []
    try:
        planner = flight.loop.planner
    except SeveralPlansError:
        return []
    x0, known, _ = planner.posed(posed.x0, posed.known_by(0, 0.0))
    return [
        f"the start is outside: {printable(str(excess))} (more: {Paragraph.INFEASIBLE})"
        for excess in planner.outside(x0, known)
    ]


def angle_warnings(settings: Mapping[str, Any]) -> list[str]:
    """Return a warning for each angle that looks like degrees.

    Such an angle is above a full turn, and a multiple of 0.5. A heading in radians can
    be above a full turn, too, as 11*pi/5 for a UAV that turns left; but it is hardly
    ever a multiple of 0.5, while degrees mostly are.

    Example:
        >>> angle_warnings({"heading_rad": 90.0})[0].partition(" (more: ")[0]
        'heading_rad = 90 is more than a full turn; is it in degrees? radians(90)'
    """
    return [
        f"{printable(name)} = {quantity(value)} is more than a full turn; is it in "
        f"degrees? radians({quantity(value)}) (more: {Paragraph.DEGREES})"
        for name, value in _angles(settings, "", is_angle=False)
        if abs(value) > 2 * math.pi and (2 * value).is_integer()
    ]


def warn_of_angles(settings: Mapping[str, Any]) -> None:
    """Print a warning on standard error for each angle that looks like degrees."""
    for warning in angle_warnings(settings):
        say(f"warning: {warning}")


def _angles(part: Any, name: str, *, is_angle: bool) -> Iterator[tuple[str, float]]:
    """Yield the dotted name and the value of each number below an angle's key."""
    if isinstance(part, Mapping):
        for key, inner in part.items():
            dotted = f"{name}.{key}" if name else str(key)
            yield from _angles(inner, dotted, is_angle=str(key).endswith(ENDING))
    elif isinstance(part, list):
        for place, inner in enumerate(part):
            yield from _angles(inner, f"{name}.{place}", is_angle=is_angle)
    elif is_angle and is_number(part):
        yield name, float(part)
