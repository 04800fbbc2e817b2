"""Lines on the seeds in which a claim fails: which, by which value, how to see one."""

import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from swarmstart.cases.campaign.engine.cells import Outcome
from swarmstart.cases.commands.wording.measure_list import measures_of_run
from swarmstart.cases.drawing.naming.quantities import quantity
from swarmstart.cases.drawing.naming.wording import is_number
from swarmstart.cases.format.document import printable
from swarmstart.cases.format.scenario import Resolved

SHOWN = 5
"""Seeds that a line names; further ones are counted."""
OF_SEEDS = ("--seeds", "--workers", "--out")
"""Options, each with a value, that the command for one run does not have."""
NO_UNITS = ("", "cost")
"""Entries of a table of measures that are no unit behind a number."""
SILENT = ("--no-figures", "--json", "-q", "--quiet")
"""Options without which a run shows more."""


def failing_lines(
    resolved: Resolved, outcomes: Sequence[Outcome], words: Sequence[str]
) -> list[str]:
    """Return a line for each claim that fails in some run.

    Args:
        resolved: The scenario.
        outcomes: Outcomes of its runs, seed by seed from 0 on.
        words: The command line of the runs, without the program's name.
    """
    units = measures_of_run(resolved)
    lines = []
    for number, claim in enumerate(resolved.scenario.claims):
        seeds = failing_seeds(outcomes, number)
        if seeds:
            values = {seed: _measures(outcomes[seed])[claim.measure] for seed in seeds}
            unit = units[claim.measure]["unit"]
            command = shlex.join(["swarmstart", *words_of_one(words, seeds[0])])
            lines.append(
                f"Claim {printable(claim.id)} fails in {_listed(values, unit)}; "
                f"see it: {printable(command)}"
            )
    return lines


def failing_seeds(outcomes: Sequence[Outcome], number: int) -> list[int]:
    """Return the seeds in which a claim does not hold, by its number from 0 on."""
    return [
        seed
        for seed, outcome in enumerate(outcomes)
        if outcome.result is not None
        and outcome.result["claims"][number]["holds"] is False
    ]


def words_of_one(words: Sequence[str], seed: int) -> list[str]:
    """Return the command line of the run with one seed.

    Example:
        >>> words_of_one(["run", "a.yaml", "--seeds", "9", "--search=ga"], 3)
        ['run', 'a.yaml', '--search=ga', '--seed', '3']
    """
    kept, rest = [], iter(words)
    for word in rest:
        if word in OF_SEEDS:
            next(rest, None)
        elif word not in SILENT and word.partition("=")[0] not in OF_SEEDS:
            kept.append(word)
    return [*kept, "--seed", str(seed)]


def _measures(outcome: Outcome) -> Mapping[str, Any]:
    found: Mapping[str, Any] = (outcome.result or {})["measures"]
    return found


def _listed(values: Mapping[int, Any], unit: str) -> str:
    """Return seeds, each with its value and unit in brackets."""
    said = [
        f"seed {seed} ({_with_unit(value, unit)})"
        for seed, value in [*values.items()][:SHOWN]
    ]
    left = len(values) - len(said)
    return ", ".join(said) + (f" and {left} more" if left else "")


def _with_unit(value: Any, unit: str) -> str:
    if not is_number(value):
        return "undefined"
    shown = quantity(float(value), 4)
    return f"{shown} {unit}" if unit not in NO_UNITS else shown
