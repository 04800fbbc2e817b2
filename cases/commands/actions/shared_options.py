"""Options that several commands share: --fail-on and --allow-code.

The first states conditions on measures, and `run` checks whether its runs meet them.
The second is the only way to give the permission to run a user's Python file.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from swarmstart.cases.campaign.running.claims import holds
from swarmstart.cases.commands.terminal import say
from swarmstart.cases.format.document import meant, printable, shown
from swarmstart.cases.format.kind import Measure
from swarmstart.cases.format.scenario import Resolved
from swarmstart.cases.record.files import to_json
from swarmstart.errors import SwarmstartError

Condition = tuple[str, str, float | None]
"""Measure, relation, and number; None means that the measure is undefined."""
_CONDITION = re.compile(r"\s*(\w+)\s*(<=|>=|==|<|>)\s*(\S+)\s*")


class InvalidConditionError(SwarmstartError, ValueError):
    """The text after --fail-on is not a condition on a measure."""


def condition_of(text: str, resolved: Resolved) -> Condition:
    """Return measure, relation and bound in the text of --fail-on.

    The bound is None if it is null in the text: the condition is then that the measure
    is not defined.

    Raises:
        InvalidConditionError: If the text is not a condition on a measure of the
            scenario.
    """
    known = resolved.kind.measures_of(resolved.scenario)
    match = _CONDITION.fullmatch(text)
    expected = "expected --fail-on 'MEASURE RELATION NUMBER'"
    if match is None:
        raise InvalidConditionError(f"{expected}, found {shown(text)}")
    measure, relation, bound = match.groups()
    if measure not in known:
        hint = meant(measure, known, otherwise="see swarmstart list measures")
        raise InvalidConditionError(
            f"expected a measure in --fail-on, found {shown(measure)}; {hint}"
        )
    if bound == "null":
        if relation != "==":
            raise InvalidConditionError(
                f"expected == with null in --fail-on, found {relation}"
            )
        return measure, relation, None
    try:
        number = float(bound)
    except ValueError:
        number = math.nan  # Refused below, as "inf" is.
    if not math.isfinite(number):
        raise InvalidConditionError(f"{expected}, found {shown(bound)} as the number")
    return measure, relation, number


def _met(condition: Condition, measured: Measure, why: str) -> bool | None:
    """Return whether a condition is true; for a list, whether it is for any entry.

    `why` is the reason for which the measure may be undefined, as in `Kind`.

    Returns:
        None if the measure is undefined and the condition cannot be judged.
    """
    _, relation, bound = condition
    if isinstance(measured, list):
        return any(holds(value, relation, bound, reason=why) for value in measured)
    return holds(measured, relation, bound, reason=why)


def met_conditions(
    conditions: Sequence[Condition],
    measures: Mapping[str, Measure],
    resolved: Resolved,
) -> list[str]:
    """Return the true conditions in words; print those that cannot be judged."""
    met = []
    for condition in conditions:
        measure, relation, bound = condition
        # A time that never comes exceeds every bound, so the reason decides.
        why = resolved.kind.undefined_of(resolved.scenario).get(measure, "")
        value = measures[measure]
        holds_now = _met(condition, value, why)
        if holds_now is None:
            reason = why or "it is not a number"
            say(f"--fail-on not judged: {measure} is not defined: {reason}")
        elif holds_now:
            found = why if value is None else to_json(value)
            met.append(f"{measure} = {found} {relation} {to_json(bound)}")
    return met


def allowing(
    resolved: Resolved,
    options: argparse.Namespace,
    told: Callable[[str], object] = say,
) -> Resolved:
    """Return the scenario, with permission to run code if --allow-code is given.

    A line then says which code is run.
    """
    # Without the permission posing raises, with the name of the option.
    if resolved.code is None or not options.allow_code:
        return resolved
    told(f"running {printable(resolved.code)}, as --allow-code allows")
    return replace(resolved, allow_code=True)
